"""The certificate of a design: every claim with its verdict (proved, refuted or undecided). See proof/README.md,
section 1; document/README.md, section 3."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

from vctune.model.demands import Demands
from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.parts import DELAYS, LATENCY
from vctune.proof.claims.claim import ClaimId, Question, Suspects, no_suspects
from vctune.proof.claims.delays import beside_whole_sample, may_jump
from vctune.proof.claims.oblique import prove_together
from vctune.proof.claims.registry import claims_about, claims_asked
from vctune.proof.device_box import DeviceBox
from vctune.proof.outcome import Outcome, Verdict, worst_verdict
from vctune.running import OutOfTimeError, check_time, report_progress, reporting_progress

STABILITY = claims_about("poles", "unmodelled")  # Identifiers of the claims that the loop is stable
RATIOS = claims_about("ratio", "in_hand")  # Identifiers of the claims about Re Z_c / R


@dataclass(frozen=True, slots=True)
class Certificate:
    """The verdicts on the claims about a design.

    Attributes
    ----------
    design : Design
        The judged design.
    demands : Demands
        The constraints on the design.
    outcomes : dict[ClaimId, Outcome]
        Verdict, number of boxes and witness [rad/s] of each claim, by its identifier.
    without_factor : Outcome, optional
        Outcome of the claim `passive` with a factor of 1, if the prover did not prove it with the required
        factor; else None.
    box : DeviceBox, optional
        The box of devices that the claims cover; None for the design's own device.
    beside : tuple[Certificate, ...]
        Certificates of the same design at the delays on both sides of a whole sample; for each claim,
        `outcomes` contains the worst outcome among these certificates and the design's own.
    """

    design: Design
    demands: Demands
    outcomes: dict[ClaimId, Outcome]
    without_factor: Outcome | None = None
    box: DeviceBox | None = None
    beside: tuple[Certificate, ...] = ()

    @property
    def verdict(self) -> Verdict:
        """The worst verdict among the claims."""
        return worst_verdict(outcome.verdict for outcome in self.outcomes.values())

    @property
    def cut(self) -> bool:
        """Whether the time limit ended one of the proofs."""
        return any(outcome.cut for outcome in self.outcomes.values())

    @property
    def boxes(self) -> int:
        """Number of boxes that the proofs of all claims evaluated."""
        return sum(outcome.boxes for outcome in self.outcomes.values())

    @property
    def proved_ratio(self) -> float | None:
        """A proved lower bound of Re Z_c / R on the band, for a stable loop: the required ratio, or 1 if only the claim
        without the factor is proved; None without a proof."""
        stability = (self.outcomes[claim] for claim in STABILITY if claim in self.outcomes)
        if any(outcome.verdict is not Verdict.PROVED for outcome in stability):
            return None
        if all(self.outcomes[claim].verdict is Verdict.PROVED for claim in RATIOS if claim in self.outcomes):
            return self.demands.factor
        return 1.0 if self.without_factor and self.without_factor.verdict is Verdict.PROVED else None


def certify(
    design: Design,
    demands: Demands,
    box: DeviceBox | None = None,
    suspects: Suspects = no_suspects,
    ringing: Suspects = no_suspects,
) -> Certificate:
    """Prove that a design meets its constraints (proof/README.md).

    A float stands for the decimal that it prints as: 0.4 means 2/5.


    Parameters
    ----------
    design : Design
        Device, gains and coupling, in SI units.
    demands : Demands
        Constraints on the design's device; the band may be (0, inf) for hold "lag" without delay.
    box : DeviceBox, optional
        Box of devices around the design's own device; the prover proves each claim for all of them; None for
        the design's own device.
    suspects : Suspects
        Function that says where to look for a failure in hands (`vctune.analysis.worst_hand.suspects`). A claim
        that it shows to fail is refuted by a proof; without it such a claim may stay undecided.
    ringing : Suspects
        Function that says in which hands the loop seems to be damped less than is demanded
        (`vctune.simulation.rings.least_damped_hand`).

    Returns
    -------
    Certificate
        Each claim is proved, refuted or undecided. A claim is undecided if the time limit ends before its proof. Near a
        whole number of samples of delay the sensed force may jump. A claim is then proved only if it also holds on both
        sides of that number.
    """
    question = Question(design, demands, box, suspects, ringing)
    own, beside = _certificate(question), _beside(question)
    return _holding_beside(own, [_certificate(each) for each in beside]) if beside else own


def together(axes: Sequence[Question]) -> Outcome:
    """Prove that axes of one servo, each of which is proved alone, are stable together in hands at any angle, also at
    the delays beside a whole sample."""
    found = _in_time(partial(prove_together, axes))
    for beside in zip(*map(_beside, axes), strict=True):
        found = _worse(found, _in_time(partial(prove_together, beside)), beside[0].design.device)
    return found


def _certificate(question: Question) -> Certificate:
    design, demands, box = question.design, question.demands, question.box
    outcomes: dict[ClaimId, Outcome] = {}
    with reporting_progress():
        asked = claims_asked(demands, box)
        for number, claim in enumerate(asked, 1):
            report_progress(partial("claim {} of {}".format, number, len(asked)))
            outcomes[claim.id] = _in_time(partial(claim.prove, question, outcomes))
        on_band = next((claim for claim in asked if claim.quantity == "ratio"), None)
        missed = demands.factor > 1 and on_band is not None and outcomes[on_band.id].verdict is not Verdict.PROVED
        less = replace(question, demands=replace(demands, factor=1.0))
        without_factor = _in_time(partial(on_band.prove, less, outcomes)) if on_band is not None and missed else None
    return Certificate(design=design, demands=demands, outcomes=outcomes, without_factor=without_factor, box=box)


def _beside(question: Question) -> list[Question]:
    """Return the same question for the delays on both sides of a nearby whole number of samples."""
    design, demands, box = question.design, question.demands, question.box
    hands, found, uncertain = demands.hands, list[Question](), box.uncertain if box is not None else ()
    if hands is None or not may_jump(design.device, uncertain):
        return found
    keys = (design.device.delay_key, LATENCY) if design.device.divided else DELAYS
    for device in beside_whole_sample(design.device, hands):
        delays = {key: device.number(key) for key in keys if device.number(key) is not None}
        there = box and DeviceBox(*(each.with_numbers(delays) for each in (box.nominal, box.low, box.high)))
        at = replace(demands, device=demands.device.with_numbers(delays))
        found.append(replace(question, design=replace(design, device=device), demands=at, box=there))
    return found


def _holding_beside(certificate: Certificate, beside: Sequence[Certificate]) -> Certificate:
    """Return a certificate whose claims hold for several delays."""
    outcomes, without_factor = certificate.outcomes, certificate.without_factor
    for other in beside:
        device = other.design.device
        outcomes = {claim: _worse(found, other.outcomes[claim], device) for claim, found in outcomes.items()}
        factors = [found for found in (without_factor, other.without_factor) if found is not None]
        without_factor = _worse(factors[0], factors[-1], device) if factors else None
    return replace(certificate, outcomes=outcomes, without_factor=without_factor, beside=tuple(beside))


def _worse(found: Outcome, other: Outcome, device: Device) -> Outcome:
    boxes = found.boxes + other.boxes
    if found.verdict is Verdict.REFUTED or other.verdict in (Verdict.PROVED, found.verdict):
        return replace(found, boxes=boxes)
    return replace(other, boxes=boxes, device=other.device or device)


def _in_time(proof: Callable[[], Outcome]) -> Outcome:
    """Return the outcome of a proof, or "undecided" if the time limit ended it."""
    try:
        check_time()
        return proof()
    except OutOfTimeError:
        return Outcome(Verdict.UNDECIDED, 0, cut=True)
