"""Judge given gains: compute error, least ratio, greatest |S| and certificate, without importing the optimiser."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from math import inf, pi
from typing import NamedTuple

import numpy as np

from vctune.analysis.demands import (
    TransparencyError,
    ratio_minima,
    sensitivity_maxima,
    transparency_error,
)
from vctune.analysis.in_hands import (
    TOGETHER,
    RatioInAnyHand,
    RatioInHand,
    least_ratios_in_any_hand,
    least_ratios_of_devices,
    resistive_ratio_at,
)
from vctune.analysis.in_walls import corner_of
from vctune.analysis.responses import Loop
from vctune.design.prepared import Posed, pose, with_acting_terms, with_corner
from vctune.design.search.worst import loudest, worst_inside
from vctune.model.device import Device
from vctune.model.display import Display
from vctune.model.gains import AnyCoupling, Gains, series_coupling
from vctune.model.hands import Hand
from vctune.model.loop.limits import high_frequency_limit, low_frequency_limit
from vctune.model.numbers.units import UNITS, Units, hertz
from vctune.model.problem import Demands, Problem
from vctune.proof.certificate import Certificate, certify
from vctune.proof.claims.margins_of_claims import Design
from vctune.proof.claims.registry import CLAIMS
from vctune.proof.outcome import Outcome, Verdict
from vctune.running import in_time, seconds_left, time_limit, unlimited


class Status(StrEnum):
    """The status of a problem."""

    CERTIFIED = "certified"
    VIOLATED = "violated"
    UNDECIDED = "undecided"
    INFEASIBLE = "infeasible"


STATUS_OF = {
    Verdict.PROVED: Status.CERTIFIED,
    Verdict.REFUTED: Status.VIOLATED,
    Verdict.UNDECIDED: Status.UNDECIDED,
}


IDLE_TRACKING = 0.5  # Mean or greatest |1 - G_he| above which vctune warns that a design hardly uses its velocity loop


PROVING = 0.85  # Share of the remaining time that the proof of a design may take if there is a time limit
CUT = " (the time limit cut its proof)"  # Words that follow a claim if the time limit ended its proof


@dataclass(frozen=True, slots=True, kw_only=True)
class Judgement:
    """A design, with its error, margins and proved claims.

    Attributes
    ----------
    device : Device
        The nominal device.
    gains, coupling : Gains and AnyCoupling
        The design.
    transparency : TransparencyError
        Error and its three terms on the nominal device.
    error : float
        The objective: the error on the nominal device, or the greatest error at the vertices of a box of
        devices.
    acting_error : float
        The objective with only the terms that can differ between designs; bounds on the error refer to it.
    min_ratio, worst : float
        Least Re Z_c / R of all claims, and its frequency, rad/s (0 or inf at an end of the axis).
    tightest : Device
        The device with the least ratio, among the nominal device and those of a box.
    in_hand : RatioInHand, optional
        The least Re Z_c / R in the hands of the claim, with its hand; None without this claim.
    in_any_hand : RatioInAnyHand, optional
        The least Re(1/Z_c)/R of an impedance display in any passive hand; None without this claim.
    in_walls : RatioInHand, optional
        The least ratio of the condition on walls, with its hand; None without walls.
    peak_sensitivity, worst_sensitivity : float
        Greatest ``|S|`` of the nominal device and the devices of a box up to Nyquist, and its frequency, rad/s.
    certificate : Certificate
        The proved claims.
    cut : bool
        Whether the time limit ended the proof, or the evaluation of the devices in hands.
    """

    device: Device
    gains: Gains
    coupling: AnyCoupling
    transparency: TransparencyError
    error: float
    acting_error: float
    min_ratio: float
    worst: float
    tightest: Device
    peak_sensitivity: float
    worst_sensitivity: float
    certificate: Certificate
    in_hand: RatioInHand | None = None
    in_any_hand: RatioInAnyHand | None = None
    in_walls: RatioInHand | None = None
    cut: bool = False

    @property
    def status(self) -> Status:
        """The status that follows from the certificate's verdict."""
        return STATUS_OF[self.certificate.verdict]

    @property
    def corner(self) -> float | None:
        """Corner frequency w_c of the multiplier for walls, rad/s; None without walls."""
        worlds = self.certificate.demands.worlds
        return None if worlds is None else worlds.corner

    @property
    def kind(self) -> Display:
        """The kind of display of the device."""
        return self.tightest.kind

    @property
    def worst_hz(self) -> float:
        """Frequency of the least Re Z_c / R, Hz."""
        return hertz(self.worst)

    @property
    def worst_sensitivity_hz(self) -> float:
        """Frequency of the greatest ``|S|``, Hz."""
        return hertz(self.worst_sensitivity)

    @property
    def ratio_name(self) -> str:
        """The name of the least ratio: Re Z_c / R, or Re(1/Z_c)/R for an impedance display."""
        return f"least {self.tightest.kind.ratio}"

    def loop(self, hand: Hand | None = None) -> Loop:
        """Return the sampled loop of the nominal device with this design, for arrays, state space and python-control.

        Parameters
        ----------
        hand : Hand, optional
            Hand at the handle; None for a device without a hand.
        """
        return Loop(self.device, self.gains, self.coupling, hand)

    def __repr__(self) -> str:
        return f"Judgement({self.status.value}, error {self.transparency.error:.4g}, {self.gains}, {self.coupling})"

    @property
    def idle(self) -> bool:
        """Whether the design is certified but hardly uses its velocity loop."""
        return (
            self.tightest.kind.own_loop
            and self.status is Status.CERTIFIED
            and self.transparency.tracking > IDLE_TRACKING
        )

    @property
    def open_claims(self) -> list[str]:
        """The claims that are not proved, in words: each with its verdict, its place, and the device on which it
        fails."""
        units, kind = UNITS[self.tightest.units], self.tightest.kind
        return [
            f"{found.verdict.value}{_place(found, units)}: {CLAIMS[claim].said_of(kind)}{CUT * found.cut}"
            for claim, found in self.certificate.outcomes.items()
            if found.verdict is not Verdict.PROVED
        ]

    @property
    def reserve_missed(self) -> str | None:
        """A message for a design that is absolutely stable but misses the safety factor; None for any other design."""
        if self.certificate.without_factor is None or self.certificate.proved_ratio is None:
            return None
        return f"absolutely {self.stable_but}"

    @property
    def stable_but(self) -> str:
        """The phrase on a stable design that misses the safety factor, with its least ratio."""
        factor, ratio = self.certificate.demands.factor, self.min_ratio
        texts = (f"{ratio:.{digits}g}" for digits in range(6, 18))  # enough digits to differ from the factor
        least = next((text for text in texts if float(text) != factor), f"{ratio:g}")
        misses = "misses" if self.status is Status.VIOLATED else "not proved with"
        return f"stable; {misses} safety_factor {factor:g}: {self.ratio_name} {least} at {self.worst_hz:.6g} Hz"


