"""Compute the coefficients of a firmware, those of the coupling in exact fractions of the design's decimals."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import inf

from vctune.model.experiment import Environment
from vctune.model.gains import AnyCoupling, Coupling, SpringDamper, trapezoidal
from vctune.model.numbers.arithmetic import Number


def exact(decimal: float) -> Fraction:
    """Return the printed decimal of a float as a fraction."""
    return Fraction(repr(float(decimal)))


def coupling_coefficients(
    coupling: AnyCoupling | None, sample_time: float, smoothing: float | None = None, low_passes: int = 0
) -> dict[str, float]:
    """Return the coefficients of a coupling. That of an admittance display or servo follows the trapezoidal rule."""
    if coupling is None:
        return {"resistance": 0.0}
    if isinstance(coupling, SpringDamper):
        at_once = exact(1.0 if smoothing is None else smoothing) ** low_passes
        resistance = exact(coupling.stiffness) * exact(sample_time) + exact(coupling.damping) * at_once
        return {
            "coupling_stiffness": coupling.stiffness,
            "coupling_damping": coupling.damping,
            "resistance": float(resistance),
        }
    damping = coupling.damping if coupling.rigid else exact(coupling.damping)
    step, decay = trapezoidal(Coupling(damping, exact(coupling.mass), 0), exact(sample_time))
    resistance = step + exact(coupling.drag)
    return {"coupling_step": float(step), "coupling_decay": float(decay), "resistance": float(resistance)}


def coupling_of(coefficients: dict[str, float], sample_time: float) -> AnyCoupling:
    """Return the coupling that has given coefficients, up to the rounding of its parameters."""
    if "coupling_stiffness" in coefficients:
        return SpringDamper(coefficients["coupling_damping"], coefficients["coupling_stiffness"])
    step, decay = coefficients["coupling_step"], coefficients["coupling_decay"]
    damping = inf if decay == -1 else 2 * step / (1 + decay)
    return Coupling(damping, mass=sample_time * step / (1 - decay), drag=coefficients["resistance"] - step)


@dataclass(frozen=True, slots=True)
class Rendering:
    """The coefficients of a rendered environment."""

    inertance: Number  # M/T, N s/m; twice that by the trapezoidal rule
    inertia_carry: Number  # 1 by the trapezoidal rule, else 0
    stiffness: Number
    zero: Number
    slope: Number  # force of spring and damper per v_e, N s/m
    least_contact: Number  # least force of spring and damper, N: 0 at a wall, else -inf
    explicit: bool = False  # whether it follows explicit Euler
    late: int = 0  # number of samples by which its force is late


def rendering(environment: Environment, sample_time: Number) -> Rendering:
    """Return the coefficients of an environment, in the precision of its numbers."""
    T, trapezoid = sample_time, environment.rule == "trapezoid"
    reach = {"trapezoid": T / 2, "explicit": 0.0, "backward": T}[environment.rule]
    return Rendering(
        inertance=(2 * environment.mass if trapezoid else environment.mass) / T,
        inertia_carry=1.0 if trapezoid and environment.mass > 0 else 0.0,
        stiffness=environment.stiffness,
        zero=environment.zero,
        slope=environment.damping + reach * environment.stiffness,
        least_contact=0.0 if environment.wall else -inf,
        explicit=environment.rule == "explicit",
        late=environment.late,
    )
