"""Define the records of the claims about a design and about its velocity loop."""

from collections.abc import Callable, Iterator, Mapping
from math import degrees, inf, log10, radians
from typing import Annotated, Any

from pydantic import Field

from vctune.analysis.margins import unstable_poles
from vctune.analysis.sampled_loop import spectral_radius
from vctune.document.records.part import (
    DisplayPart,
    From,
    Nullable,
    Pair,
    Proof,
    RecordPart,
    Row,
    how_shown,
    made,
    text,
)
from vctune.model.fields import Shown
from vctune.model.hands import Hand, Hands, LeastOperator, passive_hand
from vctune.model.numbers.units import Units, finite_hertz, in_full
from vctune.model.parts import Unmodelled
from vctune.model.worlds import OVER_LIMIT, World, Worlds
from vctune.proof.claims.claim import ClaimId
from vctune.proof.claims.registry import claims_about
from vctune.proof.outcome import Outcome, Verdict, enclosed

ENVIRONMENTS = "with every environment that is passive as the firmware runs it"

GRAMS = 0.1  # Mass below which a tool is weighed in grams, kg


class PerturbationRecord(RecordPart):
    """The error of the device's response within the disc of unmodelled dynamics: a factor 1 + share r e^(j phase),
    where r is the radius of the disc."""

    share: float
    phase_deg: float

    def __str__(self) -> str:
        return str(Unmodelled((), self.share, radians(self.phase_deg)))


class DeviceRecord(RecordPart):
    """The parameters of a device that may be uncertain."""

    mass: Annotated[float, Shown("mass", of="mass")] = 0.0
    damping: Annotated[float, Shown("damping", of="damping")] = 0.0
    delay: Annotated[float, Shown("delay", of="time")] = 0.0
    parts: dict[str, float] = Field(default_factory=dict)
    unmodelled: PerturbationRecord | None = None

    def in_words(self, units: Units, shown: Callable[[float], str] = text) -> str:
        """Return the parameters of the device in words, without a mass, a damping or a delay that is 0."""
        numbers = {shown.of: getattr(self, name) for name, shown in how_shown(DeviceRecord).items()}
        numbers_in_words = [f"{shown(number)} {units.of(of)}" for of, number in numbers.items() if number]
        parts_in_words = [f"{key} {shown(number)}" for key, number in self.parts.items()]
        perturbation = [] if self.unmodelled is None else [str(self.unmodelled)]
        return ", ".join([*numbers_in_words, *parts_in_words, *perturbation])


class ClaimRecord(RecordPart):
    """A claim. If it fails, the record names the frequency, the device and the hand."""

    id: ClaimId
    claim: str
    verdict: Proof
    witness_hz: Nullable  # frequency at which a claim fails or is undecided
    witness_device: DeviceRecord | None = None  # device of the box, and hand, in which it fails there
    witness_hand: Hand | None = None
    cut: bool = False

    def rows(self, units: Units) -> Iterator[Row]:
        """Yield the rows of a claim that is not proved. The text of a claim is too long for a label."""
        yield Row(
            "claim",
            self.verdict,
            self.claim + ("" if self.witness_hz is None else f", at {text(self.witness_hz, 6)} Hz"),
        )
        if self.witness_device is not None:
            yield Row("", "", f"with {self.witness_device.in_words(units, in_full)}")
        if self.witness_hand is not None:
            yield Row("", "", f"in the hand of {self.witness_hand.in_words(units)}")


class WorldRecord(RecordPart):
    """The virtual environment with which a design has the smallest margin: a mass, kg, on a spring, N/m."""

    mass: float
    stiffness: float

    def row(self, hz: Nullable, units: Units) -> Row:
        """Return the row of the environment."""
        place = "" if hz is None else f" at {text(hz)} Hz"
        small = units.mass == "kg" and self.mass < GRAMS
        mass, unit = (1e3 * self.mass, "g") if small else (self.mass, units.mass)
        if self.mass and self.stiffness:
            return Row("binding world", text(mass, 4), f"{unit} on {text(self.stiffness, 4)} {units.stiffness}{place}")
        if self.mass:
            return Row("binding world", text(mass, 4), f"{unit} tool{place}")
        if self.stiffness:
            return Row("binding world", text(self.stiffness, 4), f"{units.stiffness} spring{place}")
        return Row("binding world", "none", f"nothing rendered{place}")