def _place(outcome: Outcome, units: Units) -> str:
    place = f" at {outcome.witness / (2 * pi):.6g} Hz" if outcome.witness else ""
    if (hand := outcome.hand) is not None:
        place += f" in the hand of {hand.in_words(units)}"
    if (device := outcome.device) is None:
        return place
    known = [f"{key} {number:.6g}" for key, number in device.numbers().items() if key != "sample_time"]
    off = [] if device.unmodelled is None else [str(device.unmodelled)]
    return f"{place} with {', '.join([*known, *off])}"


def judge(problem: Problem, gains: Gains, coupling: AnyCoupling) -> Judgement:
    """Judge given gains against a problem's constraints.

    Parameters
    ----------
    problem : Problem
        Problem with all defaults filled in.
    gains, coupling : Gains and AnyCoupling
        A design with plain floats, N s/m, N/m and kg.

    Returns
    -------
    Judgement
        Error, least Re Z_c / R, greatest ``|S|`` and the certificate.
    """
    return judge_posed(pose(problem), gains, coupling)


@np.errstate(all="ignore")
def judge_posed(posed: Posed, gains: Gains, coupling: AnyCoupling) -> Judgement:
    """Judge given gains against the constraints of a problem."""
    posed = with_best_corner(posed, gains, coupling)
    with time_limit(PROVING * seconds_left()):
        certificate = certify(Design(posed.demands.device, gains, coupling), posed.demands, posed.box)
    return _judgement(posed, gains, coupling, certificate)


