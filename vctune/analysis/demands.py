"""Evaluate the constraints and the objective of a problem at given gains, in double precision. See model/README.md,
section 8; design/README.md, section 1."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, pi

import numpy as np

from vctune.analysis.extrema import Floats, Minima, frequency_grid, local_minima, with_resonance
from vctune.analysis.sampled_loop import loop_gain, sensitivity_of
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains, SpringDamper, coupling_impedance, series_coupling
from vctune.model.loop.device_response import device_response
from vctune.model.loop.llewellyn import llewellyn_excess, passive_alone
from vctune.model.loop.loop import LoopResponse, loop_response
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.pair import Pair
from vctune.model.problem import Problem
from vctune.model.sampled.impedance_display import firmware_filter, spring_damper_admittance
from vctune.model.transparency import Terms, log_quadrature, loop_terms, squared_terms

NODES = 64  # Number of frequencies that `tracking_terms` evaluates


def tracking_terms(problem: Problem, gains: Gains) -> Floats:
    """Return the tracking term of many loops, an estimate on a grid of frequencies."""
    band, device = problem.transparency.band, problem.device
    omega, weights = log_quadrature(band.min, band.max, NODES)
    at, every = device_response(device, omega, FLOATS), Gains(gains.velocity[..., None], gains.position[..., None])
    squares = loop_terms(loop_response(at, every, FLOATS), at, device.kind).tracking
    return np.asarray(np.sqrt(squares @ weights if problem.transparency.norm == "rms" else squares.max(axis=-1)))


END_DECADES = 5  # Number of decades by which the grid of an unbounded band extends beyond every corner of the device
RIPPLE_POINTS = 6  # Number of grid points for each turn of e^{-2j omega tau}
# Relative change of the mean squared terms at which the code stops doubling the number of panels
QUADRATURE_TOLERANCE = 1e-9


def response(device: Device, gains: Gains, omega: Floats) -> LoopResponse:
    """Return the velocity loop at frequencies omega > 0, rad/s."""
    return loop_response(device_response(device, omega, FLOATS), gains, FLOATS)


def stability_ratio(
    device: Device, gains: Gains, coupling: AnyCoupling, omega: Floats, *, alone: bool = False
) -> Floats:
    """Return Re Z_c / R; -inf if the loop's resistance is not positive, inf if R <= 0.

    With nothing behind (`alone`), it is the greatest number by which Z_c may be divided.
    """
    loop = response(device, gains, omega)
    return np.where(loop.resistance > 0, (_ratio_alone if alone else _ratio)(loop, coupling, omega), -inf)


def ratio_or_resistance(
    device: Device, gains: Gains, coupling: AnyCoupling, omega: Floats, *, alone: bool = False
) -> Floats:
    """Return `stability_ratio`, or the resistance of the loop relative to |N D| where this resistance is not
    positive."""
    loop = response(device, gains, omega)
    size = np.sqrt(loop.D_scaled.abs2() / loop.scale2 * (1 if loop.numerator is None else loop.numerator.abs2()))
    ratio = (_ratio_alone if alone else _ratio)(loop, coupling, omega)
    return np.where(loop.resistance > 0, ratio, loop.resistance / size)


def _ratio(loop: LoopResponse, coupling: AnyCoupling, omega: Floats) -> Floats:
    needed = llewellyn_excess(loop, FLOATS)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = 2 * loop.resistance * coupling_impedance(series_coupling(coupling), omega).re / needed
    return ratio if loop.operator_relief is None else np.where(needed > 0, ratio, inf)


def _ratio_alone(loop: LoopResponse, coupling: AnyCoupling, omega: Floats) -> Floats:
    held, driven = passive_alone(loop, coupling_impedance(series_coupling(coupling), omega))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(driven < 0, -held / driven, inf)


def sampled_span(problem: Problem) -> tuple[float, float]:
    """Return the part of the stability band that a grid covers."""
    device, band = problem.device, problem.stability.band
    corners = [problem.transparency.band.min, problem.transparency.band.max, problem.nyquist]
    if device.damping > 0:
        corners.append(device.damping / device.mass)
    corners += [2 * pi * value for key, value in device.numbers().items() if key.endswith("_hz")]
    low = band.min if band.min > 0 else min(corners) * 10.0**-END_DECADES
    high = band.max if band.max < inf else max(corners) * 10.0**END_DECADES
    return low, high


def towards_zero(problem: Problem) -> Floats:
    """Return a frequency at which R and Re Z_c have reached their limits for omega -> 0; empty if the band excludes
    0."""
    bounds = problem.bounds
    if problem.stability.band.min > 0 or bounds.position.max == 0:
        return np.zeros(0)
    return np.array([1e-8 * min(sampled_span(problem)[0], bounds.damping.min / bounds.mass.max)])


def demand_grid(device: Device, low: float, high: float) -> Floats:
    """Return a grid for the constraints of a device, fine enough for the ripple of its delays and for its resonance."""
    delay = _ripple_delay(device)
    grid = frequency_grid(low, high, widest=pi / (RIPPLE_POINTS * delay) if delay > 0 else inf)
    return with_resonance(device, grid)


def _ripple_delay(device: Device) -> float:
    """Return the delay, s, whose ripple does not decay with frequency; 0 for hold "lag" without delay."""
    sensor = float(device.sensing.delay)
    if device.hold == "lag" and device.delay == 0 and device.velocity is None:
        return sensor
    return float(device.loop_lag) + sensor


def ratio_minima(problem: Problem, gains: Gains, coupling: AnyCoupling) -> Minima:
    """Return the local minima of Re Z_c / R over the stability band, the lowest first."""
    return local_minima(
        lambda omega: stability_ratio(problem.device, gains, coupling, omega, alone=problem.alone),
        demand_grid(problem.device, *sampled_span(problem)),
    )


def sensitivity_maxima(problem: Problem, gains: Gains) -> Minima:
    """Return the local maxima of |S| of the sampled loop as minima of -|S|, the highest |S| first."""
    device = problem.device
    if not device.kind.own_loop:
        return Minima(np.array([problem.nyquist]), np.array([-1.0]))
    low = min(problem.transparency.band.min, slowest_resonance(problem, gains.velocity))
    grid = frequency_grid(low, problem.nyquist, widest=pi / (RIPPLE_POINTS * device.loop_lag))
    grid = with_resonance(device, grid)
    sensitivity = sensitivity_of(device, gains)
    return local_minima(lambda omega: -sensitivity(omega), grid)


def unmodelled_maxima(problem: Problem, gains: Gains) -> Minima:
    """Return the local maxima of |1 - S| r of the sampled loop as minima of -|1 - S| r, where r is the unmodelled
    radius."""
    device, uncertainty = problem.device, problem.uncertainty
    radii = device.unmodelled.radii if device.unmodelled is not None else uncertainty.unmodelled if uncertainty else ()
    grid = frequency_grid(min(problem.transparency.band.min, problem.nyquist * 1e-3), problem.nyquist)

    def negative(omega: Floats) -> Floats:
        L = loop_gain(device, gains, omega)
        return -np.asarray(np.abs(L / (1 + L)) * FLOATS.interpolated(omega / (2 * pi), radii))

    return local_minima(negative, with_resonance(device, grid))


def slowest_resonance(problem: Problem, velocity: float) -> float:
    """Return a frequency, rad/s, below which |S| has no peak above 1 for any loop with at least this K_v."""
    slowest = (problem.device.damping + velocity) / problem.device.mass / 4
    return min(max(slowest, problem.nyquist * 1e-6), problem.nyquist * 1e-3)


@dataclass(frozen=True, slots=True)
class TransparencyError:
    """The objective, and its unweighted terms |Z_0 G_hh|, |1 - G_he| and |Z_c|/Z_0, in the problem's norm."""

    error: float
    admittance: float
    tracking: float
    coupling: float


