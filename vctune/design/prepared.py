"""A problem prepared for the search: its devices, its constraints, and the optimiser's units."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, dataclass, replace

from vctune.analysis.demands import sampled_span, transparency_error
from vctune.design.uncertain import device_box, in_longer_hands, moved_as_one
from vctune.design.variables import Point
from vctune.model.demands import Demands
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.problem import Problem
from vctune.model.transparency import TERMS, Terms
from vctune.model.worlds import Worlds
from vctune.proof.claims.delays import beside_whole_sample, may_jump, next_to_whole_samples, reaching_whole_sample
from vctune.proof.device_box import DeviceBox


@dataclass(frozen=True, slots=True)
class Units:
    """The optimiser's units, in which Z_0 = T = 1 and the greatest weight is 1."""

    impedance: float  # Z_0, N s/m
    time: float  # T, s
    error: float  # unit of the error: the greatest weight of a term

    def to_si(self, values: Point) -> Point:
        """Return a design's variables in SI units."""
        (K_v, K_p, b_c, *others), Z, T = values, self.impedance, self.time
        if len(others) == 1:  # for an impedance display only k_c follows b_c
            return (K_v * Z, K_p * Z / T, b_c * Z, others[0] * Z / T)
        m_c, b_0, *corner = others
        return (K_v * Z, K_p * Z / T, b_c * Z, m_c * Z * T, b_0 * Z, *(w_c / T for w_c in corner))

    def gains(self, gains: Gains) -> Gains:
        """Return gains in the optimiser's units."""
        return Gains(gains.velocity / self.impedance, gains.position * self.time / self.impedance)

    def to_dimensionless(self, values: Point) -> Point:
        """Return a design's variables in the optimiser's units."""
        (K_v, K_p, b_c, *others), Z, T = values, self.impedance, self.time
        if len(others) == 1:  # for an impedance display only k_c follows b_c
            return (K_v / Z, K_p * T / Z, b_c / Z, others[0] * T / Z)
        m_c, b_0, *corner = others
        return (K_v / Z, K_p * T / Z, b_c / Z, m_c / (Z * T), b_0 / Z, *(w_c * T for w_c in corner))


@dataclass(frozen=True, slots=True, eq=False)
class Posed:
    """A problem, with the devices for which the search imposes its constraints."""

    problem: Problem  # problem in SI or in the optimiser's units
    cases: tuple[Problem, ...]
    hand_cases: tuple[Problem, ...]
    objective: tuple[Problem, ...]  # problems of the devices whose greatest error is the objective
    box: DeviceBox | None  # box of all devices for which the prover must prove a design
    demands: Demands  # the constraints on a design
    span: tuple[float, float]  # the part of the stability band that a grid covers, rad/s

    def error(self, gains: Gains, coupling: AnyCoupling) -> float:
        """Return the objective of a design: its error, or the greatest error over the devices of the objective."""
        return max(transparency_error(case, gains, coupling).error for case in self.objective)


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """A problem in SI units, the same problem in the optimiser's units, and these units."""

    given: Posed
    scaled: Posed
    units: Units

    @property
    def problem(self) -> Problem:
        """The problem of the file, in SI units."""
        return self.given.problem

    def on_device(self, device: Device) -> Device:
        """Return a device of the given problem in the optimiser's units."""
        disc = self.problem.device.unmodelled if device.unmodelled is None else device.unmodelled
        return _dimensionless(with_device(self.problem, replace(device, unmodelled=disc)), self.units).device


def prepare(problem: Problem) -> Prepared:
    """Prepare a problem for the search."""
    greatest = max(astuple(problem.weights))
    units = Units(problem.transparency.reference_impedance, problem.device.sample_time, greatest)
    return Prepared(pose(problem), pose(_dimensionless(problem, units)), units)


def pose(problem: Problem) -> Posed:
    """Return a problem with the devices and constraints that the search needs, in the units of the problem."""
    posed = _posed(problem)
    beside = [_posed(other) for other in problems_beside(problem)]
    return replace(
        posed,
        cases=posed.cases + tuple(case for other in beside for case in other.cases),
        hand_cases=posed.hand_cases + tuple(case for other in beside for case in other.hand_cases),
    )


def with_corner(posed: Posed, corner: float) -> Posed:
    """Return a copy of a posed problem in which the multiplier for walls has a given corner frequency."""

    return in_worlds(posed, lambda worlds: replace(worlds, corner=corner))


def in_worlds(posed: Posed, change: Callable[[Worlds], Worlds]) -> Posed:
    """Return a copy of a posed problem with other environments."""

    def changed(problem: Problem) -> Problem:
        assert problem.worlds is not None
        return replace(problem, worlds=change(problem.worlds))

    problem, *parts = changed(posed.problem), posed.cases, posed.hand_cases, posed.objective
    cases, hand_cases, objective = (tuple(map(changed, part)) for part in parts)
    demands = replace(posed.demands, worlds=problem.worlds)
    return replace(posed, problem=problem, cases=cases, hand_cases=hand_cases, objective=objective, demands=demands)


def problems_beside(problem: Problem) -> list[Problem]:
    """Return copies of a problem with a delay just below and at a whole number of samples, if its delay is near such a
    number."""
    hands, device, uncertainty = problem.hands_met, problem.device, problem.uncertainty
    if hands is None or not may_jump(device, () if uncertainty is None else uncertainty.keys):
        return []
    if uncertainty is not None and device.divided:
        kept = tuple((key, width) for key, width in uncertainty.half_widths if key != device.delay_key)
        uncertainty = replace(uncertainty, half_widths=kept)
    uncertainty = uncertainty if uncertainty and (uncertainty.keys or uncertainty.unmodelled) else None
    return [replace(problem, device=each, uncertainty=uncertainty) for each in beside_whole_sample(device, hands)]


def _posed(problem: Problem) -> Posed:
    box = device_box(problem.device, problem.uncertainty) if problem.uncertainty else None
    if box is not None and problem.hands_met is not None:
        box = reaching_whole_sample(box, problem.hands_met)
    problem = replace(problem, device=box.nominal) if box is not None else problem
    cases = (problem,) if box is None else tuple(with_device(problem, device) for device in box.devices())
    worst = problem.uncertainty is not None and problem.uncertainty.objective == "worst"
    held = cases if problem.hands_met is not None or problem.any_hand else ()
    if held and box is not None:
        held += tuple(with_device(problem, device) for device in next_to_whole_samples(box.modelled))
    return Posed(problem, cases, held, cases if worst else (problem,), box, problem.demands, sampled_span(problem))


def of_one_device(problem: Problem) -> Problem | None:
    """Return a problem of an exactly known device with the same feasible couplings; None if there is none."""
    box = pose(problem).box
    if box is None:
        return problem
    if set(moved_as_one(box)) != set(box.uncertain) or problem.bounds.velocity.max > 0:
        return None
    least, longer = in_longer_hands(box, problem.hands, box.uncertain)
    return replace(with_device(problem, least.nominal), hands=longer)


def with_device(problem: Problem, device: Device) -> Problem:
    """Return the problem of another device with exactly known parameters."""
    return replace(problem, device=device, uncertainty=None)


def _dimensionless(problem: Problem, units: Units) -> Problem:
    scaled, weights = problem.in_units(units.impedance, units.time), problem.weights
    relative = Terms(*(getattr(weights, term) / units.error for term in TERMS))
    return replace(scaled, transparency=replace(scaled.transparency, weights=relative))
