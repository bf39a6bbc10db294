"""Find a limit of a robot's speed or acceleration, or of a motor's force, that no device of a fit has (README, section
8)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import Enum
from math import ceil, inf, log, sqrt

import numpy as np
from numpy.typing import NDArray

from vctune.document.recording import Floats
from vctune.identification.fit import TRIED, Fit, Task, fitted
from vctune.identification.search import starts_of
from vctune.identification.stepped import LAGS

LONGEST = 4000  # Rows that are compared
STEPS, MOST_PARTS = 6000, 8  # Steps of a motion, and most of them in a row
SEGMENTS = 16  # Of the compared rows; the position at the start of each is free
COMPARED = 1500  # Rows that choose among the first servos
FIRST_LAGS = (0.03, 0.1, 0.2, 0.4, 0.7, 1.0)  # As shares of the latency that the linear fit has
FIRST_LIMITS = (0.12, 0.2, 0.32, 0.5, 0.65, 0.8, 0.93)  # As shares of the greatest value of the unlimited servo
FIRST_DELAYS = 30  # From none to a quarter more than the latency
NAMES = ("speed", "acceleration")
LIKELY, BEGUN, REFINEMENTS = 4, 3, 8  # Kinds with each limit that are refined, servos of each, and Gauss-Newton steps
LEAST_STEP = 1e-3  # Of a logarithm and, in steps of the motion, of a delay, for slopes
LONGEST_STEP = 0.4  # Greatest change of a logarithm
LEAST_DAMPING, FIRST_DAMPING = 1e-4, 1e-2  # Marquardt's
DECISIVE = 50.0  # Gain in -2 log likelihood, for independent residuals, that shows a limit
PROMISING = 10.0  # The same, of one limit, with which two limits are tried
SECOND_LEAVES = 0.1  # Greatest share of what one limit leaves beyond the noise that a second limit leaves
LEAST_SHARE = 0.25  # Of the squared residual beyond the noise, which a limit explains
DECISIVE_FORCE = 0.5  # Greatest ratio of the residuals with and without a limit of the force
FORCES = (0.95, 0.85, 0.7, 0.55, 0.4, 0.3)  # First limits of a force, as shares of the greatest command


class Place(Enum):
    """What a limit acts on: the command before the low-pass, the low-pass itself, what leaves it, or the low-pass of a
    position, which catches up."""

    COMMAND = "command"
    SERVO = "servo"
    MOTION = "motion"
    LOOP = "loop"


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits that explain a motion; inf for none."""

    speed: float
    acceleration: float


@dataclass(frozen=True, slots=True)
class Kind:
    """A low-pass, what is limited, and where."""

    order: int
    place: Place
    limited: tuple[str, ...]  # of "speed", "acceleration"


@dataclass(frozen=True, slots=True)
class Stretch:
    """The rows of a log that are compared, and the command in steps that divide a row."""

    told: Floats  # m/s in each step, shape (steps,)
    step: float  # s
    rows: NDArray[np.integer]  # the steps at which the compared rows begin, shape (segments, rows)
    measured: Floats  # position or speed at these rows; the mean of a segment's positions is taken out
    reads_position: bool

    def centred(self, values: Floats) -> Floats:
        """Return values of shape (..., rows) without the free position of their segment."""
        return values - values.mean(axis=-1, keepdims=True) if self.reads_position else values

    def every(self, rows: int) -> Stretch:
        """Return the stretch with one row of some."""
        fewer = replace(self, rows=self.rows[:, ::rows], measured=self.measured[:, ::rows])
        return replace(fewer, measured=fewer.centred(fewer.measured))


@dataclass(frozen=True, slots=True)
class Servos:
    """Servos of one kind, a row each: log of the lag in s, delay in steps, logs of the limits in SI units."""

    kind: Kind
    numbers: Floats  # shape (servos, 2 + limits)

    @property
    def lags(self) -> Floats:
        """The lags, s."""
        return np.asarray(np.exp(self.numbers[:, 0]))

    def limit(self, name: str) -> Floats:
        """Return the limits of a name; inf if there are none."""
        if name not in self.kind.limited:
            return np.full(len(self.numbers), inf)
        return np.asarray(np.exp(self.numbers[:, 2 + self.kind.limited.index(name)]))


