"""Between SI and the optimiser's own units, in which Z_0 = T = 1 and the greatest weight is 1."""

from __future__ import annotations

from dataclasses import replace

from vctune.design.variables import Point
from vctune.document.problem import Problem
from vctune.model.transparency import Terms


def dimensionless(problem: Problem) -> Problem:
    """Return the problem with Z_0 = T = 1 and the greatest weight 1."""
    scaled = problem.in_units(problem.transparency.reference_impedance, problem.device.sample_time)
    weights, most = scaled.transparency.weights, unit_of_error(problem)
    relative = Terms(weights.admittance / most, weights.tracking / most, weights.coupling / most)
    return replace(scaled, transparency=replace(scaled.transparency, weights=relative))


def unit_of_error(problem: Problem) -> float:
    """Return the greatest weight, in which the dimensionless problem counts its error."""
    weights = problem.transparency.weights
    return max(weights.admittance, weights.tracking, weights.coupling)


def physical(problem: Problem, values: Point) -> Point:
    """Return dimensionless K_v, K_p, b_c, m_c, b_0 in SI units."""
    Z, T = problem.transparency.reference_impedance, problem.device.sample_time
    K_v, K_p, b_c, m_c, b_0 = values
    return (K_v * Z, K_p * Z / T, b_c * Z, m_c * Z * T, b_0 * Z)


def own(problem: Problem, values: Point) -> Point:
    """Return K_v, K_p, b_c, m_c, b_0 in SI units without dimensions."""
    Z, T = problem.transparency.reference_impedance, problem.device.sample_time
    K_v, K_p, b_c, m_c, b_0 = values
    return (K_v / Z, K_p * T / Z, b_c / Z, m_c / (Z * T), b_0 / Z)
