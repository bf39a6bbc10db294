"""A cheap global scan: starts for the optimiser in every basin it can see (DESIGN 1.9).

For given K_v, K_p and tau_c = m_c/b_c the least admissible b_c is a maximum over frequency in closed form,

    b_c >= (safety_factor R - b_0) (1 + 1/(omega tau_c)^2),

and the error grows with b_c. The search is therefore over (K_v, K_p, tau_c) and, where it is free, b_0. Everything
here works in the problem's dimensionless units (Z_0 = T = 1).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from vctune.analysis.demands import response, sampled_span
from vctune.analysis.extrema import Floats
from vctune.document.problem import Problem, Range
from vctune.model.arithmetic import FLOATS
from vctune.model.llewellyn import required_resistance
from vctune.model.loop import G_hh_abs2, sensitivity_abs2
from vctune.model.quantities import Coupling, Gains
from vctune.model.sampled import return_difference, sampled_plant, whole_samples
from vctune.model.transparency import log_quadrature

COUNTS = {"velocity": 28, "position": 18, "time_constant": 30, "drag": 7}
FREQUENCIES, ANGLES = 64, 128
PANELS = 3
ZOOMS, ZOOM_POINTS = 4, 5
STARTS = 8
INADMISSIBLE = 1e6


@dataclass(frozen=True, slots=True)
class Start:
    """A point worth polishing.

    Attributes
    ----------
    gains, coupling : the point
    error : its transparency error when admissible on the scan's frequencies, else `INADMISSIBLE` plus how far it is off
    """

    gains: Gains
    coupling: Coupling
    error: float

    @property
    def admissible(self) -> bool:
        """Whether the point met every demand at the scan's frequencies."""
        return self.error < INADMISSIBLE


@dataclass(frozen=True, slots=True)
class ScanResult:
    """Starts, best first, and what the scan saw of the demands.

    Attributes
    ----------
    starts : local minima of the scan, best first
    peak_sensitivity : greatest |S| among stable points that meet Re G_hh > 0
    sampling_matters : whether some point that meets the frequency demands has an unstable sampled loop
    """

    starts: list[Start]
    peak_sensitivity: float
    sampling_matters: bool


@dataclass(frozen=True, slots=True)
class _Loops:
    """What the loops of a grid of (K_v, K_p) are worth, before a coupling is chosen; arrays over the grid."""

    required: Floats
    deficit: Floats
    sensitivity: Floats
    stable: NDArray[np.bool_]
    error2: Floats


def scan(problem: Problem) -> ScanResult:
    """Scan a dimensionless problem for starts.

    K_p = 0 is scanned by itself: the integrator's absence changes the low-frequency demands. Minima of the rest that
    lie at its lowest K_p belong to that basin and are left to it.
    """
    faces = _faces(problem)
    found: list[Start] = []
    peak, sampling_matters = 0.0, False
    for integral, drag in product(faces, _axis(problem.bounds.drag, COUNTS["drag"], 1e-4).tolist()):
        axes = _axes(problem, integral)
        score, loops = _scores(problem, *axes, drag)
        promising = loops.deficit == 0
        if np.any(promising & loops.stable):
            peak = max(peak, float(loops.sensitivity[promising & loops.stable].max()))
        sampling_matters |= bool(
            np.any(promising & ~loops.stable & (loops.sensitivity <= problem.stability.max_sensitivity))
        )
        left_to_the_other = integral and False in faces
        for index in _local_minima(score)[:STARTS]:
            if not (left_to_the_other and index[1] == 0):
                found.append(_zoom(problem, axes, drag, index, integral))
    found.sort(key=lambda start: start.error)
    return ScanResult(_distinct(found)[:STARTS], peak, sampling_matters)


def _faces(problem: Problem) -> list[bool]:
    position = problem.bounds.position
    return [integral for integral in (False, True) if (position.min == 0 if not integral else position.max > 0)]


def _axis(bounds: Range, count: int, floor: float) -> Floats:
    """Return a logarithmic grid over the bounds; a range from 0 starts with 0 and `floor`."""
    if bounds.fixed:
        return np.array([bounds.min])
    if bounds.min > 0:
        return _within(np.geomspace(bounds.min, bounds.max, count), bounds)
    return np.concatenate(([0.0], np.geomspace(min(floor, bounds.max / 10), bounds.max, count - 1)))


def _within(values: Floats, bounds: Range) -> Floats:
    return np.clip(values, bounds.min, bounds.max)