def rate_limited(goals: Floats, most: Floats) -> Floats:
    """Return what follows goals of shape (steps, servos) and changes in a step by `most` of each servo at the most."""
    if np.all(np.isinf(most)):
        return goals
    followed = np.empty_like(goals)
    speed, least, change = goals[0].copy(), -most, np.empty_like(most)
    for step, goal in enumerate(goals):
        np.subtract(goal, speed, out=change)
        np.minimum(change, most, out=change)
        np.maximum(change, least, out=change)
        speed += change
        followed[step] = speed
    return followed


def over_a_step(order: int, lags: Floats, step: float) -> tuple[Floats, Floats]:
    """Return what speed error and acceleration at the start of a step add to speed and acceleration, each (2, servos).

    The speed error is the speed less the command, which is held. Order 1: v' = (u - v) / lag. Order 2:
    v'' = w^2 (u - v) - sqrt(2) w v', w = sqrt(2) / lag.
    """
    if order == 1:
        nothing = np.zeros_like(lags)
        return np.array([np.expm1(-step / lags), nothing]), np.array([nothing, nothing])
    w = LAGS[2] / lags
    b = w / sqrt(2)
    decay, cosine, sine = np.exp(-b * step), np.cos(b * step), np.sin(b * step)
    of_speed = np.array([decay * (cosine + sine) - 1, decay * sine / b])
    return of_speed, np.array([-decay * w * w * sine / b, decay * (cosine - sine)])


def low_passed(goals: Floats, order: int, lags: Floats, step: float) -> Floats:
    """Return the speeds (steps, servos) at the starts of steps, of the low-pass of goals (steps, servos), from rest at
    the first."""
    from scipy.signal import lfilter

    (error, slope), (pull, stay) = over_a_step(order, lags, step)
    speeds = np.empty_like(goals)
    for servo, column in enumerate((goals - goals[0]).T):
        F = np.array([[1 + error[servo], slope[servo]], [pull[servo], stay[servo]]])
        G = -F[:, 0] + (1.0, 0.0)
        over = [0.0, G[0], F[0, 1] * G[1] - F[1, 1] * G[0]]
        under = [1.0, -F[0, 0] - F[1, 1], F[0, 0] * F[1, 1] - F[0, 1] * F[1, 0]]
        speeds[:, servo] = lfilter(over, under, column)
    return speeds + goals[0]


def limited_low_pass(told: Floats, order: int, lags: Floats, step: float, speed: Floats, most: Floats) -> Floats:
    """Return the speeds of low-passes whose own speed is limited, and changes by `most` in a step at the most."""
    (error, slope), (pull, stay) = over_a_step(order, lags, step)
    speeds = np.empty((told.size, lags.size))
    v, a = np.clip(told[0], -speed, speed), np.zeros_like(lags)
    off, change, other = np.empty_like(lags), np.empty_like(lags), np.empty_like(lags)
    for row, goal in enumerate(told.tolist()):
        speeds[row] = v
        np.subtract(v, goal, out=off)
        np.multiply(error, off, out=change)
        if order == 2:
            np.multiply(slope, a, out=other)
            change += other
            a *= stay
            np.multiply(pull, off, out=other)
            a += other
        np.minimum(change, most, out=change)
        np.maximum(change, -most, out=change)
        v += change
        np.minimum(v, speed, out=v)
        np.maximum(v, -speed, out=v)
    return speeds


