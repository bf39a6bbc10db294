"""The latency of a servo, the drag that contacts require of it, and the stiffest contact that its design permits."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, replace
from math import floor, inf, isclose, log10
from typing import Annotated, Any, Literal

from pydantic import Field

from vctune.analysis.contact import drag_at_rest, greatest_drag, stiffest_contact
from vctune.design.judging.judge import Judgement, Status, certified
from vctune.document.records.part import Nullable, RecordPart, Row, how_shown, text
from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.fields import Shown
from vctune.model.hands import Hand, Hands
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.units import Units, finite_hertz
from vctune.model.problem import Problem
from vctune.model.servo import latency, latency_parts
from vctune.proof.outcome import Verdict

CONTACT = "the stiffest contact"  # Name of a part that a time limit may leave out
RESERVE = 1e-3  # Relative distance between the stiffest contact in double precision and the contact that vctune proves
DIGITS = 4  # Number of significant digits of the stiffest contact


class LatencyPartRecord(RecordPart):
    """A part of the latency: its name, its key, its length, s, and the drag that it requires at rest, N s/m."""

    part: str
    key: str
    latency_s: float
    drag: Nullable = None  # absent before environments of limited mass, which require none


class ContactRecord(RecordPart):
    """The drag that contacts require on a servo, and the stiffest contact that the coupling allows."""

    stiffness: float
    safety_factor: float
    parts: Annotated[list[LatencyPartRecord], Field(min_length=1)]  # parts of the latency, and their sum
    latency_s: Annotated[float, Shown("latency L", "ms", scale=1e3)]
    # drags that the hands require; absent before environments of limited mass, which require none
    rest_drag: Annotated[Nullable, Shown("least drag at rest", of="damping", optional=True)] = None
    drag_alone: Annotated[Nullable, Shown("least drag without b_c", of="damping", optional=True)] = None
    drag_alone_hz: Nullable = None
    drag_alone_hand: Hand | None = None
    stiffest_contact: Annotated[Nullable, Shown("stiffest contact", digits=7, of="stiffness")]
    stiffest_contact_verdict: Literal["proved", "undecided"] | None
    own_spring: float = 0.0

    def rows(self, units: Units) -> Iterator[Row]:
        """Yield the rows, each with its condition."""
        details = self._details(units)
        shown = [name for name in how_shown(type(self)) if name in details]
        for name, row in zip(shown, super().rows(units), strict=True):
            yield row._replace(unit=f"{row.unit if row.value != 'none' else ''}{details[name]}")

    def _details(self, units: Units) -> dict[str, str]:
        """Return the text beside the number of each row, by the name of its field."""
        parts = " + ".join(f"{part.part} {text(1e3 * part.latency_s, 4)}" for part in self.parts)
        contacts = f"contacts up to {text(self.stiffness, 7)} {units.stiffness}"
        bears = f", {self.stiffest_contact_verdict} with this coupling"
        if self.stiffest_contact is None:
            bears = "even the softest hands require more than this coupling offers"
        found = {"latency_s": f" = {parts}", "stiffest_contact": bears}
        if self.drag_alone_hand is None or self.rest_drag is None:
            return found
        worst = f"at {text(self.drag_alone_hz)} Hz in the hand of {self.drag_alone_hand.in_words(units)}"
        return found | {"rest_drag": f" for {contacts}: {self.rule(self.rest_drag)}", "drag_alone": f", {worst}"}

    def rule(self, rest_drag: float) -> str:
        """Return the formula for the least drag at rest, in words."""
        of_springs = self.safety_factor * self.stiffness * self.latency_s + self.own_spring
        rule = f"{text(self.safety_factor)} K L{' and the drag of the own spring' if self.own_spring else ''}"
        if isclose(rest_drag, of_springs, rel_tol=1e-6):
            return rule
        less = rest_drag < of_springs
        return f"{rule} {'less the damping of every hand' if less else 'and the part of unmodelled dynamics'}"


def contact_record(problem: Problem, judgement: Judgement) -> ContactRecord | None:
    """Return the latency of a servo, the drag that contacts require of it, and the stiffest contact of a design; None
    for other displays. Before environments of limited mass no drag is required, since a mass may take its place."""
    hands, worlds = problem.hands_met, problem.worlds
    if problem.device.servo is None or hands is None:
        return None
    devices = list(dict.fromkeys(case.device.modelled for case in judgement.posed.hand_cases))
    factor, K = problem.stability.safety_factor, hands.high.stiffness
    slowest = max(devices, key=_latency)
    parts = {name: seconds for name, seconds in asdict(latency(slowest, FLOATS)).items() if seconds > 0}
    bears = stiffest_contact(devices, hands, judgement.coupling, factor, worlds)
    stiffest, verdict = _stiffest(problem, judgement, hands, bears)
    drags: dict[str, Any] = {}
    if worlds is None or worlds.high.mass == inf:
        most = greatest_drag(devices, hands)
        drags = {
            "rest_drag": factor * drag_at_rest(devices, hands),
            "drag_alone": factor * most.drag,
            "drag_alone_hz": finite_hertz(most.omega),
            "drag_alone_hand": most.hand,
            "own_spring": factor * _own_spring(slowest),
        }
    return ContactRecord(
        stiffness=K,
        safety_factor=factor,
        parts=[
            LatencyPartRecord(
                part=part.label, key=part.key, latency_s=seconds, **({"drag": factor * K * seconds} if drags else {})
            )
            for part, seconds in ((latency_parts(slowest)[name], seconds) for name, seconds in parts.items())
        ],
        latency_s=_latency(slowest),
        stiffest_contact=stiffest,
        stiffest_contact_verdict=verdict,
        **drags,
    )


def _latency(device: Device) -> float:
    return float(latency(device, FLOATS).total)


def _own_spring(device: Device) -> float:
    """Return the drag at rest that the firmware's own spring requires: its stiffness times the latency, N s/m."""
    assert device.servo is not None
    return (device.servo.stiffness or 0.0) * _latency(device.sensing_at_once)


def _stiffest(
    problem: Problem, judgement: Judgement, hands: Hands, bears: float
) -> tuple[float | None, Literal["proved", "undecided"] | None]:
    """Return the stiffest contact, rounded, and whether it is proved; None if no contact is permitted."""
    if judgement.status is Status.CERTIFIED and (bears == inf or _floored(bears) <= hands.high.stiffness):
        return hands.high.stiffness, "proved"
    stiffest = _floored(bears)
    if bears == inf or stiffest <= hands.low.stiffness:
        return None, None
    posed = judgement.posed
    softer = Hands(hands.low, replace(hands.high, stiffness=stiffest))
    design = Design(posed.demands.device, judgement.gains, judgement.coupling)
    worlds = judgement.certificate.demands.worlds
    found = certified(design, replace(posed.demands, hands=softer, worlds=worlds), posed.box)
    return stiffest, "proved" if found.verdict is Verdict.PROVED else "undecided"


def _floored(stiffness: float) -> float:
    """Return a stiffness, reduced by the share `RESERVE` and rounded down to `DIGITS` digits."""
    reserved = stiffness * (1 - RESERVE)
    if not 0 < reserved < inf:
        return reserved
    unit = 10.0 ** (floor(log10(reserved)) + 1 - DIGITS)
    return float(f"{floor(reserved / unit) * unit:.{DIGITS}g}")
