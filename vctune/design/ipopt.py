"""IPOPT on a compiled NLP: numbers for its parameters, bounds for its demands, its answer as plain data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, log, pi

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.analysis.sampled_loop import plant_of, pulse_transfer
from vctune.design.nlp import COLUMN, PULSE, compiled
from vctune.design.prepared import Posed
from vctune.design.result import Solution
from vctune.design.shape import TERMS, Place, Shape, WorkingSet, stacked
from vctune.design.variables import Coordinate, Point
from vctune.interrupt import interrupt_deferred
from vctune.model.arithmetic import FLOATS
from vctune.model.loop import hold_response
from vctune.model.problem import Problem
from vctune.model.quantities import Device
from vctune.model.transparency import log_quadrature

NEAR_SIDE = 1e-2
"""Distance at which a point counts as on a side of a box: where the error is flat IPOPT stays off by its barrier."""
REACH = 0.5
"""How far the NLP may follow a peak of |S|, in log frequency."""


@dataclass(frozen=True, slots=True)
class NlpNumbers:
    """The numbers of an NLP: where to start, its parameters, bounds of its variables and of its constraints."""

    guess: Floats
    parameters: Floats
    low: Floats
    high: Floats
    least: Floats
    most: Floats


def numbers_of(
    posed: Posed,
    shape: Shape,
    free: tuple[Coordinate, ...],
    start: Point,
    box: tuple[Floats, Floats],
    frequencies: WorkingSet,
    tightening: float,
) -> NlpNumbers:
    """Return the numbers of the NLP of a dimensionless problem on the given frequencies.

    Parameters
    ----------
    start : the five numbers to start from; those that are not free stay
    box : bounds of the coordinates
    tightening : relative amount by which the demands are sharpened, to leave room for rounding the result
    """
    problem = posed.problem
    low, high = (list(bound) for bound in box)
    guess = [min(max(c.to_z(start[c.index]), lo), hi) for c, lo, hi in zip(free, low, high, strict=True)]
    y = [log(place.omega) for place in frequencies.moving]
    low, high, guess = [*low, *(at - REACH for at in y)], [*high, *(min(at + REACH, log(pi)) for at in y)], [*guess, *y]
    if shape.epigraph:
        low, high, guess = [*low, -inf], [*high, inf], [*guess, 0.0]
    least, most = _demands(problem, shape, frequencies, tightening)
    parameters = _parameters(posed, shape, free, start, frequencies)
    return NlpNumbers(np.array(guess), parameters, np.array(low), np.array(high), least, most)


def solve(shape: Shape, given: NlpNumbers) -> Solution:
    """Solve the NLP of a shape with the given numbers. Ctrl-C waits for IPOPT's answer."""
    with interrupt_deferred():
        solver = compiled(shape)
        result = solver(
            x0=given.guess, p=given.parameters, lbx=given.low, ubx=given.high, lbg=given.least, ubg=given.most
        )
        z, error, multipliers = (np.array(result[name]).ravel() for name in ("x", "f", "lam_g"))
        stats = solver.stats()
    gains = len(shape.free)
    peaks = slice(gains, gains + shape.moving)
    room = np.minimum(z[peaks] - given.low[peaks], given.high[peaks] - z[peaks])
    return Solution(
        z=z[:gains],
        error=float(np.exp(error[0])),
        converged=stats["return_status"] in ("Solve_Succeeded", "Solved_To_Acceptable_Level"),
        followed=bool(np.all(room > NEAR_SIDE)),
        iterations=int(stats["iter_count"]),
        multipliers=np.abs(multipliers[given.least > -inf]),
    )


def _parameters(
    posed: Posed, shape: Shape, free: tuple[Coordinate, ...], start: Point, frequencies: WorkingSet
) -> Floats:
    problem = posed.problem
    device, weights = problem.device, problem.transparency.weights
    scales = np.zeros(5)
    for coordinate in free:
        scales[coordinate.index] = coordinate.scale
    common = [device.mass, device.damping, *scales, *start, *(getattr(weights, term) for term in TERMS)]
    if shape.held and device.operator is not None:
        common += [device.operator.damping, problem.stability.safety_factor]
    parts = [np.array(common)]
    if shape.norm == "rms":
        band = problem.transparency.band
        nodes, averages = log_quadrature(band.min, band.max, shape.panels)
        for case in posed.objective:
            columns = _columns(shape, case.device, nodes)
            parts.append(np.vstack((columns, averages)).ravel(order="F"))
    cuts = np.array([(cut.open, cut.velocity, cut.position) for cut in frequencies.stability]).reshape(-1, 3).T
    for count, columns in zip(
        shape.slots,
        (
            _at_places(shape, frequencies.ratio),
            _pulses(frequencies.sensitivity, position=shape.integrator),
            cuts,
            _at_places(shape, frequencies.peak),
        ),
        strict=True,
    ):
        last = columns[:, -1:] if columns.shape[1] else np.zeros((columns.shape[0], 1))
        filling = np.repeat(last, count - columns.shape[1], axis=1)
        parts.append(np.hstack((columns, filling)).ravel(order="F"))
    parts += [_plant(place.device) for place in frequencies.moving]
    return np.concatenate(parts)


def _at_places(shape: Shape, places: Sequence[Place]) -> Floats:
    return _columns(shape, *stacked(places)) if places else np.zeros((COLUMN[shape.uncertain], 0))


def _pulses(places: Sequence[Place], *, position: bool) -> Floats:
    if not places:
        return np.zeros((PULSE, 0))
    G_v, G_x = pulse_transfer(*stacked(places), position=position)
    return np.vstack((G_v.real, G_v.imag, G_x.real, G_x.imag))


def _plant(device: Device) -> Floats:
    plant = plant_of(device)
    return np.array([plant.pole, plant.slack, plant.drift, *plant.velocity, *plant.position, plant.whole])


def _columns(shape: Shape, device: Device, omega: Floats) -> Floats:
    hold = hold_response(device, omega, FLOATS)
    rows = [omega, hold.re, hold.im]
    if shape.uncertain:
        rows += [np.broadcast_to(device.mass, omega.shape), np.broadcast_to(device.damping, omega.shape)]
    return np.vstack(rows)


def _demands(problem: Problem, shape: Shape, frequencies: WorkingSet, tightening: float) -> tuple[Floats, Floats]:
    stability = problem.stability
    levels = (
        log(stability.safety_factor) + tightening,
        -log(stability.max_sensitivity) + tightening,
        0.0,
        0.0,
    )
    lower = [
        np.where(np.arange(count) < used, level, -inf)
        for count, used, level in zip(shape.slots, frequencies.sizes(), levels, strict=True)
    ]
    followed = np.tile([levels[1], 0.0], shape.moving)
    free = (np.full(sum(shape.slots), inf), np.tile([inf, 0.0], shape.moving), np.full(shape.errors, inf))
    return np.concatenate((*lower, followed, np.zeros(shape.errors))), np.concatenate(free)
