"""The record of a design: each key of design.json once, with its type and how it is shown (README.md, section 3).

What is written, what a file must hold to be read back, and the rows of the table and of the report's page all follow
from the fields of these classes: a new number is a new field.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from math import radians
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from vctune.document.part import Document, Number, Pair, Part, Row, Shown, how_shown, text
from vctune.document.prices import PriceRecord
from vctune.model.quantities import (
    AnyCoupling,
    Coupling,
    Device,
    Display,
    Gains,
    Hand,
    Hands,
    SpringDamper,
    Unmodelled,
)
from vctune.model.transparency import TermName
from vctune.model.units import UNITS, Units, UnitSystem

ENVIRONMENTS = "with every environment that is passive as the firmware runs it"

Four = Annotated[list[float], Field(min_length=4, max_length=4)]
NotNegative = Annotated[float, Field(ge=0)]
Positive = Annotated[float, Field(gt=0)]
Proof = Literal["proved", "refuted", "undecided"]


class ProblemRecord(Part):
    """The problem file, and how its device moves: nothing is said of a linear one."""

    name: str
    sha256: str
    text: str
    units: UnitSystem = "linear"


def stated_units(device: Device) -> dict[str, UnitSystem]:
    """Return what a record says of how a device moves: nothing of a linear one."""
    return {} if device.units == "linear" else {"units": device.units}


class GainsRecord(Part):
    """Gains of the velocity loop."""

    velocity: Annotated[NotNegative, Shown("velocity K_v", digits=8, of="damping")]
    position: Annotated[NotNegative, Shown("position K_p", digits=8, of="stiffness")]

    @property
    def plain(self) -> Gains:
        """The gains."""
        return Gains(self.velocity, self.position)


class CouplingRecord(Part):
    """The virtual coupling."""

    damping: Annotated[Positive, Shown("damping b_c", digits=8, of="damping")]
    mass: Annotated[Positive, Shown("mass m_c", digits=8, of="mass")]
    drag: Annotated[NotNegative, Shown("drag b_0", digits=8, of="damping")] = 0.0

    @property
    def plain(self) -> AnyCoupling:
        """The coupling."""
        return Coupling(self.damping, self.mass, self.drag)


class SpringRecord(Part):
    """The virtual coupling of an impedance display."""

    damping: Annotated[NotNegative, Shown("damping b_c", digits=8, of="damping")]
    stiffness: Annotated[Positive, Shown("stiffness k_c", digits=8, of="stiffness")]

    @property
    def plain(self) -> SpringDamper:
        """The coupling."""
        return SpringDamper(self.damping, self.stiffness)


def of_spring(value: Any) -> str:
    """Return the tag of a coupling, tables or a record: an impedance display's has a stiffness."""
    stiff = "stiffness" in value if isinstance(value, dict) else isinstance(value, SpringRecord)
    return "<spring>" if stiff else "<mass>"


AnyCouplingRecord = Annotated[
    Annotated[CouplingRecord, Tag("<mass>")] | Annotated[SpringRecord, Tag("<spring>")], Discriminator(of_spring)
]


def coupling_record(coupling: AnyCoupling) -> CouplingRecord | SpringRecord:
    """Return the record of a coupling."""
    return (SpringRecord if isinstance(coupling, SpringDamper) else CouplingRecord)(**asdict(coupling))


class DisplayPart(Part):
    """Part of a record whose words depend on the display."""

    display: Display = "admittance"

    @property
    def coupled(self) -> str:
        """What must be resistive enough."""
        return "Re 1/Z_c" if self.display == "impedance" else "Re Z_c"


class TransparencyRecord(DisplayPart):
    """The error and its unweighted terms, of an impedance display those of the dual."""

    error: Annotated[Number, Shown("error")]
    admittance: Annotated[Number, Shown("{free_motion}")]
    tracking: Annotated[Number, Shown("{missed}")]
    coupling: Annotated[Number, Shown("{given_way}")]

    @property
    def free_motion(self) -> str:
        """The term of free motion."""
        return "|1/G_hh|/Z_0" if self.display == "impedance" else "|Z_0 G_hh|"

    @property
    def missed(self) -> str:
        """The term of what is commanded and not done."""
        return "|1 - A H/N|" if self.display == "impedance" else "|1 - G_he|"

    @property
    def given_way(self) -> str:
        """The term of the coupling."""
        return "Z_0 |1/Z_c|" if self.display == "impedance" else "|Z_c|/Z_0"


class PerturbationRecord(Part):
    """Which of the responses that a device may have: times 1 + share r e^(j phase), r the radius of the disc."""

    share: float
    phase_deg: float

    def __str__(self) -> str:
        return str(Unmodelled((), self.share, radians(self.phase_deg)))


