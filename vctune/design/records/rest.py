"""What a device does at rest: whether its friction holds it, and what the steps of its readings cause."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated, Any, Literal

from vctune.analysis.chatter import Caused, Reading, caused_by, encountered
from vctune.design.judging.judge import Judgement
from vctune.design.judging.kicked import hands_at_rest
from vctune.design.records.shake import BuzzRecord
from vctune.document.records.part import Nullable, RecordPart, Row, milli, text
from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.fields import Shown
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.hands import Hand, Hands
from vctune.model.numbers.units import Units
from vctune.model.problem import Problem
from vctune.model.rest import read_in_steps, rests, settles, step_of_damper, stiffness_read
from vctune.proof.claims.any_hand import WALL_IN_ANY_HAND
from vctune.proof.claims.rest import RESTS
from vctune.proof.outcome import Verdict

REST = "the chatter at rest"  # Name of a part that a time limit may leave out
# Shares of the range of stiffness, with which the hardest vertex is softened: the worst spring lies inside the range
SOFTER = (0.001, 0.01, 0.03, 0.1, 0.3, 0.6)
AT_THE_PORT = WALL_IN_ANY_HAND.id  # The claim that the port of the handle is passive, its errors apart


class ChatterRecord(RecordPart):
    """The most that the steps of a reading cause at rest, in the worst hand, without friction; null without a bound."""

    step: float  # m of the encoder, N of the force sensor
    chatter_m: Nullable = None  # half of what the handle moves, of a flexible one the motor, by the encoder
    chatter_m_s: Nullable = None  # half of what its velocity varies, by the force sensor
    chatter_N: Nullable = None  # half of what the motor's force varies
    hand: Hand
    before: str  # the environments of which it is the worst, in words

    @property
    def bounded(self) -> bool:
        """Whether a bound was found."""
        return any(bound is not None for bound in (self.chatter_m, self.chatter_m_s, self.chatter_N or None))

    def row(self, reading: str, units: Units) -> Row:
        """Return the bounds with their reading and hand."""
        of_encoder = reading == "encoder"
        value, unit = (self.chatter_m, units.position) if of_encoder else (self.chatter_m_s, units.speed)
        step = milli(self.step, units.position) if of_encoder else f"{text(self.step, 3)} {units.force}"
        bounds = [] if value is None else [milli(value, unit)]
        bounds += [f"{text(self.chatter_N, 3)} {units.force}"] if self.chatter_N else []
        value_text, _, rest = " and ".join(bounds).partition(" ")
        where = (
            f"from steps of {step} of the {reading}, in the hand of {self.hand.in_words(units)} before {self.before}"
        )
        slow = "; the motion dies away too slowly for a bound" if value is None else ""
        bound = f"{rest} {where}; a bound without friction, which ranks no designs{slow}".strip()
        return Row("chatter at most", value_text or "no bound found", bound)


class RestRecord(RecordPart):
    """What a device does at rest: whether its friction holds it between two readings, and what their steps cause."""

    spring: Literal["k_c", "K_p"] | None = None  # the stiffness that the read position drives
    step_N: Nullable = None  # greatest force of a step of the encoder, by the spring and by the damper
    damper_step_N: Nullable = None
    friction_N: Nullable = None
    rests: bool | None = None  # whether the friction holds the spring's step both ways; null if one is not known
    settles: bool | None = None  # true if every motion is proved to come to rest, false if a kick does not; else null
    encoder: ChatterRecord | None = None
    force_sensor: ChatterRecord | None = None

    @property
    def _moved_by_damper(self) -> bool:
        """Whether half of the spring's step and the damper's together exceed the friction."""
        return 0.5 * (self.step_N or 0.0) + (self.damper_step_N or 0.0) > (self.friction_N or 0.0)

    def sentences(self, units: Units) -> list[str]:
        """Return what is assumed of friction and steps, and what follows from it, for a reader of the firmware."""
        said = list[str]()
        if self.rests is not None and self.friction_N is not None:
            rests = "rests wherever it stops" if self.rests else "does not rest wherever it stops"
            friction = f"{text(self.friction_N, 6)} {units.force}"
            said.append(f"With dry friction of at least {friction}, on which no proof counts, it {rests}.")
        for reading, of in (("encoder", self.encoder), ("force sensor", self.force_sensor)):
            if of is not None:
                row = of.row(reading, units)
                bound = f"{row.value} {row.unit.partition(';')[0]}"
                said.append(
                    f"Computed, not proved: chatter at most {bound}."
                    if of.bounded
                    else f"No bound of the chatter was found {bound.partition('found ')[2]}."
                )
        return said

    def rows(self, units: Units) -> Iterator[Row]:
        """Yield whether it rests and whether it comes to rest, and the chatter, computed and not proved."""
        if self.rests is not None and self.step_N is not None and self.friction_N is not None:
            step, twice = text(self.step_N, 4), text(2 * self.friction_N, 4)
            verb = "is at most" if self.rests else "is more than"
            holds = f"{self.spring} q = {step} {units.force} {verb} twice the friction, {twice} {units.force}"
            yield Row("rests", "yes" if self.rests else "no", f"where it stops: {holds}")
        damper = f"the damper's {text(self.damper_step_N, 4)} {units.force} a step"
        if self.settles:
            yield Row("comes to rest", "yes", f"from every motion: the friction also holds {damper}")
        elif self.settles is False:
            yield Row("comes to rest", "no", "a kick keeps it moving")
        elif self.rests is not None:
            some = f": {damper} may keep it trembling within a step" if self._moved_by_damper else ""
            yield Row("comes to rest", "open", f"no kick keeps it moving, and it is not proved{some}")
        for reading, of in (("encoder", self.encoder), ("force sensor", self.force_sensor)):
            if of is not None:
                yield of.row(reading, units)


class ChatterColumns(RecordPart):
    """What a device does at rest, only if it states the step q of its encoder; null if the friction is not known."""

    rest_ratio: Annotated[Nullable, Shown("2 f/(k q), rests from 1 on")] = None
    chatter_m: Annotated[Nullable, Shown("chatter of the handle, at most", of="position")] = None
    chatter_N: Annotated[Nullable, Shown("chatter of the motor's force, at most", of="force")] = None


def rest_record(problem: Problem, judgement: Judgement, buzzes: BuzzRecord | None) -> RestRecord | None:
    """Return what a design does at rest, after kicks; None if no step of a reading is known."""
    device, gains, coupling = problem.device, judgement.gains, judgement.coupling
    q, q_f, f = read_in_steps(device), device.sensing.resolution, device.friction
    if q is None and q_f is None:
        return None
    outcomes, found = judgement.certificate.outcomes, dict[str, Any]()
    if q is not None:
        found["spring"] = "k_c" if device.kind.inverse else "K_p"
        found["step_N"] = stiffness_read(gains, coupling) * q
        found["damper_step_N"] = max(step_of_damper(each, gains, coupling) for each in _filters(judgement))
    if q is not None and f is not None:
        found |= {"friction_N": f, "rests": rests(Design(device, gains, coupling))}
        passive = AT_THE_PORT in outcomes and outcomes[AT_THE_PORT].verdict is Verdict.PROVED
        # a wall that counts on a least hand may not come to rest when it is let go
        if (
            passive
            and device.structure is None
            and device.operator is None
            and _settle(_filters(judgement), gains, coupling)
        ):
            found["settles"] = True
        elif buzzes is not None and buzzes.moving:
            found["settles"] = False
    if all(of.verdict is Verdict.PROVED for claim, of in outcomes.items() if claim != RESTS.id):
        found["encoder"] = _chatter("encoder", problem, judgement, q)
        found["force_sensor"] = _chatter("force sensor", problem, judgement, q_f)
    return RestRecord(**{name: value for name, value in found.items() if value is not None})


def _filters(judgement: Judgement) -> list[Device]:
    """Return the devices whose filters make the least and the most of a step: of an uncertain low-pass both ends,
    because what it makes of a step rises with its frequency."""
    box = judgement.posed.box
    filtered = box is not None and any(key.startswith("velocity.") for key in box.uncertain)
    return [box.low, box.high] if box is not None and filtered else [judgement.device]


def _settle(devices: list[Device], gains: Gains, coupling: AnyCoupling) -> bool:
    """Return whether every device comes to rest; before given sections two ends of a low-pass do not tell."""
    velocity = devices[0].velocity
    known = len(devices) == 1 or velocity is None or velocity.sections is None
    return known and all(settles(Design(device, gains, coupling)) for device in devices)


def chatter_columns(problem: Problem, judgement: Judgement) -> ChatterColumns:
    """Return what a sweep states of a design at rest."""
    record = rest_record(problem, judgement, None)
    if record is None or record.encoder is None:
        return ChatterColumns()
    step, friction = record.step_N, record.friction_N
    ratio = 2 * friction / step if step and friction is not None else None
    return ChatterColumns(rest_ratio=ratio, chatter_m=record.encoder.chatter_m, chatter_N=record.encoder.chatter_N)


def _chatter(reading: Reading, problem: Problem, judgement: Judgement, step: float | None) -> ChatterRecord | None:
    """Return the worst that the steps of a reading cause on any device of the problem, in any of its hands."""
    cases = judgement.posed.hand_cases or judgement.posed.cases
    devices = dict.fromkeys(case.device.undisturbed.bare for case in cases)
    law, boxed = (judgement.gains, judgement.coupling, encountered(problem)), hands_at_rest(problem)
    hardest = [at.hand for at in judgement.margins if at.hand is not None]
    each = list[Caused]()
    for device in devices if step is not None else ():
        worst = caused_by(reading, device, list(dict.fromkeys([*boxed.corners, *hardest])), *law)
        softer = caused_by(reading, device, [_with_share(worst.hand, boxed, share) for share in SOFTER], *law)
        each += [worst, softer]
    if step is None:
        return None
    found = max(each, key=lambda of: of.motion)
    moved = {"chatter_m" if reading == "encoder" else "chatter_m_s": found.motion}
    force = {} if problem.device.servo is not None else {"chatter_N": max(of.force for of in each)}
    return ChatterRecord(step=step, hand=found.hand, before=_in_words(problem), **moved, **force)


def _in_words(problem: Problem) -> str:
    """Return the environments of `encountered` in words."""
    if problem.rigid:
        return "a rigid world"
    return "nothing and a rigid world" if problem.worlds is None else "the least and the greatest environment"


def _with_share(hand: Hand, boxed: Hands, share: float) -> Hand:
    """Return a hand with a share of the range of stiffness."""
    low, high = boxed.low.stiffness, boxed.high.stiffness
    return replace(hand, stiffness=float(low + share * (high - low)))
