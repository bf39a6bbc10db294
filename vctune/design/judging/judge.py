"""Judge given gains: compute error, least ratio, greatest |S| and certificate, without importing the optimiser."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from math import inf
from typing import NamedTuple

import numpy as np

from vctune.analysis.before_wall import LoopOfWall, loop_of_wall
from vctune.analysis.demands import (
    TransparencyError,
    ratio_minima,
    sensitivity_maxima,
    transparency_error,
)
from vctune.analysis.in_hands import (
    DEVICES_AT_ONCE,
)
from vctune.analysis.in_worlds import corner_of
from vctune.analysis.least_ratio import LEAST, least_of_devices
from vctune.analysis.margins import Margins, loop_margins
from vctune.analysis.multiples import suspects
from vctune.analysis.responses import Loop
from vctune.design.judging.kicked import buzz_of, ringing_of
from vctune.design.judging.worst_devices import loudest, worst_inside
from vctune.design.prepared import Posed, pose, with_corner
from vctune.document.schema.rules import ADDS_TO_WALL
from vctune.document.text.errors import InputError
from vctune.model.demands import Demands
from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.display import Display
from vctune.model.gains import AnyCoupling, Gains, SpringDamper, series_coupling
from vctune.model.hands import Hand
from vctune.model.loop.limits import high_frequency_limit, low_frequency_limit
from vctune.model.numbers.units import hertz
from vctune.model.problem import Problem
from vctune.model.worlds import OVER_LIMIT
from vctune.proof.certificate import Certificate, certify
from vctune.proof.claims.any_hand import ANY_HAND
from vctune.proof.claims.band import ALONE, PASSIVE
from vctune.proof.claims.claim import ClaimId
from vctune.proof.claims.hands import HANDS
from vctune.proof.claims.registry import BEFORE_WALL, claims_asked
from vctune.proof.claims.walls import WALLS
from vctune.proof.claims.worlds import WORLDS
from vctune.proof.device_box import DeviceBox
from vctune.proof.outcome import ENCLOSED, Verdict
from vctune.running import OutOfTimeError, check_time, seconds_left, time_limit, unlimited
from vctune.simulation.kicks import Buzz
from vctune.simulation.rings import least_damped_hand


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


class LeastRatio(NamedTuple):
    """The least Re Z_c / R of a claim on a device; for the coupling as a wall, the least multiple of it that is
    unstable."""

    ratio: float  # inf if nothing is required
    omega: float  # rad/s
    device: Device
    claim: ClaimId = ""
    hand: Hand | None = None


def _ratio(margin: LeastRatio) -> float:
    return margin.ratio


@dataclass(frozen=True, slots=True, kw_only=True)
class Judgement:
    """A design, with its error, margins and proved claims.

    Attributes
    ----------
    posed : Posed
        The problem with its devices and constraints.
    gains, coupling : Gains and AnyCoupling
        The design.
    transparency : TransparencyError
        Error and its three terms on the nominal device.
    error : float
        The objective: the error on the nominal device, or the greatest error at the vertices of a box of
        devices.
    margins : tuple of LeastRatio
        The least Re Z_c / R of each claim on each device.
    peak_sensitivity, worst_sensitivity : float
        Greatest ``|S|`` of the nominal device and the devices of a box up to Nyquist, and its frequency, rad/s.
    certificate : Certificate
        The proved claims.
    cut : bool
        Whether the time limit ended the proof, or the evaluation of all devices in hands. What is missing is left out
        of the margins and of the greatest ``|S|``.
    kicked : Buzz, optional
        What kicks do to a proved design, as simulated; None unless the problem demands that it is calm.
    """

    posed: Posed
    gains: Gains
    coupling: AnyCoupling
    transparency: TransparencyError
    error: float
    margins: tuple[LeastRatio, ...]
    peak_sensitivity: float
    worst_sensitivity: float
    certificate: Certificate
    cut: bool = False
    kicked: Buzz | None = None

    @property
    def device(self) -> Device:
        """The nominal device."""
        return self.posed.problem.device

    @property
    def status(self) -> Status:
        """The status that follows from the certificate's verdict and, where it is demanded, from kicks."""
        proved = self.certificate.verdict is Verdict.PROVED
        if not (proved and self.posed.problem.stability.calm):
            return STATUS_OF[self.certificate.verdict]
        if self.kicked is None:
            return Status.UNDECIDED
        return Status.VIOLATED if self.kicked.moving else Status.CERTIFIED

    @property
    def corner(self) -> float | None:
        """Corner frequency w_c of the multiplier for walls, rad/s; None without walls."""
        worlds = self.certificate.demands.worlds
        return None if worlds is None else worlds.corner

    @property
    def kind(self) -> Display:
        """The kind of display of the device."""
        return self.device.kind

    def least(self, *claims: ClaimId) -> LeastRatio | None:
        """Return the least margin of some claims, or of all; None without one."""
        return min((at for at in self.margins if not claims or at.claim in claims), default=None, key=_ratio)

    @property
    def binding(self) -> LeastRatio:
        """The least margin of all claims, of ratio inf if no claim has one."""
        return self.least() or LeastRatio(inf, 0.0, self.device)

    @property
    def min_ratio(self) -> float:
        """Least Re Z_c / R of all claims."""
        return self.binding.ratio

    @property
    def worst(self) -> float:
        """Frequency of the least Re Z_c / R, rad/s; 0 or inf at an end of the axis."""
        return self.binding.omega

    @property
    def tightest(self) -> Device:
        """The device with the least ratio, among the nominal device and those of a box."""
        return self.binding.device

    @property
    def in_hand(self) -> LeastRatio | None:
        """The least Re Z_c / R in the hands of the claim; None without this claim."""
        return self.least(HANDS.id, WORLDS.id)

    @property
    def in_any_hand(self) -> LeastRatio | None:
        """The least Re(1/Z_c)/R of an impedance display in any passive hand; None without this claim."""
        return self.least(ANY_HAND.id)

    @property
    def closed_loop(self) -> LoopOfWall | None:
        """The peak sensitivity and the phase margin of the loop that a wall closes on the nominal device in the least
        hand; None without a wall that is proved, because a loop that may be unstable has no margins."""
        if not self.posed.problem.rigid or self.status is not Status.CERTIFIED:
            return None
        hands, least, wall = self.posed.problem.hands_met, self.device.operator, self.coupling
        assert isinstance(wall, SpringDamper)
        always = Hand(0.0, 0.0, 0.0) if least is None else Hand(least.mass, least.damping, 0.0)
        return loop_of_wall(self.device, wall, always if hands is None else hands.low)

    @property
    def before_wall(self) -> LeastRatio | None:
        """The least multiple of the coupling as a wall that is unstable; None without a wall."""
        return self.least(*BEFORE_WALL)

    @property
    def in_walls(self) -> LeastRatio | None:
        """The least ratio of the condition on walls; None without walls."""
        return self.least(WALLS.id)

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
        """The name of the least ratio: Re Z_c / R, or Re(1/Z_c)/R for an impedance display; with environments, the
        number by which the coupling may be divided; of a wall, its limit."""
        if self.before_wall:
            return "least unstable multiple of the wall"
        return f"least {self.kind.ratio}" if self.certificate.demands.worlds is None else OVER_LIMIT

    @property
    def band(self) -> tuple[float, float] | None:
        """The band of the claim about any passive hand, rad/s; None without this claim."""
        demands = self.certificate.demands
        return demands.band if demands.passive else None

    @property
    def loop_margins(self) -> Margins:
        """The gain, phase and delay margin of the sampled velocity loop."""
        return loop_margins(self.device, self.gains)

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
    def limp(self) -> bool:
        """Whether the spring K_p of a velocity loop is nothing in the transparency band, K_p < Z_0 omega_1: it holds no
        static force; never with nothing behind it, where there is no force to hold."""
        objective, worlds = self.posed.problem.transparency, self.posed.problem.worlds
        if not self.kind.own_loop or self.kind.inverse or not self.gains.closed or (worlds and worlds.nothing):
            return False
        return bool(self.gains.position < objective.reference_impedance * objective.band.min)

    @property
    def idle(self) -> bool:
        """Whether the design of an admittance display is certified but hardly uses its velocity loop."""
        tracks = self.kind.own_loop and not self.kind.inverse
        return tracks and self.status is Status.CERTIFIED and self.transparency.tracking > IDLE_TRACKING


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

    Raises
    ------
    InputError
        If K_v stands beside a wall, whose damping is the coupling's.
    """
    if problem.rigid and gains.velocity != 0:
        raise InputError.of("design", "contradiction", ADDS_TO_WALL, key="gains.velocity")
    return judge_posed(pose(problem), gains, coupling)


@np.errstate(all="ignore")
def judge_posed(posed: Posed, gains: Gains, coupling: AnyCoupling) -> Judgement:
    """Judge given gains against the constraints of a problem."""
    posed = with_best_corner(posed, gains, coupling)
    with time_limit(PROVING * seconds_left()):
        certificate = certified(Design(posed.demands.device, gains, coupling), posed.demands, posed.box)
    return judgement_of(posed, gains, coupling, certificate)


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
        certificates = [certified(Design(problem.device, *design), posed.demands, posed.box) for design in designs]
    return [
        judgement_of(posed, *design, certificate) for design, certificate in zip(designs, certificates, strict=True)
    ]


def certified(design: Design, demands: Demands, box: DeviceBox | None = None) -> Certificate:
    """Prove a design, with an estimate of where it may fail in hands."""
    return certify(design, demands, box, suspects, least_damped_hand)


def with_best_corner(posed: Posed, gains: Gains, coupling: AnyCoupling) -> Posed:
    """Return a posed problem with the best corner frequency for its walls, if it has walls and no corner frequency
    yet."""
    worlds = posed.demands.worlds
    if worlds is None or not worlds.walls or worlds.corner is not None:
        return posed
    return with_corner(posed, corner_of(posed.problem, gains, coupling))


def judgement_of(posed: Posed, gains: Gains, coupling: AnyCoupling, certificate: Certificate) -> Judgement:
    """Return a judgement: a certificate, and values in double precision."""
    devices, in_hands, cut = [case.device for case in posed.hand_cases], list[LeastRatio](), certificate.cut
    with unlimited():
        transparency = transparency_error(posed.problem, gains, coupling)
        error = posed.error(gains, coupling) if len(posed.objective) > 1 else transparency.error
    try:
        on_band, (sensitivity, omega) = _without_hands(posed, gains, coupling)
    except OutOfTimeError:
        cut, nominal = True, replace(posed, cases=posed.cases[:1], box=None)
        with unlimited():
            on_band, (sensitivity, omega) = _without_hands(nominal, gains, coupling)
    try:
        for batch in [
            devices[:1],
            *(devices[k : k + DEVICES_AT_ONCE] for k in range(1, len(devices), DEVICES_AT_ONCE)),
        ]:
            check_time()
            in_hands += margins_in_hands(posed.demands, batch, gains, coupling) if batch else []
    except OutOfTimeError:
        cut = True
    if devices and not in_hands:  # a judgement has at least one ratio, if only an estimate
        with unlimited():
            in_hands = margins_in_hands(posed.demands, devices[:1], gains, coupling, climbed=False)
    found = Judgement(
        posed=posed,
        gains=gains,
        coupling=coupling,
        transparency=transparency,
        error=error,
        margins=(*on_band, *in_hands),
        peak_sensitivity=sensitivity,
        worst_sensitivity=omega,
        certificate=certificate,
        cut=cut,
    )
    _refuse_contradiction(found)
    return _kicked(found) if posed.problem.stability.calm and certificate.verdict is Verdict.PROVED else found


def _refuse_contradiction(judgement: Judgement) -> None:
    """Raise an internal error if a least ratio that was found contradicts a claim that is proved."""
    demands, outcomes = judgement.certificate.demands, judgement.certificate.outcomes
    for at in judgement.margins:
        proved = at.claim in outcomes and outcomes[at.claim].verdict is Verdict.PROVED
        if proved and at.ratio * ENCLOSED < demands.factor:
            place = f"{hertz(at.omega):.6g} Hz in the hand of {at.hand} on {at.device}"
            raise AssertionError(f"{at.claim} is proved, and its least ratio is {at.ratio:.6g} at {place}")


def _kicked(judgement: Judgement) -> Judgement:
    """Return a judgement with what kicks do, unless the time is over."""
    law = judgement.gains, judgement.coupling
    try:
        rings = ringing_of(judgement.posed, judgement.tightest, *law)
        return replace(judgement, kicked=buzz_of(judgement.posed.problem, rings, *law))
    except OutOfTimeError:
        return replace(judgement, cut=True)


def _without_hands(posed: Posed, gains: Gains, coupling: AnyCoupling) -> tuple[list[LeastRatio], tuple[float, float]]:
    return margins_on_band(posed, gains, coupling), peak_sensitivity(posed, gains)


def peak_sensitivity(posed: Posed, gains: Gains) -> tuple[float, float]:
    """Return the greatest |S| of the devices of a problem up to Nyquist, and its frequency, rad/s."""
    peaks = ((case, sensitivity_maxima(case, gains)) for case in posed.cases)
    loud, found = min(peaks, key=lambda pair: float(pair[1].value[0]))
    if (louder := loudest(posed, gains, loud, found)) is not None:  # of many numbers not every vertex is a case
        found = louder[1]
    return float(-found.value[0]), float(found.omega[0])


def margins_on_band(posed: Posed, gains: Gains, coupling: AnyCoupling) -> list[LeastRatio]:
    """Return the least ratio of each device on the stability band, if there is a claim about it."""
    if not posed.demands.passive:
        return []
    found = [margin_on_band(case, gains, coupling) for case in posed.cases]
    inside = worst_inside(posed, gains, coupling) if posed.box is not None else []
    return [*found, *(LeastRatio(at.ratio, at.omega, at.device, found[0].claim) for at in inside[:1])]


def margin_on_band(problem: Problem, gains: Gains, coupling: AnyCoupling) -> LeastRatio:
    """Return the least Re Z_c / R on the stability band, with the exact limits at 0 and infinity."""
    device, band = problem.device, problem.stability.band
    minima = ratio_minima(problem, gains, coupling)
    candidates = [(float(minima.value[0]), float(minima.omega[0]))]
    for edge, limit_of in ((0.0, low_frequency_limit), (inf, high_frequency_limit)):
        if edge in (band.min, band.max):
            limit = limit_of(device, gains, series_coupling(coupling))
            candidates.append((limit.coupling / limit.required if limit.required > 0 else inf, edge))
    return LeastRatio(*min(candidates), device, (ALONE if problem.alone else PASSIVE).id)


def margins_in_hands(
    demands: Demands, devices: Sequence[Device], gains: Gains, coupling: AnyCoupling, *, climbed: bool = True
) -> list[LeastRatio]:
    """Return the least ratio of each claim in hands on each device, or only an estimate of it."""
    found = list[LeastRatio]()
    for claim in (claim.id for claim in claims_asked(demands) if claim.id in LEAST):
        if claim == WALLS.id and demands.walls_met is None:
            continue
        if climbed:
            ratios = least_of_devices(claim, demands, devices, gains, coupling)
        else:
            ratios = [LEAST[claim](demands, device, gains, coupling) for device in devices]
        for device, at in zip(devices, ratios, strict=True):
            found.append(LeastRatio(at.ratio, at.omega, device, claim, at.hand))
    return found