class DeviceRecord(Part):
    """The numbers of a device that may be uncertain; those of its parts by their keys."""

    mass: Annotated[float, Shown("mass", of="mass")]
    damping: Annotated[float, Shown("damping", of="damping")]
    delay: Annotated[float, Shown("delay", of="time")]
    parts: dict[str, float] = Field(default_factory=dict)
    unmodelled: PerturbationRecord | None = None

    def in_words(self, units: Units) -> str:
        """Return its numbers, those that are 0 apart."""
        own = [f"{row.value} {row.unit}" for row in self.rows(units) if float(row.value)]
        off = [] if self.unmodelled is None else [str(self.unmodelled)]
        return ", ".join([*own, *(f"{key} {text(number)}" for key, number in self.parts.items()), *off])


class ResonatorRecord(Part):
    """A mass on a spring of its own."""

    mass: float
    stiffness: float


class HandRecord(Part):
    """A hand at the handle, maybe with resonators on it."""

    mass: float
    damping: float
    stiffness: float
    resonators: list[ResonatorRecord] | None = None

    def in_words(self, units: Units) -> str:
        """Return its numbers with their units."""
        itself = Hand(self.mass, self.damping, self.stiffness).in_words(units)
        hung = [
            f"{text(each.mass, 4)} {units.mass} on {text(each.stiffness, 4)} {units.stiffness}"
            for each in self.resonators or []
        ]
        return f"{itself} with resonators of {' and '.join(hung)}" if hung else itself


class EnvironmentRecord(Part):
    """The passive environment, by the trapezoidal rule, with which a design grows in a hand."""

    hand: HandRecord
    kind: Literal["spring", "mass"]
    value: float
    unit: str
    damping: float
    hz: float
    growth_per_s: float

    def in_words(self, units: Units) -> str:
        """Return what it is and how the design grows with it."""
        kind = units.translated(f"a {self.kind}") if self.damping else f"a lossless {units.translated(self.kind)}"
        rendered = f"{kind} of {text(self.value)} {self.unit}" if self.value else "nothing rendered"
        if self.damping:
            rendered += f" and a damper of {text(self.damping)} {units.damping}"
        return f"{text(self.hz, 6)} Hz with {rendered}, e-fold in {text(1 / self.growth_per_s, 3)} s"


class ClaimRecord(Part):
    """A claim, where, on which device and in which hand it fails, and what makes it grow there."""

    claim: str
    verdict: Proof
    witness_hz: Number
    witness_device: DeviceRecord | None = None
    witness_hand: HandRecord | None = None
    environment: EnvironmentRecord | None = None

    def rows(self, units: Units) -> Iterator[Row]:
        """Yield what is shown of a claim that is not proved; its text is too long for a label."""
        yield Row(
            "claim",
            self.verdict,
            self.claim + ("" if self.witness_hz is None else f", at {text(self.witness_hz, 6)} Hz"),
        )
        if self.witness_device is not None:
            yield Row("", "", f"with {self.witness_device.in_words(units)}")
        if self.witness_hand is not None:
            yield Row("", "", f"in the hand of {self.witness_hand.in_words(units)}")
        if self.environment is not None:
            yield Row("", "", f"grows at {self.environment.in_words(units)}")
            if self.environment.hand != self.witness_hand:
                yield Row("", "", f"in the hand of {self.environment.hand.in_words(units)}")


class WithoutOperatorRecord(Part):
    """What the design is worth to hands that do not contain the least operator."""

    verdict: Proof
    min_ratio: Annotated[Number, Shown("without operator", "at {worst_hz} Hz, {verdict}")]
    worst_hz: Number


class HandsRecord(DisplayPart):
    """What is proved of every hand of a box, in the sampled loop at every frequency."""

    verdict: Annotated[Proof, Shown("every hand", "of {within}")]
    box: dict[str, Pair]
    min_ratio: Annotated[Number, Shown("least {coupled} / R", "at {worst_hz} Hz in the hand of {worst_hand}")]
    worst_hz: Number
    worst_hand: HandRecord
    boxes: int

    @property
    def within(self) -> Hands:
        """The box."""
        return Hands(*(Hand(**{name: ends[k] for name, ends in self.box.items()}) for k in (0, 1)))

    def promise(self, units: Units) -> str:
        """Return what is proved if it is, in words."""
        return f"in every hand of {self.within.in_words(units)}, {ENVIRONMENTS}, at every frequency"


class AnyHandRecord(DisplayPart):
    """What is proved of any passive hand on an impedance display, in the sampled loop at every frequency."""

    verdict: Annotated[Proof, Shown("any passive hand")]
    min_ratio: Annotated[Number, Shown("least {coupled} / R", "at {worst_hz} Hz")]
    worst_hz: Number
    boxes: int

    promise: ClassVar[str] = f"in any passive hand, {ENVIRONMENTS}, at every frequency"