def limited_loop(told: Floats, order: int, lags: Floats, step: float, speed: Floats, most: Floats) -> Floats:
    """Return the speeds of low-passes of a position P, P' = u, whose speed and its change in a step are limited.

    Order 1 wants the speed (P - x) / lag, order 2 the acceleration w^2 (P - x) - sqrt(2) w x'. What a limit takes away
    stays in P - x, and the motion catches up. A step is that of the linear low-pass, whose change of speed is clipped;
    the way is the trapezoid of the speeds, and what the linear low-pass moves beyond its own.
    """
    (error, slope), (pull, stay) = over_a_step(order, lags, step)
    w = LAGS[2] / lags
    speeds = np.empty((told.size, lags.size))
    v = np.clip(told[0], -speed, speed)
    wanted = np.full_like(lags, told[0]) if order == 1 else np.zeros_like(lags)
    for row, goal in enumerate(told.tolist()):
        speeds[row] = v
        if order == 1:
            off = wanted - goal
            linear = wanted + error * off
            beyond = -off * (lags * error + 0.5 * step * (2 + error))
        else:
            off = v - goal
            linear = v + error * off + slope * wanted
            ahead = pull * off + stay * wanted
            beyond = -(sqrt(2) * w * (linear - v) + ahead - wanted) / w**2 - 0.5 * step * (off + linear - goal)
        after = v + np.minimum(np.maximum(linear - v, -most), most)
        after = np.minimum(np.maximum(after, -speed), speed)
        missed = step * goal - 0.5 * step * (v + after) - beyond
        wanted = wanted + (missed / lags if order == 1 else w * (w * missed - sqrt(2) * (after - v)))
        v = after
    return speeds


def speeds_of(servos: Servos, told: Floats, step: float) -> Floats:
    """Return the speed of each servo without its delay at the starts of the steps, shape (steps, servos)."""
    order, place = servos.kind.order, servos.kind.place
    speed, most = servos.limit("speed"), servos.limit("acceleration") * step
    if place is Place.SERVO:
        return limited_low_pass(told, order, servos.lags, step, speed, most)
    if place is Place.LOOP:
        return limited_loop(told, order, servos.lags, step, speed, most)
    goals = np.repeat(told[:, None], speed.size, axis=1)
    if place is Place.COMMAND:
        return low_passed(rate_limited(np.clip(goals, -speed, speed), most), order, servos.lags, step)
    return rate_limited(np.clip(low_passed(goals, order, servos.lags, step), -speed, speed), most)


@dataclass(frozen=True, slots=True)
class Motion:
    """Motions without a delay at the starts of the steps, each of shape (steps, servos)."""

    values: Floats  # what is read: position or speed
    slopes: Floats  # its change per step


def motion_of(servos: Servos, stretch: Stretch) -> Motion:
    """Return what the log would read of servos without their delay."""
    speeds = speeds_of(servos, stretch.told, stretch.step)
    if not stretch.reads_position:
        return Motion(speeds, np.gradient(speeds, axis=0))
    way = np.cumsum(0.5 * stretch.step * (speeds[1:] + speeds[:-1]), axis=0)
    return Motion(np.concatenate([np.zeros((1, way.shape[1])), way]), speeds * stretch.step)


def late(motion: Motion, stretch: Stretch, delays: Floats) -> Floats:
    """Return motions of servos at the compared rows after delays in steps, shape (servos, segments, rows).

    Between two steps, a motion is the cubic of its values and slopes.
    """
    whole = np.floor(delays).astype(int)
    s = (1 - (delays - whole))[:, None, None]  # place between the steps
    first = np.clip(stretch.rows - 1 - whole[:, None, None], 0, len(motion.values) - 2)
    servo = np.arange(delays.size)[:, None, None]
    x, y = motion.values[first, servo], motion.values[first + 1, servo]
    if not stretch.reads_position:
        return np.asarray(x + s * (y - x))
    p, q = motion.slopes[first, servo], motion.slopes[first + 1, servo]
    return np.asarray(x + s * (p + s * (3 * (y - x) - 2 * p - q + s * (2 * (x - y) + p + q))))