def _hands(box: dict[str, list[Nullable]], tool: dict[str, list[Nullable]] | None) -> Hands:
    """Return the box of hands that a record states by the ends of its ranges."""

    def ends(of: dict[str, list[Nullable]], k: int) -> Hand:
        return Hand(**{name: pair[k] for name, pair in of.items()})

    return Hands(ends(box, 0), ends(box, 1), None if tool is None else Hands(ends(tool, 0), ends(tool, 1)))


class WallsRecord(DisplayPart):
    """The claim about every wall in a box of environments."""

    verdict: Annotated[Proof, Shown("every wall", "by the multiplier with its corner at {corner_hz} Hz")]
    corner_hz: float  # corner of the multiplier that proves the walls
    min_ratio: Annotated[Nullable, Shown("least with walls", "at {worst_hz} Hz in the hand of {worst_hand}")]
    worst_hz: Nullable
    worst_hand: Hand
    boxes: int  # number of boxes in the proof


class HandsRecord(DisplayPart):
    """The claims about every hand of a box, in the sampled loop at every frequency."""

    verdict: Annotated[Proof, Shown("every hand", "of {within}")]
    box: dict[str, Pair]  # ends of the range of each parameter of the hands, their tool included
    tool: dict[str, Pair] | None = None  # those of the tool; absent without one
    min_ratio: Annotated[Nullable, Shown("{measured}", "at {worst_hz} Hz in the hand of {worst_hand}")]
    worst_hz: Nullable
    worst_hand: Hand
    boxes: int  # number of boxes in the proof
    worlds: dict[str, Pair] | None = None
    worst_world: WorldRecord | None = None  # environment with which the ratio is least
    walls: WallsRecord | None = None  # claim about walls; null without walls

    def rows(self, units: Units) -> Iterator[Row]:
        """Yield the rows, then those of the binding environment and of the walls."""
        yield from super().rows(units)
        if self.worst_world is not None:
            yield self.worst_world.row(self.worst_hz, units)
        yield from self.walls.rows(units) if self.walls else ()

    @property
    def measured(self) -> str:
        """The name of the ratio: with environments, the number by which the coupling may be divided."""
        return f"least {self.coupled} / R" if self.worlds is None else OVER_LIMIT

    def environments(self, units: Units) -> str:
        """Return the environments of the claim in words."""
        if self.worlds is None:
            return ENVIRONMENTS
        ends = {name: [inf if end is None else end for end in pair] for name, pair in self.worlds.items()}
        low, high = (World(**{name: pair[k] for name, pair in ends.items()}) for k in (0, 1))
        box = Worlds(low, high, self.walls is not None)
        return f"with {box.in_words(units)}"

    @property
    def within(self) -> Hands:
        """The box of hands."""
        return _hands(self.box, self.tool)

    def promise(self, units: Units) -> str:
        """Return the claim in words. The function does not check the verdict."""
        return f"in every hand of {self.within.in_words(units)}, {self.environments(units)}, at every frequency"


class AnyHandRecord(DisplayPart):
    """The claim about any passive hand on an impedance display, in the sampled loop at every frequency."""

    verdict: Annotated[Proof, Shown("any passive hand")]
    min_ratio: Annotated[Nullable, Shown("least {coupled} / R", "at {worst_hz} Hz")]
    worst_hz: Nullable
    boxes: int

    def promise(self, hand: str) -> str:
        """Return the claim in words, of a hand in words. The function does not check the verdict."""
        return f"in {hand}, {ENVIRONMENTS}, at every frequency"


