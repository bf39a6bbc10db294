"""Compute the coefficients of a firmware, those of the coupling in exact fractions of the design's decimals."""

from __future__ import annotations

from fractions import Fraction
from math import inf

from vctune.model.experiment import Environment
from vctune.model.gains import AnyCoupling, Coupling, SpringDamper, trapezoidal


def exact(decimal: float) -> Fraction:
    """Return the printed decimal of a float as a fraction."""
    return Fraction(repr(float(decimal)))


def coupling_coefficients(
    coupling: AnyCoupling | None, sample_time: float, smoothing: float | None = None, low_passes: int = 0
) -> dict[str, float]:
    """Return the coefficients of a coupling. The coupling of an admittance display or servo follows the trapezoidal
    rule."""
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
    return {
        "coupling_step": float(step),
        "coupling_decay": float(decay),
        "resistance": float(step + exact(coupling.drag)),
    }


def coupling_of(coefficients: dict[str, float], sample_time: float) -> AnyCoupling:
    """Return the coupling that has given coefficients, up to the rounding of its parameters."""
    if "coupling_stiffness" in coefficients:
        return SpringDamper(coefficients["coupling_damping"], coefficients["coupling_stiffness"])
    step, decay = Fraction(coefficients["coupling_step"]), Fraction(coefficients["coupling_decay"])
    drag = float(Fraction(coefficients["resistance"]) - step)
    if decay == -1:
        return Coupling(inf, float(Fraction(sample_time) * step / 2), drag)
    return Coupling(
        damping=float(2 * step / (1 + decay)),
        mass=float(Fraction(sample_time) * step / (1 - decay)),
        drag=drag,
    )


def environment_coefficients(environment: Environment, sample_time: float) -> dict[str, float]:
    """Return the coefficients of an environment. They do not contain its lateness."""
    lossless = environment.rule == "trapezoid"
    reach = {"trapezoid": sample_time / 2, "explicit": 0.0, "backward": sample_time}[environment.rule]
    return {
        "inertance": (2 * environment.mass if lossless else environment.mass) / sample_time,
        "inertia_carry": 1.0 if lossless else 0.0,
        "stiffness": environment.stiffness,
        "zero": environment.zero,
        "slope": environment.damping + reach * environment.stiffness,
        "least_contact": 0.0 if environment.wall else -inf,
    }


def limit_coefficients(limit: float | None, position: float, integral: float) -> dict[str, float]:
    """Return the coefficients of the limit on the force; none without a limit."""
    if limit is None:
        return {}
    return {
        "limit": limit,
        "position_reach": limit / position if position > 0 else inf,
        "integral_reach": limit / integral if integral > 0 else inf,
    }