@np.errstate(all="ignore")
def judge_all(
    problem: Problem, designs: Sequence[tuple[Gains, AnyCoupling]], corners: Sequence[float | None] | None = None
) -> list[Judgement]:
    """Judge several designs against the constraints of a problem, with a joint proof. For one design, use `judge`."""
    posed = pose(problem)
    if posed.demands.worlds is not None and posed.demands.worlds.walls:  # the multiplier differs between designs
        each = zip(designs, corners or [None] * len(designs), strict=True)
        return [judge_posed(posed if known is None else with_corner(posed, known), *law) for law, known in each]
    with time_limit(PROVING * seconds_left()):
        certificates = [certify(Design(problem.device, *design), posed.demands, posed.box) for design in designs]
    return [_judgement(posed, *design, certificate) for design, certificate in zip(designs, certificates, strict=True)]


def with_best_corner(posed: Posed, gains: Gains, coupling: AnyCoupling) -> Posed:
    """Return a posed problem with the best corner frequency for its walls, if it has walls and no corner frequency
    yet."""
    worlds = posed.demands.worlds
    if worlds is None or not worlds.walls or worlds.corner is not None:
        return posed
    return with_corner(posed, corner_of(posed.problem, gains, coupling))


def _judgement(posed: Posed, gains: Gains, coupling: AnyCoupling, certificate: Certificate) -> Judgement:
    """Return a judgement: a certificate, and values in double precision."""
    in_hand = posed.demands.hands is not None or posed.demands.any_hand
    at: list[_InHands] = []
    devices = [case.device for case in posed.hand_cases] if in_hand else []
    # first one device, so that a judgement has at least one ratio when time runs out
    batches = [devices[:1], *(devices[k : k + TOGETHER] for k in range(1, len(devices), TOGETHER))]
    for batch in in_time(batches if devices else []):
        with unlimited():
            at.extend(_in_hands(posed.demands, batch, gains, coupling))
    with unlimited():
        judgement = _estimated(posed, gains, coupling, certificate, at)
    return replace(judgement, cut=certificate.cut or (in_hand and len(at) < len(posed.hand_cases)))


class _InHands(NamedTuple):
    """A device, with its least ratios in the hands of the claim, in any passive hand, and with walls."""

    device: Device
    held: RatioInHand | None
    any_hand: RatioInAnyHand | None
    walls: RatioInHand | None


def _in_hands(demands: Demands, devices: Sequence[Device], gains: Gains, coupling: AnyCoupling) -> list[_InHands]:
    hands, walls = demands.hands, demands.walls_met
    held: list[RatioInHand | None] = [None] * len(devices)
    at_walls = list(held)
    if hands is not None:
        of_each = least_ratios_of_devices(devices, hands, gains, coupling, demands.worlds_met)
        held = [ratios[0] for ratios in of_each]
    if hands is not None and walls:
        at_walls = [ratios[0] for ratios in least_ratios_of_devices(devices, hands, gains, coupling, walls)]
    return [
        _InHands(
            device,
            one,
            least_ratios_in_any_hand(device, gains, coupling)[0] if demands.any_hand else None,
            wall,
        )
        for device, one, wall in zip(devices, held, at_walls, strict=True)
    ]


