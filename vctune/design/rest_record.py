"""Record what a device does at rest: whether its friction holds it, and what the steps of its readings cause."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from vctune.analysis.chatter import Caused, Reading, caused_by, encountered
from vctune.design.judging.judge import Judgement
from vctune.document.records.felt_json import ChatterRecord, RestRecord
from vctune.document.records.rows_json import ChatterColumns
from vctune.document.records.shake_json import BuzzRecord
from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.hands import Hand, Hands
from vctune.model.problem import Problem
from vctune.model.rest import read_in_steps, rests, settles, step_of_damper, stiffness_read
from vctune.proof.claims.any_hand import WALL_IN_ANY_HAND
from vctune.proof.claims.rest import RESTS
from vctune.proof.outcome import Verdict

REST = "the chatter at rest"  # Name of a part that a time limit may leave out
# Shares of the range of stiffness, with which the hardest vertex is softened: the worst spring lies inside the range
SOFTER = (0.001, 0.01, 0.03, 0.1, 0.3, 0.6)
AT_THE_PORT = WALL_IN_ANY_HAND.id  # The claim that the port of the handle is passive, its errors apart


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


def hands_at_rest(problem: Problem) -> Hands:
    """Return the hands in which the chatter is taken: those of [operator], or the least operator of a problem that asks
    for no box of hands."""
    if problem.stability.criterion != "passive":
        return problem.hands
    least = problem.device.operator
    alone = Hand(0.0, 0.0, 0.0) if least is None else Hand(least.mass, least.damping, 0.0)
    return Hands(alone, alone)