def _axes(problem: Problem, integral: bool) -> tuple[Floats, Floats, Floats]:
    """Return K_v, the corner K_p/(b + K_v) of the integral action [rad/s], and tau_c."""
    device, bounds = problem.device, problem.bounds
    low, high = sampled_span(problem)
    loop_impedance = device.mass / device.lag + device.damping
    K_v = _axis(bounds.velocity, COUNTS["velocity"], 1e-5 * loop_impedance)
    corner = np.array([0.0])
    if integral and bounds.position.fixed:
        corner = np.array([1 / device.lag])
    elif integral:
        corner = np.geomspace(1e-2 * problem.transparency.band.min, 2 / device.lag, COUNTS["position"])
    shortest = max(bounds.mass.min / bounds.damping.max, 1e-2 / high)
    longest = min(bounds.mass.max / bounds.damping.min, 1e2 / low)
    tau_c = np.geomspace(shortest, longest, COUNTS["time_constant"]) if longest > shortest else np.array([shortest])
    if bounds.mass.fixed and bounds.damping.fixed:
        tau_c = np.array([bounds.mass.min / bounds.damping.min])
    return K_v, corner, tau_c


def _position(problem: Problem, K_v: Floats, corner: Floats) -> Floats:
    if not np.any(corner):
        return np.zeros_like(K_v * corner)
    return _within((problem.device.damping + K_v) * corner, problem.bounds.position)


def _scores(problem: Problem, K_v: Floats, corner: Floats, tau_c: Floats, drag: float) -> tuple[Floats, _Loops]:
    """Return the error, or `INADMISSIBLE` plus the violation, over the grid K_v x corner x tau_c."""
    grid_v, grid_i = K_v[:, None], corner[None, :]
    loops = _loops(problem, Gains(grid_v + 0 * grid_i, _position(problem, grid_v, grid_i)))
    omega = np.geomspace(*sampled_span(problem), _frequencies(problem))
    b_c, excess = _least_damping(problem, loops.required, omega, tau_c, drag)
    nodes, weights = log_quadrature(problem.transparency.band.min, problem.transparency.band.max, PANELS)
    x2 = (nodes * tau_c[:, None]) ** 2
    share = np.stack((x2, nodes * tau_c[:, None])) / (1 + x2)
    Z_c2 = (drag + b_c[..., None] * share[0]) ** 2 + (b_c[..., None] * share[1]) ** 2
    e2 = loops.error2[:, :, None, :] + problem.transparency.weights.coupling**2 * Z_c2
    error = np.sqrt(e2 @ weights if problem.transparency.norm == "rms" else e2.max(axis=-1))
    rank = _ranked_violation(problem, loops)[:, :, None]
    violation = np.where(rank > 0, rank, excess)
    return np.where(violation > 0, INADMISSIBLE * (1 + violation), error), loops


def _ranked_violation(problem: Problem, loops: _Loops) -> Floats:
    """Return 0 for loops in order; |S|, Re G_hh and instability fail in this order of weight."""
    too_sensitive = np.log(np.maximum(loops.sensitivity / problem.stability.max_sensitivity, 1.0))
    violation = np.where(too_sensitive > 0, 1e3 + too_sensitive, 0.0)
    violation = np.where(loops.deficit > 0, 2e3 + loops.deficit, violation)
    ranked: Floats = np.where(loops.stable, violation, 3e3 + too_sensitive)
    return ranked


def _frequencies(problem: Problem) -> int:
    low, high = sampled_span(problem)
    return max(FREQUENCIES, int(8 * np.log10(high / low)))


def _loops(problem: Problem, gains: Gains) -> _Loops:
    device = problem.device
    spread = Gains(gains.velocity[..., None], gains.position[..., None])
    band = response(device, spread, np.geomspace(*sampled_span(problem), _frequencies(problem)))
    with np.errstate(divide="ignore", invalid="ignore"):
        required = np.where(band.re_D > 0, required_resistance(band, FLOATS), 0.0)
    scale = device.damping + gains.velocity + gains.position * device.lag
    deficit = np.maximum(-band.re_D, 0).max(axis=-1) / scale
    below_nyquist = np.geomspace(min(problem.transparency.band.min, 1e-3), problem.nyquist, FREQUENCIES)
    sensitivity = np.sqrt(sensitivity_abs2(response(device, spread, below_nyquist)).max(axis=-1))
    nodes, _ = log_quadrature(problem.transparency.band.min, problem.transparency.band.max, PANELS)
    loop, weights = response(device, spread, nodes), problem.transparency.weights
    error2 = weights.admittance**2 * G_hh_abs2(loop) + weights.tracking**2 * sensitivity_abs2(loop)
    return _Loops(required, deficit, sensitivity, _sampled_stable(problem, spread), error2)