def _estimated(
    posed: Posed, gains: Gains, coupling: AnyCoupling, certificate: Certificate, in_hands: list[_InHands]
) -> Judgement:
    cases = posed.cases
    (min_ratio, worst), tightest, held = (inf, 0.0), posed.problem.device, None
    if posed.demands.passive:
        ratios = [least_ratio(case, gains, coupling) for case in cases]
        devices = (case.device for case in cases)
        (min_ratio, worst), tightest = min(zip(ratios, devices, strict=True), key=lambda at: at[0])
        inside = worst_inside(posed, gains, coupling) if posed.box is not None else []
        if inside and inside[0].ratio < min_ratio:
            min_ratio, worst, tightest = inside[0].ratio, inside[0].omega, inside[0].device
    if of_hands := [(at.held, at.device) for at in in_hands if at.held is not None]:
        of_hands += _refuted(posed, gains, coupling, certificate)
        held, device = min(of_hands, key=lambda pair: pair[0].ratio)
        if held.ratio < min_ratio:
            min_ratio, worst, tightest = held.ratio, held.omega, device
    in_any_hand = None
    if of_any := [(at.any_hand, at.device) for at in in_hands if at.any_hand is not None]:
        in_any_hand, device = min(of_any, key=lambda pair: pair[0].ratio)
        if in_any_hand.ratio < min_ratio:
            min_ratio, worst, tightest = in_any_hand.ratio, in_any_hand.omega, device
    in_walls = None
    if of_walls := [(at.walls, at.device) for at in in_hands if at.walls is not None]:
        in_walls, device = min(of_walls, key=lambda pair: pair[0].ratio)
        if in_walls.ratio < min_ratio:
            min_ratio, worst, tightest = in_walls.ratio, in_walls.omega, device
    peaks = ((case, sensitivity_maxima(case, gains)) for case in cases)
    loud, sensitivity = min(peaks, key=lambda pair: float(pair[1].value[0]))
    if (louder := loudest(posed, gains, loud, sensitivity)) is not None:  # of many numbers not every vertex is a case
        sensitivity = louder[1]
    transparency, differing = transparency_error(posed.problem, gains, coupling), with_acting_terms(posed)
    error = posed.error(gains, coupling) if len(posed.objective) > 1 else transparency.error
    return Judgement(
        device=posed.problem.device,
        gains=gains,
        coupling=coupling,
        transparency=transparency,
        error=error,
        acting_error=error if differing is posed else differing.error(gains, coupling),
        min_ratio=min_ratio,
        worst=worst,
        tightest=tightest,
        peak_sensitivity=float(-sensitivity.value[0]),
        worst_sensitivity=float(sensitivity.omega[0]),
        certificate=certificate,
        in_hand=held,
        in_any_hand=in_any_hand,
        in_walls=in_walls,
    )


def _refuted(
    posed: Posed, gains: Gains, coupling: AnyCoupling, certificate: Certificate
) -> list[tuple[RatioInHand, Device]]:
    """Return Re Z_c / R at the witness of a claim with environments, one of which resonates with the loop there."""
    outcome, met = certificate.outcomes.get("worlds"), posed.demands.worlds_met
    # elsewhere the margins of the reactance are as good, and continuous; with one environment they say nothing there
    if outcome is None or met is None or not met.worlds.exact or outcome.verdict is not Verdict.REFUTED:
        return []
    device, hand, omega = outcome.device or posed.problem.device, outcome.hand, outcome.witness
    if hand is None or not omega:
        return []
    return [(RatioInHand(resistive_ratio_at(device, gains, coupling, omega, hand, met), omega, hand), device)]


def least_ratio(problem: Problem, gains: Gains, coupling: AnyCoupling) -> tuple[float, float]:
    """Return the least Re Z_c / R on the stability band and its frequency, with the exact limits at 0 and infinity."""
    device, band = problem.device, problem.stability.band
    minima = ratio_minima(problem, gains, coupling)
    candidates = [(float(minima.value[0]), float(minima.omega[0]))]
    if band.min == 0:
        limit = low_frequency_limit(device, gains, series_coupling(coupling))
        candidates.append((_quotient(limit.coupling, limit.required), 0.0))
    if band.max == inf:
        limit = high_frequency_limit(device, gains, series_coupling(coupling))
        candidates.append((_quotient(limit.coupling, limit.required), inf))
    return min(candidates)


def _quotient(coupling: float, required: float) -> float:
    return coupling / required if required > 0 else inf
