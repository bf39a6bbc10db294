"""The prover of each claim of a certificate: a table of functions by the claim's identifier."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial

from vctune.model.device import Device
from vctune.model.gains import Gains
from vctune.model.problem import Demands
from vctune.proof.claims.every_device import (
    NominalProof,
    RobustDesign,
    prove_conditions_for_all,
    prove_model_poles_for_all,
    prove_sampled_poles_for_all,
    prove_sensitivity_for_all,
    prove_unmodelled,
)
from vctune.proof.claims.every_hand import prove_any_hand, prove_hands
from vctune.proof.claims.llewellyn.conditions import conditions_at, prove_conditions
from vctune.proof.claims.margins_of_claims import Design
from vctune.proof.claims.model_poles import prove_model_poles
from vctune.proof.claims.registry import ClaimId
from vctune.proof.claims.sampled_poles import prove_sampled_poles, prove_sensitivity, unmodelled_at
from vctune.proof.device_box import DeviceBox
from vctune.proof.engine.interval import Outcome, Verdict

# Greatest product of the multiplier's corner, rad/s, and T; above 2 the multiplier's coefficient a is negative
HIGHEST_CORNER = 2 * (1 - 1e-9)


@dataclass(frozen=True, slots=True)
class Question:
    """The data for the proof of a claim."""

    design: Design  # design with plain numbers
    demands: Demands  # the constraints on the design
    box: DeviceBox | None = None  # box of devices for which the claim is to be proved; None for the design's own device

    @property
    def modelled(self) -> Question:
        """The same question without unmodelled dynamics: each device has its nominal response."""
        return replace(self, box=self.box and self.box.modelled)

    @property
    def robust(self) -> RobustDesign | None:
        """The design with its box of devices; None for a single device, or if there are neither feedback nor unmodelled
        dynamics."""
        if self.box is None or not self.box.uncertain:
            return None
        alike = not self.design.gains.closed and self.box.nominal.unmodelled is None
        return None if alike else RobustDesign(self.design, self.box, self.demands)


Outcomes = Mapping[ClaimId, Outcome]
# A function that proves a claim; its arguments are the question and the outcomes of the claims before it
Prover = Callable[[Question, Outcomes], Outcome]


def prove_passive(question: Question) -> Outcome:
    """Prove Llewellyn's conditions on the band, for every device of the box."""
    (low, high), factor = question.demands.band, question.demands.factor
    alone = partial(prove_conditions, low=low, high=high, factor=factor)
    return _for_every_device(question, alone, prove_conditions_for_all, partial(conditions_at, factor=factor))


def _sensitivity(question: Question, _known: Outcomes) -> Outcome:
    limit = question.demands.max_sensitivity
    return _for_every_device(question.modelled, lambda d: prove_sensitivity(d, limit), prove_sensitivity_for_all)


def _stable_model(question: Question, _known: Outcomes) -> Outcome:
    alone = partial(_of_every_loop, prove_model_poles)
    return _for_every_device(question.modelled, alone, prove_model_poles_for_all)


def _stable(question: Question, _known: Outcomes) -> Outcome:
    alone = partial(_of_every_loop, prove_sampled_poles)
    return _for_every_device(question.modelled, alone, prove_sampled_poles_for_all)


def _unmodelled(question: Question, known: Outcomes) -> Outcome:
    """Prove that no response in the discs around the responses of a box makes the loop unstable."""
    design, box, demands = question.design, question.box, question.demands
    assert box is not None and box.nominal.unmodelled is not None
    radii, bounded = box.nominal.unmodelled.radii, known["sensitivity"].verdict is Verdict.PROVED
    greatest, limit = (Fraction(str(x)) for x in (max(radius for _, radius in radii), demands.max_sensitivity))
    if not design.gains.closed or (bounded and greatest * (1 + limit) < 1):
        return Outcome(Verdict.PROVED, 1)

    def alone(device: Device, theta: float) -> Outcome:
        return unmodelled_at(device, design.gains, radii, theta)

    return prove_unmodelled(RobustDesign(design, box, demands), alone)


def _any_hand(question: Question, _known: Outcomes) -> Outcome:
    return prove_any_hand(question.design, question.demands, question.box)


def _hands(question: Question, _known: Outcomes) -> Outcome:
    demands = question.demands
    return prove_hands(question.design, replace(demands, worlds=demands.worlds and demands.worlds.linear), question.box)


def _walls(question: Question, known: Outcomes) -> Outcome:
    """Prove the condition of walls. The condition implies stability only for loops that are stable with the linear
    environments."""
    worlds, device = question.demands.worlds, question.design.device
    usable = worlds is not None and worlds.corner is not None and worlds.corner * device.sample_time < HIGHEST_CORNER
    if not usable or known["worlds"].verdict is not Verdict.PROVED:
        return Outcome(Verdict.UNDECIDED, 0)
    return prove_hands(question.design, question.demands, question.box)


# The prover of each claim
PROVERS: dict[ClaimId, Prover] = {
    "passive": lambda question, _: prove_passive(question),
    "sensitivity": _sensitivity,
    "stable_model": _stable_model,
    "stable": _stable,
    "unmodelled": _unmodelled,
    "any_hand": _any_hand,
    "hands": _hands,
    "worlds": _hands,
    "walls": _walls,
}


def _of_every_loop(prove_poles: Callable[[Device, Gains], Outcome], design: Design) -> Outcome:
    """Prove that the poles are stable for the device without a hand and in the hand of its least operator."""
    boxes = 0
    for device in design.device.loops:
        outcome = prove_poles(device, design.gains)
        boxes += outcome.boxes
        if outcome.verdict is not Verdict.PROVED:
            break
    return replace(outcome, boxes=boxes)


def _for_every_device(
    question: Question,
    alone: Callable[[Design], Outcome],
    for_all: Callable[[RobustDesign, NominalProof], Outcome],
    in_doubt: Callable[..., Outcome] | None = None,
) -> Outcome:
    """Prove a claim for the design's own device, and then for every device of the box."""
    nominal, robust = alone(question.design), question.robust
    if robust is None or nominal.verdict is not Verdict.PROVED:
        return nominal

    def one(device: Device, omega: float) -> Outcome:
        there = replace(question.design, device=device)
        if in_doubt is not None and device.unmodelled is not None:
            return in_doubt(there, omega=omega)
        return alone(there)

    outcome = for_all(robust, one)
    return replace(outcome, boxes=nominal.boxes + outcome.boxes)