def _sampled_stable(problem: Problem, gains: Gains) -> NDArray[np.bool_]:
    """Return whether the return difference does not encircle 0, on a grid of angles (an estimate)."""
    whole, fraction = whole_samples(problem.device.delay, problem.device.sample_time)
    remainder = fraction * problem.device.sample_time
    plant = sampled_plant(problem.device, whole, remainder, fraction > 0, FLOATS)
    theta = np.append(np.geomspace(1e-4, np.pi, ANGLES)[:-1], np.pi)
    integrator = bool(np.any(gains.position))
    F = return_difference(plant, theta, FLOATS, integrator=integrator).closed(gains, integrator=integrator)
    turns = np.unwrap(np.arctan2(F.im, F.re), axis=-1)
    stable: NDArray[np.bool_] = (np.abs(turns[..., -1] - turns[..., 0]) < np.pi / 2) & (F.re[..., -1] > 0)
    return stable


def _least_damping(
    problem: Problem, required: Floats, omega: Floats, tau_c: Floats, drag: float
) -> tuple[Floats, Floats]:
    """Return the least b_c within the bounds and log(how far b_c or m_c exceeds its upper bound)."""
    bounds = problem.bounds
    demand = np.maximum(problem.stability.safety_factor * required - drag, 0.0)
    b_c = np.stack([(demand * (1 + 1 / (omega * tau) ** 2)).max(axis=-1) for tau in tau_c], axis=-1)
    b_c = np.maximum(b_c, np.maximum(bounds.damping.min, bounds.mass.min / tau_c))
    slack = 1 + 1e-9
    most = np.minimum(bounds.damping.max, bounds.mass.max / tau_c)
    return b_c, np.where(b_c > most * slack, np.log(b_c / np.maximum(most, 1e-300)), 0.0)


def _local_minima(score: Floats) -> list[tuple[int, ...]]:
    """Return the indices of grid points not above any neighbour, lowest first."""
    padded = np.pad(score, 1, constant_values=np.inf)
    lowest = np.ones(score.shape, dtype=bool)
    for offset in product((-1, 0, 1), repeat=score.ndim):
        window = tuple(slice(1 + d, 1 + d + n) for d, n in zip(offset, score.shape, strict=True))
        lowest &= score <= padded[window]
    found = np.argwhere(lowest)
    order = np.argsort(score[lowest], kind="stable")
    return [tuple(int(i) for i in found[k]) for k in order]


def _zoom(
    problem: Problem, axes: tuple[Floats, Floats, Floats], drag: float, index: tuple[int, ...], integral: bool
) -> Start:
    """Refine a grid minimum between its neighbours."""
    spans = [_neighbours(axis, i) for axis, i in zip(axes, index, strict=True)]
    for _ in range(ZOOMS):
        K_v, corner, tau_c = (_between(*span) for span in spans)
        score, _ = _scores(problem, K_v, corner, tau_c, drag)
        at = tuple(int(i) for i in np.unravel_index(int(np.argmin(score)), score.shape))
        spans = [_neighbours(axis, i) for axis, i in zip((K_v, corner, tau_c), at, strict=True)]
    K_v, corner, tau_c = K_v[at[0], None], corner[at[1], None], tau_c[at[2], None]
    gains = Gains(float(K_v[0]), float(_position(problem, K_v, corner)[0]) if integral else 0.0)
    omega = np.geomspace(*sampled_span(problem), _frequencies(problem))
    loops = _loops(problem, Gains(K_v[:, None], np.array([[gains.position]])))
    b_c = _least_damping(problem, loops.required, omega, tau_c, drag)[0].item()
    bounds = problem.bounds
    coupling = Coupling(
        min(max(b_c, bounds.damping.min), bounds.damping.max),
        min(max(b_c * tau_c.item(), bounds.mass.min), bounds.mass.max),
        drag,
    )
    return Start(gains, coupling, float(score[at]))


def _neighbours(axis: Floats, i: int) -> tuple[float, float, float]:
    return float(axis[max(i - 1, 0)]), float(axis[i]), float(axis[min(i + 1, axis.size - 1)])


def _between(low: float, middle: float, high: float) -> Floats:
    if low == high:
        return np.array([middle])
    if low > 0:
        return np.unique(np.concatenate((np.geomspace(low, high, ZOOM_POINTS), [low, middle, high])))
    return np.unique(np.concatenate((np.linspace(low, high, ZOOM_POINTS), [middle])))


def _distinct(starts: list[Start]) -> list[Start]:
    kept: list[Start] = []
    for start in starts:
        if not any(_close(start, other) for other in kept):
            kept.append(start)
    return kept


def _close(a: Start, b: Start) -> bool:
    def near(x: float, y: float) -> bool:
        return abs(x - y) <= 0.02 * max(abs(x), abs(y))

    return (
        near(a.gains.velocity, b.gains.velocity)
        and near(a.gains.position, b.gains.position)
        and near(a.coupling.damping, b.coupling.damping)
        and near(a.coupling.mass, b.coupling.mass)
        and near(a.coupling.drag, b.coupling.drag)
    )