class CertificateRecord(DisplayPart):
    """What is proved of absolute stability and of the velocity loop."""

    verdict: Annotated[Proof, Shown("verdict", "{boxes} boxes")]
    band_hz: Annotated[Pair | None, Shown("band", "Hz")]
    proved_band_hz: Annotated[Pair | None, Shown("proved band", "Hz{beyond}")]
    proved_ratio: Number
    min_ratio: Annotated[Number, Shown("least {coupled} / R", "at {worst_hz} Hz")]
    worst_hz: Number
    rollett_k: Annotated[Number, Shown("Rollett's K there", digits=6, detail=True)]
    boxes: int
    claims: list[ClaimRecord]
    without_operator: WithoutOperatorRecord | None = None
    hands: HandsRecord | None = None
    any_hand: AnyHandRecord | None = None

    @property
    def beyond(self) -> str:
        """What holds outside the proved band, where there is one."""
        return "" if self.proved_band_hz is None else "; outside it nothing is proved of the ratio"

    def rows(self, units: Units) -> Iterator[Row]:
        """Yield what is shown of it, and the claims that are not proved; rows of a band only where there is one."""
        shown = list(super().rows(units))
        yield from shown if self.band_hz is not None else shown[:1]
        yield from self.any_hand.rows(units) if self.any_hand else ()
        yield from self.without_operator.rows(units) if self.without_operator else ()
        yield from self.hands.rows(units) if self.hands else ()
        for claim in self.claims:
            yield from claim.rows(units) if claim.verdict != "proved" else ()


class NyquistRecord(Part):
    """Nyquist's count of the sampled loop."""

    N: int | None
    P: int
    Z: Annotated[
        int | None,
        Shown(
            "Z = N + P, unstable poles",
            "N = {N} encirclements of -1, P = {P} in the open loop",
            detail=True,
        ),
    ]


class InnerLoopRecord(Part):
    """The sampled velocity loop."""

    stable: bool | None
    spectral_radius: Annotated[Number, Shown("spectral radius", "{stability}")]
    peak_sensitivity: Annotated[Number, Shown("peak |S|", "at {peak_sensitivity_hz} Hz")]
    peak_sensitivity_hz: Number
    gain_margin_db: Annotated[Number, Shown("gain margin", "dB")]
    phase_margin_deg: Annotated[Number, Shown("phase margin", "deg")]
    delay_margin_s: Annotated[Number, Shown("delay margin", "s")]
    nyquist: NyquistRecord

    def rows(self, units: Units) -> Iterator[Row]:
        """Yield what is shown of it and of Nyquist's count."""
        yield from super().rows(units)
        yield from self.nyquist.rows(units)

    @property
    def stability(self) -> str:
        """Whether it is proved stable."""
        return {True: "stable", False: "unstable", None: "undecided"}[self.stable]


class ActiveRecord(Part):
    """A demand that holds the design: where, on which device, and at which price."""

    demand: str
    hz: Number
    multiplier: float
    device: DeviceRecord | None = None


class RepairRecord(Part):
    """A change of one number of the problem file after which there is a design."""

    key: str
    old: Number
    new: Number
    change: str
    needs: str
    size: Number = None
    error: Number


class AlternativeRecord(Part):
    """The error of a certified design under one criterion alone."""

    criterion: Literal["passive", "hands"]
    error: float
    stiffness: float | None = None


class GlanceRecord(Part):
    """The search for a bound at one moment."""

    boxes: int
    lower_bound: Number
    error: Number
    open: int


class BoxRecord(Part):
    """A box of gains and couplings."""

    low: Four
    high: Four


class OptimalityRecord(Part):
    """What is proved of the error of every admissible design, of `terms` alone where the others never differ."""

    lower_bound: Annotated[Number, Shown("lower bound", "{verdict}, {boxes} boxes")]
    gap: Annotated[Number, Shown("gap", "%", 3, scale=100, optional=True)]
    verdict: Literal["proved", "open"]
    boxes: int
    terms: list[TermName] | None = None
    history: Annotated[list[GlanceRecord], Field(min_length=1)]
    open: list[BoxRecord]

    def rows(self, units: Units) -> Iterator[Row]:
        """Yield what the bound is of, where that is not all of the error."""
        if self.terms is not None:
            yield Row(self.of, text(self.history[-1].error), "in which designs differ")
        yield from super().rows(units)

    @property
    def of(self) -> str:
        """What the bound is of."""
        return "transparency error" if self.terms is None else f"error of {' and '.join(self.terms)}"


