"""The optimiser's variables: logarithms, or log(1 + x/scale) for variables that may be 0."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields, replace
from math import exp, expm1, inf, log, log1p

from vctune.analysis.in_worlds import HIGHEST, LOWEST, in_decimals
from vctune.model.gains import AnyCoupling, Coupling, Gains, SpringDamper
from vctune.model.numbers.arithmetic import Number
from vctune.model.problem import Problem, Range

Point = tuple[float, ...]  # The variables of a design in their order
SHOWN_DIGITS = 6  # Digits to which a value on a bound above 0 equals it: a search ends beside it
CORNER = 5  # Index of the corner frequency w_c in a `Point`


def keys_for(problem: Problem) -> tuple[str, ...]:
    """Return the keys of gains and coupling of a problem's designs, in the order of `Point`, without a multiplier's
    corner."""
    return problem.device.kind.keys


def point(gains: Gains, coupling: AnyCoupling) -> Point:
    """Return the variables of a design in the order of `Point`."""
    return (*astuple(gains), *astuple(coupling))


def design_of(values: Point) -> tuple[Gains, AnyCoupling]:
    """Return gains and coupling from their variables."""
    return Gains(*values[:2]), coupling_from(values[2:CORNER])


def coupling_from(values: Sequence[Number]) -> AnyCoupling:
    """Return a coupling from its parameters: b_c, m_c and b_0, or b_c and k_c."""
    return Coupling(*values) if len(values) == len(fields(Coupling)) else SpringDamper(*values)


def ranges(problem: Problem) -> tuple[Range, ...]:
    """Return the ranges of gains and coupling in the order of `Point`, without a multiplier's corner."""
    return tuple(getattr(problem.bounds, name) for name in problem.device.kind.names)


@dataclass(frozen=True, slots=True)
class Coordinate:
    """One free variable x in the coordinate z = log x (scale 0) or z = log(1 + x/scale)."""

    index: int  # index of the variable among a design's variables
    name: str  # name of the variable
    scale: float  # 0, or the size below which changes of x hardly affect a design
    low: float  # bounds of z
    high: float

    def to_z(self, x: float) -> float:
        """Return the coordinate of x."""
        return log1p(x / self.scale) if self.scale > 0 else log(x)

    def to_x(self, z: float) -> float:
        """Return the variable at z."""
        return max(self.scale * expm1(z), 0.0) if self.scale > 0 else exp(z)


def coordinates(problem: Problem, *, integrator: bool) -> tuple[Coordinate, ...]:
    """Return the coordinates of the free variables of a dimensionless problem, with K_p only if there is an
    integrator."""
    device = problem.device
    loop_impedance = device.mass / device.loop_lag + device.damping
    scales = dict.fromkeys(("velocity", "damping"), 0.0001 * loop_impedance)
    scales |= {"position": 1e-2 * problem.transparency.band.min, "drag": 1e-3}
    scales["position"] *= device.damping + problem.bounds.velocity.max
    found = []
    for index, (name, bounds) in enumerate(zip(device.kind.names, ranges(problem), strict=True)):
        if bounds.fixed or (name == "position" and not integrator):
            continue
        scale = min(scales[name], bounds.max) if bounds.min == 0 else 0.0
        bare = Coordinate(index, name, scale, -inf, inf)
        found.append(replace(bare, low=bare.to_z(bounds.min), high=bare.to_z(bounds.max)))
    worlds = problem.worlds
    if worlds is not None and worlds.walls and worlds.corner is None:
        least, most = (2 * share / device.sample_time for share in (LOWEST, HIGHEST))
        found.append(Coordinate(CORNER, "corner", 0.0, log(least), log(most)))
    return tuple(found)


DIGITS = 8  # Number of significant digits in `gains.toml`


def rounded(problem: Problem, values: Point, digits: int = DIGITS) -> Point:
    """Return the variables of a design, rounded to a given number of digits. A value that is near a bound becomes the
    bound."""
    known = tuple(_rounded(value, bounds, digits) for value, bounds in zip(values, ranges(problem), strict=False))
    return (*known, *map(in_decimals, values[len(known) :]))


def _rounded(value: float, bounds: Range, digits: int) -> float:
    for bound in (bounds.min, bounds.max):
        if near(value, bound, bounds, digits):
            return bound
    return min(max(float(f"{value:.{digits}g}"), bounds.min), bounds.max)


def near(value: float, bound: float, bounds: Range, digits: int = DIGITS) -> bool:
    """Return whether a value equals a bound to `digits` digits or, for the bound 0, is negligible beside the upper
    bound."""
    return abs(value - bound) <= (10.0 ** (1 - digits) * abs(bound) if bound else 10.0 ** (-1 - digits) * bounds.max)


def touched(problem: Problem, gains: Gains, coupling: AnyCoupling) -> list[tuple[str, str]]:
    """Return the dotted keys of the free variables that lie on a bound, with the side."""
    sides_touched = list[tuple[str, str]]()
    for key, value, bounds in zip(keys_for(problem), point(gains, coupling), ranges(problem), strict=True):
        sides = () if bounds.fixed else (("upper", bounds.max), ("lower", bounds.min))
        sides_touched += [(key, side) for side, edge in sides if edge and near(value, edge, bounds, SHOWN_DIGITS)]
        sides_touched += [(key, side) for side, edge in sides if not edge and near(value, edge, bounds)]
    return sides_touched
