"""The design variables as the optimiser sees them: logarithms, or log(1 + x/scale) where x may be 0."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, expm1, inf, log, log1p

from vctune.model.problem import Bounds, Problem, Range
from vctune.model.quantities import Coupling, Gains

NAMES = ("velocity", "position", "damping", "mass", "drag")

Point = tuple[float, float, float, float, float]
"""K_v, K_p, b_c, m_c, b_0."""


def point(gains: Gains, coupling: Coupling) -> Point:
    """Return the five numbers of a design in the order of `NAMES`.

    Parameters
    ----------
    gains, coupling : in any units, which stay
    """
    return (gains.velocity, gains.position, coupling.damping, coupling.mass, coupling.drag)


def design_of(values: Point) -> tuple[Gains, Coupling]:
    """Return gains and coupling from their five numbers."""
    return Gains(values[0], values[1]), Coupling(values[2], values[3], values[4])


def ranges(bounds: Bounds) -> tuple[Range, ...]:
    """Return the five ranges in the order of `NAMES`."""
    return tuple(getattr(bounds, name) for name in NAMES)


@dataclass(frozen=True, slots=True)
class Coordinate:
    """One free variable x in the coordinate z = log x (scale 0) or z = log(1 + x/scale).

    Attributes
    ----------
    index : position in `NAMES`
    scale : 0, or the size below which x hardly matters, so that x = 0 is an ordinary point
    low, high : bounds of z
    """

    index: int
    scale: float
    low: float
    high: float

    @property
    def name(self) -> str:
        """Its name, of `NAMES`."""
        return NAMES[self.index]

    def to_z(self, x: float) -> float:
        """Return the coordinate of x."""
        return log1p(x / self.scale) if self.scale > 0 else log(x)

    def to_x(self, z: float) -> float:
        """Return the variable at z."""
        return max(self.scale * expm1(z), 0.0) if self.scale > 0 else exp(z)


def coordinates(problem: Problem, *, integrator: bool) -> tuple[Coordinate, ...]:
    """Return the coordinates of the free variables of a dimensionless problem; K_p only with an integrator.

    Parameters
    ----------
    problem : dimensionless
    integrator : whether the law has its term K_p/s

    Returns
    -------
    tuple of Coordinate
        In the order of `NAMES`, without those that are fixed.
    """
    device = problem.device
    loop_impedance = device.mass / device.loop_lag + device.damping
    scales = {"velocity": 1e-4 * loop_impedance, "position": 1e-2 * problem.transparency.band.min, "drag": 1e-3}
    scales["position"] *= device.damping + problem.bounds.velocity.max
    found = []
    for index, (name, bounds) in enumerate(zip(NAMES, ranges(problem.bounds), strict=True)):
        if bounds.fixed or (name == "position" and not integrator):
            continue
        scale = min(scales[name], bounds.max) if bounds.min == 0 else 0.0
        bare = Coordinate(index, scale, -inf, inf)
        found.append(Coordinate(index, scale, bare.to_z(bounds.min), bare.to_z(bounds.max)))
    return tuple(found)