def error_terms(problem: Problem, gains: Gains, coupling: AnyCoupling, omega: Floats) -> Terms:
    """Return the squares of the three unweighted terms at some frequencies."""
    device, Z_0 = problem.device, problem.transparency.reference_impedance
    at, kind = device_response(device, omega, FLOATS), device.kind
    of_loop = loop_terms(loop_response(at, gains, FLOATS), at, kind)
    return squared_terms(of_loop, coupling_response(coupling, device, omega), kind.reference(Z_0))


def coupling_response(coupling: AnyCoupling, device: Device, omega: Floats) -> Pair:
    """Return Z_c, N s/m; for an impedance display 1/Z_c, m/(N s)."""
    if not isinstance(coupling, SpringDamper):
        return coupling_impedance(coupling, omega)
    theta = omega * device.sample_time
    low_pass = firmware_filter(device, theta, FLOATS)
    return spring_damper_admittance(coupling, device.sample_time, low_pass, theta, FLOATS)


def weighted_square(weights: Terms, squares: Terms) -> Floats:
    """Return e(f)^2 (model/README.md, section 8) from the squares of the terms."""
    total: Floats = (
        weights.admittance**2 * squares.admittance
        + weights.tracking**2 * squares.tracking
        + weights.coupling**2 * squares.coupling
    )
    return total


def transparency_error(problem: Problem, gains: Gains, coupling: AnyCoupling) -> TransparencyError:
    """Return the error of a design and its three terms, with a relative accuracy of about 1e-9 (model/README.md,
    section 8)."""
    norm = _rms if problem.transparency.norm == "rms" else _peak
    return norm(problem, gains, coupling)


def _columns(problem: Problem, gains: Gains, coupling: AnyCoupling, omega: Floats) -> Floats:
    squares = error_terms(problem, gains, coupling, omega)
    error = weighted_square(problem.weights, squares)
    return np.stack(np.broadcast_arrays(error, squares.admittance, squares.tracking, squares.coupling))


def _rms(problem: Problem, gains: Gains, coupling: AnyCoupling) -> TransparencyError:
    band = problem.transparency.band
    previous = None
    for doubling in range(2, 14):
        nodes, weights = log_quadrature(band.min, band.max, 2**doubling)
        means = _columns(problem, gains, coupling, nodes) @ weights
        if previous is not None and np.all(np.abs(means - previous) <= QUADRATURE_TOLERANCE * means):
            break
        previous = means
    return TransparencyError(*(float(value) for value in np.sqrt(means)))


def _peak(problem: Problem, gains: Gains, coupling: AnyCoupling) -> TransparencyError:
    band = problem.transparency.band
    grid = demand_grid(problem.device, band.min, band.max)

    def peak(row: int) -> float:
        minima = local_minima(lambda omega: -_columns(problem, gains, coupling, omega)[row], grid)
        return float(np.sqrt(-minima.value[0]))

    return TransparencyError(*(peak(row) for row in range(4)))