class UncertaintyRecord(Part):
    """What the design comes to on the devices of its box, and what certainty would be worth."""

    box: dict[str, Pair]
    unmodelled: list[list[float]] = Field(default_factory=list)
    objective: str
    nominal_error: Annotated[Number, Shown("error if certain", "of the best design", optional=True)]
    robust_error: Number
    worst_error: Annotated[Number, Shown("worst error", "at {worst_device}")]
    worst_device: DeviceRecord
    min_ratio_device: DeviceRecord

    def rows(self, units: Units) -> Iterator[Row]:
        """Yield the box, the device on which Re Z_c / R is least, and the errors."""
        for name, ends in self.box.items():
            shown = how_shown(DeviceRecord).get(name)
            yield Row(name, text(ends), units.of(shown.of) if shown else "")
        if self.unmodelled:
            radii = [radius for _, radius in self.unmodelled]
            yield Row("unmodelled, r", text([min(radii), max(radii)]), "")
        yield Row("least ratio at", "", self.min_ratio_device.in_words(units))
        yield from super().rows(units)


class DesignRecord(Document):
    """What came of a problem, in SI units and hertz: the object of design.json."""

    SCHEMA = "vctune/design/1"
    GROUPS: ClassVar[dict[str, str]] = {
        "gains": "gains",
        "coupling": "coupling",
        "transparency": "transparency",
        "certificate": "certificate",
        "uncertainty": "uncertainty",
        "optimality": "optimality",
        "inner_loop": "velocity loop",
    }
    """The parts that are shown as rows, in their order, and what they are called."""

    problem: ProblemRecord
    status: Literal["certified", "violated", "undecided", "infeasible"]
    reason: str | None
    gains: GainsRecord | None
    coupling: AnyCouplingRecord | None
    transparency: TransparencyRecord | None
    certificate: CertificateRecord | None
    inner_loop: InnerLoopRecord | None
    active: list[ActiveRecord]
    proved: bool | None = None
    idle: bool = False
    repairs: list[RepairRecord] | None = None
    prices: list[PriceRecord] | None = None
    alternatives: list[AlternativeRecord] | None = None
    at_bound: list[str]
    left_out: list[str]
    warnings: list[str]
    solver: dict[str, Any] = Field(default_factory=dict)
    optimality: OptimalityRecord | None = None
    versions: dict[str, str | None]
    date: str | None = None
    uncertainty: UncertaintyRecord | None = None

    @model_validator(mode="after")
    def _whole(self) -> DesignRecord:
        judged = (self.coupling, self.transparency, self.certificate, self.inner_loop)
        if any((part is None) != (self.gains is None) for part in judged):
            raise ValueError(
                "gains, coupling, transparency, certificate and inner_loop must be there, or null, together"
            )
        return self

    @property
    def units(self) -> Units:
        """Of everything in it."""
        return UNITS[self.problem.units]

    @property
    def promise(self) -> str:
        """What is proved of the design, in words; nothing where it is not certified."""
        if self.certificate is None or self.status != "certified":
            return ""
        known = " without what is not modelled" if self.uncertainty is not None and self.uncertainty.unmodelled else ""
        hands = [f"stable{known} {self.certificate.hands.promise(self.units)}"] if self.certificate.hands else []
        band = self.certificate.band_hz
        place = (
            None if band is None else f"from {text(band[0])} to {text(band[1])} Hz, as far as the frequency model goes"
        )
        passive = [f"absolutely stable in any passive hand {place}"] if place else []
        if self.certificate.any_hand:
            passive = [f"stable{known} {self.certificate.any_hand.promise}"]
        return "; ".join([*hands, *passive])

    @property
    def compared(self) -> list[str]:
        """What either criterion alone would allow."""
        if not self.alternatives or self.transparency is None:
            return []
        error = text(self.transparency.error, 3)
        found = []
        for each in self.alternatives:
            line = f'with criterion = "{each.criterion}" alone: error {text(each.error, 3)} instead of {error}'
            if each.stiffness is not None and isinstance(self.coupling, SpringRecord):
                line += f", k_c {text(each.stiffness, 4)} instead of {text(self.coupling.stiffness, 4)} "
                line += self.units.stiffness
            found.append(line)
        return found

    @property
    def design(self) -> tuple[Gains, AnyCoupling] | None:
        """Gains and coupling; None if there is no design."""
        return None if self.gains is None or self.coupling is None else (self.gains.plain, self.coupling.plain)

    def groups(self) -> dict[str, list[Row]]:
        """Return the rows of a design by group; none where there is no design."""
        if self.gains is None:
            return {}
        parts = {title: getattr(self, name) for name, title in self.GROUPS.items()}
        found = {title: list(part.rows(self.units)) for title, part in parts.items() if part is not None}
        if isinstance(self.coupling, SpringRecord):  # which has no K_p
            found["gains"] = found["gains"][:1]
        return found
