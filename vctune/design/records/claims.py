"""The claims about a design: the verdict of each, where its margin is least, and its words."""

from collections.abc import Callable, Iterator
from dataclasses import asdict
from math import degrees, inf, radians
from typing import Annotated, Any

from pydantic import Field

from vctune.analysis.in_worlds import binding_world
from vctune.design.judging.judge import Judgement, LeastRatio
from vctune.document.records.part import GRAMS, DisplayPart, Nullable, Pair, Proof, RecordPart, Row, how_shown, text
from vctune.model.device import Device
from vctune.model.display import ADMITTANCE
from vctune.model.fields import Shown
from vctune.model.hands import Hand, Hands
from vctune.model.numbers.units import Units, finite_hertz, hertz, in_full
from vctune.model.parts import Unmodelled
from vctune.model.problem import Problem
from vctune.model.servo import numbers_to_state
from vctune.model.worlds import OVER_LIMIT, World, Worlds
from vctune.proof.claims.any_hand import ANY_HAND
from vctune.proof.claims.claim import ClaimId
from vctune.proof.claims.registry import BEFORE_WALL, CLAIMS, IN_HANDS
from vctune.proof.claims.walls import WALLS
from vctune.proof.outcome import Outcome

ENVIRONMENTS = "with every environment that is passive as the firmware runs it"


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
        if self.min_ratio == 0:
            yield Row(limit.label, "any", f"multiple of the wall{hand}: more damping is needed")
        else:
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


def claim_records(problem: Problem, judgement: Judgement) -> list[ClaimRecord]:
    """Return the record of each claim."""
    found = []
    for claim, outcome in judgement.certificate.outcomes.items():
        device = None if outcome.device is None else device_record(outcome.device, problem, changed=True)
        also = {"cut": outcome.cut or None, "witness_device": device, "witness_hand": outcome.hand}
        said, witness = CLAIMS[claim].said_of(problem.device.kind, problem.passive_hand), finite_hertz(outcome.witness)
        more: dict[str, Any] = present(also)
        found.append(ClaimRecord(id=claim, claim=said, verdict=outcome.verdict.value, witness_hz=witness, **more))
    return found


def present(parts: dict[str, Any]) -> dict[str, Any]:
    """Return the parts that exist: a record does not write the others."""
    return {name: part for name, part in parts.items() if part is not None}


def display_of(problem: Problem) -> dict[str, Any]:
    """Return the record of the kind of display; empty for an admittance display."""
    return {"display": problem.device.display} if problem.device.kind is not ADMITTANCE else {}


def _claimed(problem: Problem, outcome: Outcome, at: LeastRatio) -> dict[str, Any]:
    """Return what the records of all claims in hands state."""
    found = {"verdict": outcome.verdict.value, "boxes": outcome.boxes, **display_of(problem)}
    return {**found, "min_ratio": at.ratio, "worst_hz": finite_hertz(at.omega)}


def any_hand_record(problem: Problem, judgement: Judgement) -> AnyHandRecord | None:
    """Return the record of the claim in any passive hand; None if the problem does not make this claim."""
    if (at := judgement.in_any_hand) is None:
        return None
    return AnyHandRecord(**_claimed(problem, judgement.certificate.outcomes[ANY_HAND.id], at))


def hands_record(problem: Problem, judgement: Judgement) -> HandsRecord | None:
    """Return the record of the claim in a box of hands; None if the problem does not make this claim."""
    held, hands, worlds = judgement.in_hand, problem.hands, problem.worlds
    if held is None or held.hand is None or problem.hands_met is None:
        return None
    outcomes, also = judgement.certificate.outcomes, dict[str, Any]()
    if worlds is not None:
        low, high = asdict(worlds.low), asdict(worlds.high)
        also["worlds"] = {name: [low[name], high[name]] for name in low}
    device = held.device if held is judgement.binding else problem.device
    law, factor = (judgement.gains, judgement.coupling), problem.stability.safety_factor
    if (
        not (worlds and worlds.nothing)
        and (world := binding_world(device, *law, held.hand, held.omega, factor, worlds)) is not None
    ):
        also["worst_world"] = WorldRecord(mass=world.mass, stiffness=world.stiffness)
    if (walls := judgement.in_walls) is not None and (corner := judgement.corner) is not None:
        claimed = _claimed(problem, outcomes[WALLS.id], walls) | {"worst_hand": walls.hand}
        also["walls"] = WallsRecord(**claimed, corner_hz=hertz(corner))
    outcome = next(outcomes[claim] for claim in IN_HANDS if claim in outcomes)
    return HandsRecord(**_claimed(problem, outcome, held), **_boxes(hands), worst_hand=held.hand, **also)


def _boxes(hands: Hands) -> dict[str, Any]:
    """Return the ends of the ranges of hands, and of the tool that they include."""
    both = {"box": hands} | ({} if hands.tool is None else {"tool": hands.tool})
    return {key: {name: list(ends) for name, ends in box.ranges.items()} for key, box in both.items()}


def wall_record(problem: Problem, judgement: Judgement) -> WallRecord | None:
    """Return the record of the coupling as a wall; None if it is none."""
    if (at := judgement.before_wall) is None:
        return None
    outcomes = judgement.certificate.outcomes
    outcome = next(outcomes[claim] for claim in BEFORE_WALL if claim in outcomes)
    also: dict[str, Any] = (_boxes(problem.hands) | {"worst_hand": at.hand}) if at.hand else {}
    loop = judgement.closed_loop
    return WallRecord(
        verdict=outcome.verdict.value,
        min_ratio=at.ratio,
        worst_hz=finite_hertz(at.omega),
        peak_sensitivity=None if loop is None else loop.peak,
        peak_sensitivity_hz=None if loop is None else hertz(loop.omega),
        phase_margin_deg=None if loop is None else degrees(loop.phase),
        boxes=outcome.boxes,
        **also,
    )


def device_record(device: Device, problem: Problem, *, changed: bool = False) -> DeviceRecord:
    """Return mass, damping and delay of a device, and its other parameters for which the problem states an uncertainty;
    if `changed`, also those that differ from the problem's."""
    uncertain = problem.uncertainty.keys if problem.uncertainty is not None else ()
    known, of_problem = numbers_to_state(device), numbers_to_state(problem.device)
    stated = {*uncertain, *(key for key in known if changed and known[key] != of_problem[key])}
    others = {key: number for key, number in known.items() if "." in key and key in stated}
    found: dict[str, Any] = {"parts": others} if others else {}
    if device.unmodelled is not None and device.unmodelled.share > 0:
        share, phase = float(device.unmodelled.share), degrees(device.unmodelled.phase)
        found["unmodelled"] = PerturbationRecord(share=share, phase_deg=phase)
    own = {key: known[key] for key in ("mass", "damping", "delay") if key in known}
    return DeviceRecord(**own, **found)
