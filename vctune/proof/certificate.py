"""The certificate: every claim about a design, proved, refuted or undecided.

See proof/README.md, section 1; document/README.md, section 3.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import astuple, dataclass, replace
from enum import StrEnum
from fractions import Fraction
from functools import partial
from math import inf, pi

import numpy as np
from flint import ctx

from vctune.model.device import Device
from vctune.model.gains import Gains
from vctune.model.numbers.frequency import hertz
from vctune.proof.claims.array_claims import Demands
from vctune.proof.claims.conditions import conditions_at, prove_conditions, widest_band
from vctune.proof.claims.every_device import (
    NominalProof,
    RobustDesign,
    prove_conditions_for_all,
    prove_model_poles_for_all,
    prove_sampled_poles_for_all,
    prove_sensitivity_for_all,
    prove_unmodelled,
    widest_band_for_all,
)
from vctune.proof.claims.every_hand import prove_any_hand, prove_hands
from vctune.proof.claims.many_designs import prove
from vctune.proof.claims.margins_of_claims import Design
from vctune.proof.claims.model_poles import prove_model_poles
from vctune.proof.claims.sampled_poles import prove_sampled_poles, prove_sensitivity, unmodelled_at
from vctune.proof.claims.whole_samples import beside_whole_sample
from vctune.proof.device_box import DELAYS, DeviceBox
from vctune.proof.enclosures.arb_balls import PRECISION
from vctune.proof.engine.band_edges import edge_in_hertz
from vctune.proof.engine.boxes import Cells
from vctune.proof.engine.interval import Outcome, Verdict, worst_verdict
from vctune.running import OutOfTimeError, aloud, check_time, tell


class Claim(StrEnum):
    """What a certificate claims."""

    CONDITIONS = "Re G_hh > 0 and Re Z_c >= safety_factor R on the band"
    SENSITIVITY = "|S| <= max_sensitivity of the sampled loop up to Nyquist"
    MODEL_POLES = "no pole of the frequency model in the closed right half plane"
    SAMPLED_POLES = "spectral radius of the sampled loop below 1"
    UNMODELLED = "|1 - S| r < 1 of the sampled loop up to Nyquist, r the radius of what is not modelled"
    ANY_HAND = "stable in any passive hand with every passive environment, Re 1/Z_c >= safety_factor R up to Nyquist"
    HANDS = "stable in every hand with every passive environment, Re Z_c >= safety_factor R up to Nyquist"
    WORLDS = "stable in every hand with every environment of the box, also with Z_c / safety_factor"
    FORCE_HANDS = "stable in every hand with every passive environment, Re 1/Z_c >= safety_factor R up to Nyquist"


STABILITY = Claim.MODEL_POLES, Claim.SAMPLED_POLES, Claim.UNMODELLED
"""Those without which no ratio means anything."""
IN_HANDS = Claim.HANDS, Claim.WORLDS, Claim.FORCE_HANDS
"""Those about the hands of a box: of an admittance display with any environment or those of a box, of an impedance
display."""
RATIOS = Claim.CONDITIONS, Claim.ANY_HAND, *IN_HANDS
"""Those that are about Re Z_c / R."""

ON_ARRAYS = Claim.CONDITIONS, Claim.SENSITIVITY, Claim.MODEL_POLES, Claim.SAMPLED_POLES
"""Those that are proved of many designs together, in the order in which `prove` counts boxes."""


@dataclass(frozen=True, slots=True)
class Certificate:
    """What is proved of a design.

    Attributes
    ----------
    design : what it is about
    demands : what the design has to meet
    outcomes : for each claim, its verdict, boxes and witness [rad/s]
    without_factor : the conditions with a factor of 1 where they are not proved with the demanded one, else None
    box : the devices that it is about, None for the design's own alone
    beside : the same of the design with other delays, for which the outcomes hold as well
    """

    design: Design
    demands: Demands
    outcomes: dict[Claim, Outcome]
    without_factor: Outcome | None = None
    box: DeviceBox | None = None
    beside: tuple[Certificate, ...] = ()

    @property
    def verdict(self) -> Verdict:
        """The worst verdict of all claims."""
        return worst_verdict(outcome.verdict for outcome in self.outcomes.values())

    @property
    def cut(self) -> bool:
        """Whether the time limit cut one of the proofs."""
        return any(outcome.cut for outcome in self.outcomes.values())

    @property
    def boxes(self) -> int:
        """Boxes looked at for all claims."""
        return sum(outcome.boxes for outcome in self.outcomes.values())

    @property
    def proved_ratio(self) -> float | None:
        """The least Re Z_c / R that is proved of the band, of a stable loop: the demanded one, or 1, or None."""
        stability = (self.outcomes[claim] for claim in STABILITY if claim in self.outcomes)
        if any(outcome.verdict is not Verdict.PROVED for outcome in stability):
            return None
        if all(self.outcomes[claim].verdict is Verdict.PROVED for claim in RATIOS if claim in self.outcomes):
            return self.demands.factor
        return 1.0 if self.without_factor and self.without_factor.verdict is Verdict.PROVED else None

    @property
    def proved_band(self) -> tuple[float, float] | None:
        """The widest band around the demanded one with ratio >= 1, rad/s, proved on demand; None unless that is."""
        bands = [self._own_band, *(each.proved_band for each in self.beside)]
        known = [band for band in bands if band is not None]
        return (max(low for low, _ in known), min(high for _, high in known)) if len(known) == len(bands) else None

    @property
    def _own_band(self) -> tuple[float, float] | None:
        conditions = self.without_factor or self.outcomes.get(Claim.CONDITIONS)
        if conditions is None or conditions.verdict is not Verdict.PROVED:
            return None
        robust = _robust_design(self.design, self.box, replace(self.demands, factor=1.0, max_sensitivity=inf))
        try:
            if robust is not None:
                return widest_band_for_all(robust)
            with ctx.workprec(PRECISION):
                return widest_band(self.design, *self.demands.band)
        except OutOfTimeError:
            return self.demands.band

    @property
    def proved_band_hz(self) -> tuple[float, float] | None:
        """The proved band, Hz, its edges beyond the demanded one rounded inwards to few digits; None unless proved."""
        proved, (low, high) = self.proved_band, self.demands.band
        if proved is None:
            return None
        nyquist = pi / self.design.device.sample_time
        at_least, at_most = proved[0] in (0.0, low), proved[1] in (inf, high, nyquist)
        least = hertz(proved[0]) if at_least else min(edge_in_hertz(proved[0], upper=False), hertz(low))
        return least, hertz(proved[1]) if at_most else max(edge_in_hertz(proved[1], upper=True), hertz(high))


def certify(design: Design, demands: Demands, box: DeviceBox | None = None) -> Certificate:
    """Prove that a design meets its demands, its numbers taken as the decimals that they are written as.

    Parameters
    ----------
    design : device, gains, coupling
    demands : of its device; the band may be (0, inf) for hold "lag" without delay
    box : devices for all of which it is to be proved, around the design's own

    Returns
    -------
    Certificate
        Each claim proved, refuted or undecided; those that the time limit cuts or leaves no time for are undecided.
        Where the device's delay is near a whole number of samples, and the sensed force jumps there, a claim is proved
        only if it is on both sides of that number too.
    """
    own, beside = _certificate(design, demands, box), _beside(design, demands, box)
    return _holding_beside(own, [_certificate(*each) for each in beside]) if beside else own


def _certificate(design: Design, demands: Demands, box: DeviceBox | None) -> Certificate:
    (low, high), limit = demands.band, demands.max_sensitivity
    claim = _everywhere(design, box and box.modelled, demands)

    def conditions(factor: float) -> Outcome:
        in_doubt = partial(conditions_at, factor=factor)
        alone = partial(prove_conditions, low=low, high=high, factor=factor)
        return _everywhere(design, box, demands, in_doubt)(alone, prove_conditions_for_all, factor)

    outcomes: dict[Claim, Outcome] = {}

    def unmodelled(radii: tuple[tuple[float, float], ...]) -> Outcome:
        assert box is not None
        bounded = outcomes[Claim.SENSITIVITY].verdict is Verdict.PROVED
        return _unmodelled(design, box, radii, demands, bounded=bounded)

    proofs: dict[Claim, Callable[[], Outcome]] = {}
    if demands.passive:
        proofs[Claim.CONDITIONS] = partial(conditions, demands.factor)
    looped = design.device.kind.own_loop
    if looped:
        proofs[Claim.SENSITIVITY] = partial(claim, lambda d: prove_sensitivity(d, limit), prove_sensitivity_for_all)
    if demands.passive:
        poles = partial(_of_every_loop, prove_model_poles)
        proofs[Claim.MODEL_POLES] = partial(claim, poles, prove_model_poles_for_all)
    if looped:
        poles = partial(_of_every_loop, prove_sampled_poles)
        proofs[Claim.SAMPLED_POLES] = partial(claim, poles, prove_sampled_poles_for_all)
    if box is not None and box.nominal.unmodelled is not None:
        proofs[Claim.UNMODELLED] = partial(unmodelled, box.nominal.unmodelled.radii)
    if demands.any_hand:
        proofs[Claim.ANY_HAND] = partial(prove_any_hand, design, demands, box)
    if demands.hands is not None:
        in_hands = Claim.FORCE_HANDS if design.device.kind.inverse else Claim.WORLDS if demands.worlds else Claim.HANDS
        proofs[in_hands] = partial(prove_hands, design, demands, box)
    with ctx.workprec(PRECISION), aloud():
        for number, (name, proof) in enumerate(proofs.items(), 1):
            tell(partial("claim {} of {}".format, number, len(proofs)))
            outcomes[name] = _in_time(proof)
        missed = demands.factor > 1 and demands.passive and outcomes[Claim.CONDITIONS].verdict is not Verdict.PROVED
        without_factor = _in_time(partial(conditions, 1.0)) if missed else None
    return Certificate(design=design, demands=demands, outcomes=outcomes, without_factor=without_factor, box=box)


def _beside(design: Design, demands: Demands, box: DeviceBox | None) -> list[tuple[Design, Demands, DeviceBox | None]]:
    """Return what `_certificate` takes for the delays on both sides of a whole number of samples that is near.

    An uncertain delay reaches that number within its box.
    """
    hands, found = demands.hands, list[tuple[Design, Demands, DeviceBox | None]]()
    if hands is None or (box is not None and any(key in box.uncertain for key in DELAYS)):
        return found
    for device in beside_whole_sample(design.device, hands):
        delays = {key: device.number(key) for key in DELAYS if device.number(key) is not None}
        there = box and DeviceBox(*(each.with_numbers(delays) for each in (box.nominal, box.low, box.high)))
        at = replace(demands, device=demands.device.with_numbers(delays))
        found.append((replace(design, device=device), at, there))
    return found


def _holding_beside(certificate: Certificate, beside: Sequence[Certificate]) -> Certificate:
    """Return a certificate whose claims are proved for all of several delays, each with the device where it is not."""
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
    """Return what a proof finds, or that the time limit cut it."""
    try:
        check_time()
        return proof()
    except OutOfTimeError:
        return Outcome(Verdict.UNDECIDED, 0, cut=True)


def _of_every_loop(prove_poles: Callable[[Device, Gains], Outcome], design: Design) -> Outcome:
    """Prove the poles of the device let go and in the hand of its least operator."""
    boxes = 0
    for device in design.device.loops:
        outcome = prove_poles(device, design.gains)
        boxes += outcome.boxes
        if outcome.verdict is not Verdict.PROVED:
            break
    return replace(outcome, boxes=boxes)


def _unmodelled(
    design: Design, box: DeviceBox, radii: tuple[tuple[float, float], ...], demands: Demands, *, bounded: bool
) -> Outcome:
    """Prove that no response within the discs of those of a box makes the loop unstable.

    Where |S| is `bounded` by its limit, |1 - S| is by one more, and discs smaller than the inverse of that need no
    proof of their own.
    """
    greatest, limit = (Fraction(str(x)) for x in (max(radius for _, radius in radii), demands.max_sensitivity))
    if not design.gains.closed or (bounded and greatest * (1 + limit) < 1):
        return Outcome(Verdict.PROVED, 1)

    def alone(device: Device, theta: float) -> Outcome:
        return unmodelled_at(device, design.gains, radii, theta)

    return prove_unmodelled(RobustDesign(design, box, demands), alone)


def _everywhere(
    design: Design, box: DeviceBox | None, demands: Demands, in_doubt: Callable[..., Outcome] | None = None
) -> Callable[..., Outcome]:
    """Return what proves a claim for the design's own device, and then for every one of the box.

    `in_doubt` judges a device whose response is perturbed, at a frequency.
    """

    def claim(
        alone: Callable[[Design], Outcome],
        for_all: Callable[[RobustDesign, NominalProof], Outcome],
        factor: float = 1.0,
    ) -> Outcome:
        nominal = alone(design)
        robust = _robust_design(design, box, replace(demands, factor=factor))
        if robust is None or nominal.verdict is not Verdict.PROVED:
            return nominal

        def one(device: Device, omega: float) -> Outcome:
            there = replace(design, device=device)
            if in_doubt is not None and device.unmodelled is not None:
                return in_doubt(there, omega=omega)
            return alone(there)

        outcome = for_all(robust, one)
        return replace(outcome, boxes=nominal.boxes + outcome.boxes)

    return claim


def _robust_design(design: Design, box: DeviceBox | None, demands: Demands) -> RobustDesign | None:
    """Return the design on a box of devices; None where they are one, or all alike.

    Without a loop a mechanism is passive whatever its numbers are, but not if its response is another.
    """
    if box is None or not box.uncertain:
        return None
    alike = not design.gains.closed and box.nominal.unmodelled is None
    return None if alike else RobustDesign(design, box, demands)


def certify_all(designs: Sequence[Design], demands: Demands, box: DeviceBox | None = None) -> list[Certificate]:
    """Prove that several designs of one device meet its demands, as `certify` does.

    Most are proved on arrays, all of them together; Arb decides about the others. For a box of devices, or of hands,
    each is proved by itself.

    Parameters
    ----------
    designs : of one device
    demands : of it
    box : devices for all of which they are to be proved

    Returns
    -------
    list of Certificate
        In the order of the designs.
    """
    found: list[Certificate | None] = [None] * len(designs)
    if designs and box is None and demands.hands is None and not demands.any_hand:
        values = np.array([astuple(design.gains) + astuple(design.coupling) for design in designs]).T
        with suppress(OutOfTimeError):
            proofs = prove(demands, Cells(values, values))
            for index, (proved, boxes) in enumerate(zip(proofs.proved, proofs.boxes.T.tolist(), strict=True)):
                outcomes = {claim: Outcome(Verdict.PROVED, n) for claim, n in zip(ON_ARRAYS, boxes, strict=True)}
                found[index] = Certificate(designs[index], demands, outcomes) if proved else None
    return [certificate or certify(design, demands, box) for design, certificate in zip(designs, found, strict=True)]
