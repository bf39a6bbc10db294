"""The prover of each claim of a certificate: a table of functions by the claim's identifier."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction

from vctune.model.problem import Demands
from vctune.proof.claims.every_hand import prove_any_hand, prove_hands
from vctune.proof.claims.loop_claims import (
    prove_conditions,
    prove_model_poles,
    prove_sampled_poles,
    prove_sensitivity,
    prove_unmodelled,
)
from vctune.proof.claims.margins_of_claims import Design
from vctune.proof.claims.registry import ClaimId
from vctune.proof.device_box import DeviceBox
from vctune.proof.outcome import Outcome, Verdict

# Greatest product of the multiplier's corner, rad/s, and T; above 2 the multiplier's coefficient a is negative
HIGHEST_CORNER = 2 * (1 - 1e-9)


@dataclass(frozen=True, slots=True)
class Question:
    """The data for the proof of a claim."""

    design: Design  # design with plain numbers
    demands: Demands  # the constraints on the design
    box: DeviceBox | None = None  # box of devices for which the claim is to be proved; None for the design's own device

    @property
    def covered(self) -> DeviceBox | None:
        """The devices for which the conditions on the band differ; without gains and unmodelled dynamics none does."""
        alike = self.box is not None and not self.design.gains.closed and self.box.nominal.unmodelled is None
        return None if alike else self.box

    @property
    def modelled(self) -> tuple[Design, Demands, DeviceBox | None]:
        """The same data without unmodelled dynamics: each device has its nominal response."""
        return self.design, self.demands, self.covered and self.covered.modelled


Outcomes = Mapping[ClaimId, Outcome]
# A function that proves a claim; its arguments are the question and the outcomes of the claims before it
Prover = Callable[[Question, Outcomes], Outcome]


def _unmodelled(question: Question, known: Outcomes) -> Outcome:
    """Prove that no response in the discs around the responses of a box makes the loop unstable."""
    design, box, demands = question.design, question.box, question.demands
    assert box is not None and box.nominal.unmodelled is not None
    radii, bounded = box.nominal.unmodelled.radii, known["sensitivity"].verdict is Verdict.PROVED
    greatest, limit = (Fraction(str(x)) for x in (max(radius for _, radius in radii), demands.max_sensitivity))
    if not design.gains.closed or (bounded and greatest * (1 + limit) < 1):
        return Outcome(Verdict.PROVED, 1)
    return prove_unmodelled(design, demands, box)


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
    "passive": lambda question, _: prove_conditions(question.design, question.demands, question.covered),
    "sensitivity": lambda question, _: prove_sensitivity(*question.modelled),
    "stable_model": lambda question, _: prove_model_poles(*question.modelled),
    "stable": lambda question, _: prove_sampled_poles(*question.modelled),
    "unmodelled": _unmodelled,
    "any_hand": lambda question, _: prove_any_hand(question.design, question.demands, question.box),
    "hands": _hands,
    "worlds": _hands,
    "walls": _walls,
}