def left_of(made: Floats, stretch: Stretch) -> Floats:
    """Return what motions of shape (servos, segments, rows), each times its best gain, leave of the measured one."""
    centred = stretch.centred(made)
    power = np.einsum("ijk,ijk->i", centred, centred) + 1e-300
    gains = np.einsum("ijk,jk->i", centred, stretch.measured) / power
    return np.asarray(stretch.measured - gains[:, None, None] * centred)


def squares(left: Floats) -> Floats:
    """Return the sum of squares of each servo's residual; inf where a first servo is unstable in steps."""
    return np.nan_to_num(np.einsum("ijk,ijk->i", left, left), nan=inf, posinf=inf)


def refined(servos: Servos, stretch: Stretch) -> tuple[Servos, Floats]:
    """Return servos after Gauss-Newton steps in all their numbers, and what they leave.

    Each servo is damped by itself, by Marquardt's rule. No delay is negative.
    """
    numbers, count = servos.numbers.copy(), servos.numbers.shape[1]
    damping = np.full(len(numbers), FIRST_DAMPING)
    left, slopes = _slopes(replace(servos, numbers=numbers), stretch)
    for _ in range(REFINEMENTS):
        flat, table = left.reshape(len(numbers), -1), slopes.reshape(len(numbers), count, -1)
        normal, pull = table @ table.transpose(0, 2, 1), np.einsum("ijk,ik->ij", table, flat)
        size = np.einsum("ijj->ij", normal)
        damped = (
            normal + np.eye(count) * (size * damping[:, None] + 1e-12 * size.max(axis=1)[:, None] + 1e-300)[:, None]
        )
        change = -np.linalg.solve(damped, pull[:, :, None])[:, :, 0]
        longest = np.full(count, LONGEST_STEP)
        longest[1] = inf
        trial = numbers + np.clip(change, -longest, longest)
        trial[:, 1] = np.maximum(trial[:, 1], 0.0)
        trial_left, trial_slopes = _slopes(replace(servos, numbers=trial), stretch)
        better = squares(trial_left) < squares(left)
        damping = np.where(better, np.maximum(damping / 5, LEAST_DAMPING), damping * 5)
        numbers[better], left[better], slopes[better] = trial[better], trial_left[better], trial_slopes[better]
    return replace(servos, numbers=numbers), left


def _slopes(servos: Servos, stretch: Stretch) -> tuple[Floats, Floats]:
    """Return what servos leave, shape (servos, segments, rows), and its slopes, (servos, numbers, segments, rows)."""
    numbers = servos.numbers
    count, kinds = numbers.shape
    moved = [numbers + LEAST_STEP * (np.arange(kinds) == which) for which in range(kinds) if which != 1]
    motion = motion_of(replace(servos, numbers=np.concatenate([numbers, *moved])), stretch)
    delays = np.tile(numbers[:, 1], kinds)
    residuals = left_of(late(motion, stretch, delays), stretch).reshape(kinds, count, *stretch.rows.shape)
    still = Motion(motion.values[:, :count], motion.slopes[:, :count])
    later = left_of(late(still, stretch, numbers[:, 1] + LEAST_STEP), stretch)
    ahead = np.insert(residuals[1:], 1, later, axis=0)
    return residuals[0], (ahead - residuals[0]).swapaxes(0, 1) / LEAST_STEP