class WallRecord(RecordPart):
    """The claim about the coupling of an impedance display as a wall."""

    verdict: Annotated[Proof, Shown("wall")]
    box: dict[str, Pair] | None = None  # ranges of the hands, their tool included; absent for any passive hand
    tool: dict[str, Pair] | None = None
    min_ratio: Annotated[Nullable, Shown("unstable at", "times the wall, at {worst_hz} Hz")]
    worst_hz: Nullable
    worst_hand: Hand | None = None
    # of the loop that the wall closes on the nominal device in the least of the hands; null if it is not proved
    peak_sensitivity: Annotated[
        Nullable, Shown("peak |S|", "at {peak_sensitivity_hz} Hz, of the wall's loop in the least hand")
    ]
    peak_sensitivity_hz: Nullable
    phase_margin_deg: Annotated[Nullable, Shown("phase margin", "deg, of the wall's loop in the least hand")]
    boxes: int

    def rows(self, units: Units) -> Iterator[Row]:
        """Yield the verdict with the hands, and the least multiple of the wall that is unstable."""
        verdict, limit, *margins = super().rows(units)
        yield verdict._replace(unit="" if self.box is None else self.hands("", units))
        hand = "" if self.worst_hand is None else f" in the hand of {self.worst_hand.in_words(units)}"
        yield limit._replace(unit=limit.unit + hand)
        yield from (margin for margin in margins if margin.value != "none")

    def hands(self, passive: str, units: Units) -> str:
        """Return the hands of the claim in words, if it is one of any passive hand with its own words."""
        if self.box is None:
            return f"in {passive}"
        return f"in every hand of {_hands(self.box, self.tool).in_words(units)}"

    def promise(self, passive: str, units: Units) -> str:
        """Return the claim in words. The function does not check the verdict."""
        return f"{self.hands(passive, units)}, with its coupling as a wall, at every frequency"


class WholeSampleRecord(RecordPart):
    """The worse verdict of a delay just below a whole number of samples and of this number, where the sensed force
    jumps. `delay` is the whole number in s."""

    verdict: Annotated[Proof, Shown("either side", "of {samples} T = {delay} s of delay, where the sensed force jumps")]
    samples: int
    delay: float


class CertificateRecord(DisplayPart):
    """The claims about a design, and the numbers that describe them."""

    # "proved" if every claim is proved
    verdict: Annotated[Proof, Shown("verdict", "{boxes} boxes"), From(lambda of: of.certificate.verdict.value)]
    band_hz: Annotated[
        Pair | None,
        Shown("band", "Hz; outside it nothing is claimed of the ratio"),
        From(lambda of: [*map(finite_hertz, of.band)] if of.band else None),
    ]
    proved_ratio: Annotated[Nullable, From(lambda of: of.certificate.proved_ratio)]
    min_ratio: Annotated[
        Nullable, Shown("{measured}", "at {worst_hz} Hz"), From(lambda of: of.min_ratio, Shown("least Re Z_c / R"))
    ]
    worst_hz: Annotated[
        Nullable, From(lambda of: finite_hertz(of.worst), Shown("where the ratio is least", of="frequency"))
    ]
    boxes: Annotated[int, From(lambda of: of.certificate.boxes)]
    claims: list[ClaimRecord]
    hands: HandsRecord | None = None  # claims in hands; null if the problem does not make them
    any_hand: AnyHandRecord | None = None
    wall: WallRecord | None = None
    whole_sample: WholeSampleRecord | None = None  # verdict beside a delay of a whole number of samples
    least_hand: Hand | None = None  # what the proof of any passive hand counts on in every hand; null for nothing

    def told(self, row: Row) -> Row:
        """Return the row of a least ratio with a note if it is an estimate alone."""
        labels = "unstable at", "least with walls", OVER_LIMIT, f"least {self.coupled} / R"
        if row.label in labels[:3] and row.value == "none":  # no multiple fails, at no place
            return Row(row.label, "no limit", "estimated")
        if row.label not in labels or enclosed(row.value, self.proved_ratio):
            return row
        return row._replace(unit=f"{row.unit}; estimated")

    @property
    def measured(self) -> str:
        """The name of the least ratio of all claims."""
        return f"least {self.coupled} / R" if self.hands is None else self.hands.measured

    def passive_hand(self, units: Units) -> str:
        """Return the hands of a claim about any passive hand in words."""
        least = self.least_hand
        return passive_hand(None if least is None else LeastOperator(least.mass, least.damping), units)

    def rows(self, units: Units) -> Iterator[Row]:
        """Yield the rows, including the rows of unproved claims and, if there is a band, the rows of the band."""
        shown = list(super().rows(units))
        parts = [part for part in (self.any_hand, self.hands, self.wall) if part is not None]
        first = shown if self.band_hz is not None else shown[:1]  # the first row is the verdict
        yield from map(self.told, [*first, *(row for part in parts for row in part.rows(units))])
        yield from self.whole_sample.rows(units) if self.whole_sample else ()
        for claim in self.claims:
            yield from claim.rows(units) if claim.verdict != "proved" else ()