def stretch_of(fit: Fit) -> Stretch:
    """Return the rows that a linear fit explains worst, `LONGEST` at most, and the command from which they follow."""
    drive, settled = fit.task.drive, int(fit.task.starts[0])
    count = min(drive.input.size - settled, LONGEST) // SEGMENTS * SEGMENTS
    energy = np.zeros(drive.input.size + 1)
    energy[fit.task.starts[:, None] + np.arange(fit.task.rows) + 1] = fit.left[:, 0].T ** 2
    before = np.cumsum(energy)
    first = settled + int(np.argmax(before[settled + count :] - before[settled : before.size - count]))
    begin = first - settled
    parts = min(max(STEPS // (settled + count), 1), MOST_PARTS)
    told = np.repeat(drive.input[begin : first + count], parts)
    rows = first + np.arange(count).reshape(SEGMENTS, -1)
    stretch = Stretch(told, drive.T / parts, (rows - begin) * parts, fit.task.read[rows, 0], drive.reads[0] == 0)
    return replace(stretch, measured=stretch.centred(stretch.measured))


@dataclass(frozen=True, slots=True)
class Grid:
    """Servos of one kind from which a refinement starts, the best first."""

    servos: Servos
    cost: float  # sum of squares that the first leaves, of every few rows

    @property
    def limited(self) -> tuple[str, ...]:
        """The names of the limits."""
        return self.servos.kind.limited


def grid_of(kind: Kind, stretch: Stretch, latency: float) -> Grid:
    """Return servos of a kind from a grid of lags and limits, each with the best of some delays.

    The lags are shares of the latency of the linear fit, s; the limits are shares of the greatest speed or acceleration
    that the servo with this lag would have without them.
    """
    coarse = stretch.every(ceil(stretch.rows.size / COMPARED))
    lags = [max(share * latency, 0.5 * stretch.step) for share in FIRST_LAGS]
    unlimited = Servos(Kind(kind.order, Place.COMMAND, ()), np.log([[lag, 1.0] for lag in lags]))
    speeds = speeds_of(unlimited, stretch.told, stretch.step)
    greatest = {name: greatest_of(speeds, name, stretch.step) for name in kind.limited}
    numbers = np.array(
        [
            [log(lag), 0.0, *(log(share * greatest[name][row]) for name in kind.limited)]
            for row, lag in enumerate(lags)
            for share in (FIRST_LIMITS if kind.limited else (1.0,))
        ]
    )
    motion = motion_of(Servos(kind, numbers), coarse)
    delays = np.linspace(0.0, 1.25 * latency / stretch.step + 2, FIRST_DELAYS)
    costs = np.array([squares(left_of(late(motion, coarse, np.full(len(numbers), delay)), coarse)) for delay in delays])
    numbers[:, 1] = delays[np.argmin(costs, axis=0)]
    best_first = np.argsort(costs.min(axis=0))
    return Grid(Servos(kind, numbers[best_first]), float(costs.min()))


def greatest_of(speeds: Floats, name: str, step: float) -> Floats:
    """Return the greatest speed or acceleration, by its name, of speeds of shape (steps, servos)."""
    values = speeds if name == "speed" else np.diff(speeds, axis=0) / step
    return np.asarray(np.abs(values).max(axis=0))


@dataclass(frozen=True, slots=True)
class Explanation:
    """The best servo of a kind, and what it leaves, shape (segments, rows)."""

    servos: Servos  # one
    left: Floats

    @property
    def cost(self) -> float:
        """The sum of the squares of what is left, in deviations of the noise."""
        return float(np.sum(self.left**2))

    def likelier_than(self, other: Explanation) -> float:
        """Return the gain in -2 log likelihood over another, for as many rows as are independent."""
        flat = self.left - self.left.mean(axis=1, keepdims=True)
        lags = [float(np.sum(flat[:, k:] * flat[:, : flat.shape[1] - k])) for k in range(flat.shape[1] // 2)]
        ends = next((k for k, value in enumerate(lags) if value <= 0), len(lags))
        inflation = 2 * sum(lags[:ends]) / (lags[0] + 1e-300) - 1
        return flat.size / max(inflation, 1.0) * log(other.cost / self.cost)


def best_of(servos: Servos, stretch: Stretch, kept: int) -> Explanation:
    """Return the best servo after refinement of the first few."""
    some, left = refined(replace(servos, numbers=servos.numbers[:kept]), stretch)
    best = int(np.argmin(squares(left)))
    return Explanation(replace(some, numbers=some.numbers[best : best + 1]), left[best])


def limits_of(fit: Fit, *, told_position: bool) -> Limits | None:
    """Return the limits that explain what linear servos leave of a motion; None if there are none.

    The linear servos of both orders, and those with one limit, begin from a grid, and Gauss-Newton steps refine the
    best; the best with a limit of each name then get the other limit as well. Limits are there if they make the motion
    likelier than the best linear servo by `DECISIVE`, and explain `LEAST_SHARE` of what that leaves beyond the noise.
    """
    stretch = stretch_of(fit)
    latency = max(fit.known["delay"] + fit.known["lag"], fit.task.drive.T)
    unlimited = [grid_of(Kind(order, Place.COMMAND, ()), stretch, latency) for order in (1, 2)]
    linear = least(best_of(grid.servos, stretch, BEGUN) for grid in unlimited)
    places = [place for place in Place if told_position or place is not Place.LOOP]
    kinds = [Kind(order, place, (name,)) for order in (1, 2) for place in places for name in NAMES]
    grids = sorted((grid_of(kind, stretch, latency) for kind in kinds), key=lambda grid: grid.cost)
    best_of_name = list[Explanation]()
    for name in NAMES:
        likely = [grid for grid in grids if grid.limited == (name,)][:LIKELY]
        best_of_name.append(least(best_of(grid.servos, stretch, BEGUN) for grid in likely))
    one = least(best_of_name)
    if one.likelier_than(linear) < PROMISING:
        return None
    both = least(best_of(with_both(single, stretch), stretch, len(FIRST_LIMITS)) for single in best_of_name)
    noise = linear.left.size
    explains_the_rest = both.cost - noise < SECOND_LEAVES * max(one.cost - noise, 0.0)
    second_is_there = explains_the_rest and both.likelier_than(one) > DECISIVE
    best = both if second_is_there or not shows_a_limit(one, linear) else one
    if not shows_a_limit(best, linear):
        return None
    servos = best.servos
    return Limits(float(servos.limit("speed")[0]), float(servos.limit("acceleration")[0]))


def shows_a_limit(limited: Explanation, linear: Explanation) -> bool:
    """Return whether a servo with limits explains a motion decisively better than the best linear one."""
    beyond = max(linear.cost - linear.left.size, 0.0)
    explained = linear.cost - limited.cost
    return limited.likelier_than(linear) > DECISIVE and explained > LEAST_SHARE * beyond


def least(explanations: Iterable[Explanation]) -> Explanation:
    """Return the explanation that leaves the least."""
    return min(explanations, key=lambda explanation: explanation.cost)


def with_both(explanation: Explanation, stretch: Stretch) -> Servos:
    """Return the servo of an explanation with one limit, with several limits of the other name as well."""
    servos = explanation.servos
    speeds = speeds_of(servos, stretch.told, stretch.step)
    (limited,) = servos.kind.limited
    other = NAMES[1 - NAMES.index(limited)]
    others = np.log(np.array(FIRST_LIMITS) * greatest_of(speeds, other, stretch.step))[:, None]
    numbers = np.hstack([np.repeat(servos.numbers, len(others), axis=0), others])
    return Servos(replace(servos.kind, limited=(limited, other)), numbers)


def force_limit_of(fit: Fit) -> float | None:
    """Return the limit of the motor's force without which a mechanism leaves at least twice as much of the motion, or
    of the force that a regression finds; None if there is none."""
    drive, peak = fit.task.drive, float(np.abs(fit.task.drive.input).max())

    def at(limit: float) -> Task:
        return replace(fit.task, drive=replace(drive, input=np.clip(drive.input, -limit, limit)), white=(1.0,))

    def left(limit: float) -> tuple[float, float]:
        task = at(limit)
        return fitted(task, fit.numbers, fit.first, TRIED, 1e-3).size, starts_of(task)[0].share

    *found, (size, share) = [left(each * peak) for each in (*FORCES, 1.0)]
    best = [min((each[way] / without, i) for i, each in enumerate(found)) for way, without in ((0, size), (1, share))]
    ratio, place = min(best)
    return FORCES[place] * peak if ratio < DECISIVE_FORCE else None