class NyquistRecord(RecordPart):
    """Nyquist's count for the sampled loop: Z = N + P unstable poles of the closed loop."""

    N: Annotated[int | None, From(lambda of: unstable_poles(of.device, of.gains))]
    P: Annotated[int, From(lambda of: 0)]
    Z: Annotated[
        int | None,
        Shown("unstable poles", "= N + P: {N} encirclements of -1 and {P} poles of the open loop"),
        From(lambda of: 0 if of.certificate.outcomes["stable"].verdict is Verdict.PROVED else None),
    ]


def _stable(outcomes: Mapping[ClaimId, Outcome]) -> bool | None:
    """Return whether the loop is proved stable; None if that is undecided."""
    poles = [outcomes[claim].verdict for claim in claims_about("poles") if claim in outcomes]
    return False if Verdict.REFUTED in poles else None if Verdict.UNDECIDED in poles else True


def loudest(of: Any) -> float | None:
    """Return the peak of |S| of the loop that a design closes, its velocity loop or a wall's; None without one."""
    wall = of.closed_loop
    return of.peak_sensitivity if of.gains.closed else None if wall is None else wall.peak


class InnerLoopRecord(RecordPart):
    """The sampled velocity loop of a device with a loop of its own. A margin that is infinite is null."""

    stable: Annotated[bool | None, From(lambda of: _stable(of.certificate.outcomes))]
    spectral_radius: Annotated[
        Nullable, Shown("spectral radius", "{stability}"), From(lambda of: spectral_radius(of.device, of.gains))
    ]
    peak_sensitivity: Annotated[
        Nullable,
        Shown("peak |S|", "at {peak_sensitivity_hz} Hz"),
        From(loudest, Shown("peak |S|")),
    ]
    peak_sensitivity_hz: Annotated[Nullable, From(lambda of: finite_hertz(of.worst_sensitivity))]
    gain_margin_db: Annotated[Nullable, Shown("gain margin", "dB"), From(lambda of: 20 * log10(of.loop_margins.gain))]
    phase_margin_deg: Annotated[Nullable, Shown("phase margin", "deg"), From(lambda of: degrees(of.loop_margins.phase))]
    delay_margin_s: Annotated[Nullable, Shown("delay margin", "s"), From(lambda of: of.loop_margins.delay)]
    nyquist: Annotated[NyquistRecord, From(lambda of: made(NyquistRecord, of))]

    def rows(self, units: Units) -> Iterator[Row]:
        """Yield the rows, including Nyquist's count."""
        for row in super().rows(units):
            yield row if row.value != "none" else row._replace(value="no limit", unit="")
        yield from self.nyquist.rows(units)

    @property
    def stability(self) -> str:
        """The verdict on the stability of the loop, in words."""
        return {True: "stable", False: "unstable", None: "undecided"}[self.stable]
