"""Find requirements that no design can meet, by theorems, and state the values that would have to change."""

from __future__ import annotations

from math import inf, pi, sqrt

from vctune.design.search.infeasible import OPENINGS, Infeasibility
from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains
from vctune.model.hands import Hands
from vctune.model.loop.limits import EndLimit, high_frequency_limit, lags, low_frequency_limit
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.units import UNITS
from vctune.model.problem import Problem

LEAST_POSITION = 5e-324  # The smallest positive double, for K_p


def impossible(problem: Problem) -> Infeasibility | None:
    """Return the theorem that excludes every design of the problem, or None."""
    if problem.device.kind.inverse:
        return _without_damping(problem)
    found = _of_passive_hands(problem) if problem.passive else None
    if found is None and problem.hands_met is not None:
        return _at_zero_in_hands(problem, problem.hands)
    return None if found is None else Infeasibility(*found, proved=True)


def _without_damping(problem: Problem) -> Infeasibility | None:
    """Exclude an impedance display without damping in any passive hand: such a hand may answer with any motion."""
    if not problem.any_hand or problem.device.least_damping > 0 or problem.device.structure is not None:
        return None
    cause = (
        f"device.damping is 0: any passive hand, or none, may answer any {problem.units.force_name} with any motion, "
        "so that R is infinite"
    )
    return Infeasibility(cause, 'state the device\'s damping, or ask for stability.criterion = "hands"', proved=True)


def _of_passive_hands(problem: Problem) -> tuple[str, str] | None:
    found = _vanishing_response(problem) or _negative_resistance(problem)
    if found is None and problem.stability.band.min == 0:
        found = _at_zero(problem)
    if found is None and problem.stability.band.max == inf:
        found = _at_infinity(problem)
    return found


def _at_zero_in_hands(problem: Problem, hands: Hands) -> Infeasibility | None:
    """Compare R with Re Z_c at omega = 0 in hands."""
    device, bounds, units = problem.device, problem.bounds, problem.units
    if problem.worlds is not None:  # near omega = 0 an environment with a greatest mass needs no drag
        return None
    if bounds.drag.max > 0 or bounds.velocity.max == 0 or hands.low.damping > 0 or hands.low.stiffness > 0:
        return None
    soft_and_light = hands.low.mass == 0 and hands.high.stiffness > 0
    lossy = device.structure is None and (device.damping > 0 or lags(device, FLOATS).sensor > 0)
    integrated = (
        f"in hands without {units.mass_name} and damping and of little stiffness K the required R is K (b/K_p + tau_s) "
        f"at 0 Hz, but Re Z_c is the drag, 0 {units.damping}"
    )
    remedy = "allow some coupling.drag, or raise operator.damping.min"
    if bounds.position.min > 0:
        return Infeasibility(integrated, remedy, proved=True) if soft_and_light and lossy else None
    if bounds.position.max > 0 and not (soft_and_light and lossy):
        return None
    cause = f"{OPENINGS[False]}: with K_p = 0 both R and Re Z_c vanish at 0 Hz in hands without damping and stiffness"
    return Infeasibility(
        f"{cause}; with K_p > 0, {integrated}" if bounds.position.max > 0 else cause, remedy, proved=False
    )


def _vanishing_response(problem: Problem) -> tuple[str, str] | None:
    """Exclude a disc of unmodelled dynamics with a radius of at least 1: it contains the response 0, with Re G_hh =
    0."""
    radii = problem.uncertainty.unmodelled if problem.uncertainty is not None else ()
    if not radii:
        return None
    low, high = problem.stability.band.hz
    inside = {hz: radius for hz, radius in radii if low <= hz <= high}
    inside |= {hz: float(FLOATS.interpolated(hz, radii)) for hz in (low, high)}
    hz, radius = max(inside.items(), key=lambda point: point[1])
    if radius < 1:
        return None
    return (
        f"Re G_hh must be positive at {hz:.4g} Hz, where uncertainty.unmodelled is {radius:.4g}: with a radius of 1 or "
        "more the device may not answer at all",
        "state radii below 1 within stability.band_hz, or end the band where they are",
    )


def _negative_resistance(problem: Problem) -> tuple[str, str] | None:
    K_v, most = _least_velocity(problem), problem.bounds.velocity.max
    if K_v < most:
        return None
    device, omega = problem.device, problem.stability.band.min
    tau, units = lags(device, FLOATS).drive, UNITS[device.units]
    place, growth = ("for omega -> 0", "") if omega == 0 else (f"at {omega / (2 * pi):.4g} Hz", " (1 + (omega tau)^2)")
    return (
        f"Re G_hh > 0 {place} needs K_v > tau K_p - {_damping(device)}{growth}, at least {K_v:.4g} {units.damping}, "
        f"but gains.velocity is at most {most:.4g} {units.damping}",
        f"lower gains.position.min below {problem.bounds.position.min - (K_v - most) / tau:.4g} {units.stiffness}",
    )


def _least_velocity(problem: Problem) -> float:
    """Return the K_v above which Re G_hh > 0 at the band's lower edge with the least K_p; -inf if no formula is
    known."""
    device, omega = problem.device, problem.stability.band.min
    rational = device.ideal and device.hold == "lag" and device.delay == 0
    if device.structure is not None or (omega > 0 and not rational):
        return -inf
    growth, tau = 1 + (omega * device.loop_lag) ** 2, float(lags(device, FLOATS).drive)
    return float(tau * problem.bounds.position.min - device.least_damping * growth)


def _damping(device: Device) -> str:
    return "b" if device.operator is None else "(b + b_h)"


def _at_zero(problem: Problem) -> tuple[str, str] | None:
    """Compare R with Re Z_c for omega -> 0. With an integrator, R tends to a constant and Re Z_c to the drag."""
    position = problem.bounds.position
    reasons, advice = [], []
    if position.max > 0:
        found = _with_integrator(problem)
        if found is None:
            return None
        reasons, advice = [found[0]], [found[1]]
    if position.min == 0:
        found = _without_integrator(problem)
        if found is None:
            return None
        reasons, advice = [*reasons, found[0]], [*advice, found[1]]
    else:
        advice.append("allow gains.position = 0")
    return "; ".join(reasons), ", or ".join(advice)


def _with_integrator(problem: Problem) -> tuple[str, str] | None:
    device, bounds, factor = problem.device, problem.bounds, problem.stability.safety_factor
    if device.structure is not None or (device.operator is not None and not device.ideal):
        return None
    most = Coupling(bounds.damping.min, bounds.mass.max, bounds.drag.max)
    limit = low_frequency_limit(device, Gains(bounds.velocity.max, max(bounds.position.min, LEAST_POSITION)), most)
    if _met(limit, factor):
        return None
    drag, unit = factor * limit.required, UNITS[device.units].damping
    held = device.operator is not None
    late = "(b + tau_s K_p)" if device.senses_late else "b"
    R = "(b^2 - 4 b_h k)/(4 (b + b_h + k)), k = K_v - tau K_p," if held else f"{late}^2/(4 (b + K_v - tau K_p))"
    reason = (
        f"with K_p > 0 the required R tends to {R} for omega -> 0, at least "
        f"{limit.required:.4g} {unit}, with the safety factor {drag:.4g} {unit}, but Re Z_c tends to the drag, at most "
        f"{most.drag:.4g} {unit}"
    )
    if most.drag > 0:
        return reason, f"allow a coupling.drag of {drag:.4g} {unit}"
    lowest = sqrt(drag * most.damping) / most.mass / (2 * pi)
    advice = f"allow a coupling.drag of {drag:.4g} {unit}, raise stability.band_hz[0] to at least {lowest:.4g} Hz"
    return reason, advice


def _without_integrator(problem: Problem) -> tuple[str, str] | None:
    """Compare the limits of both sides for omega -> 0 and K_p = 0, which are proportional to omega^2."""
    device, bounds, factor = problem.device, problem.bounds, problem.stability.safety_factor
    if not device.ideal:
        return None
    most = Coupling(bounds.damping.min, bounds.mass.max, bounds.drag.max)
    limits = [low_frequency_limit(device, Gains(K_v, 0.0), most) for K_v in (bounds.velocity.min, bounds.velocity.max)]
    if any(_met(limit, factor) for limit in limits):
        return None
    need, unit = factor * min(limit.required for limit in limits), UNITS[device.units].mass
    return (
        "with K_p = 0 omega -> 0 needs m_c^2/b_c >= K_v (m + b tau)^2/(4 (b + K_v)^2), with the safety factor at least "
        f"{need:.4g} {unit} s, but the bounds allow {limits[0].coupling:.4g} {unit} s",
        f"raise coupling.mass.max to {sqrt(need * most.damping):.4g} {unit}, or allow some coupling.drag",
    )


def _at_infinity(problem: Problem) -> tuple[str, str] | None:
    """Compare R with Re Z_c for omega -> inf: Re Z_c tends to b_c + b_0, for a rigid coupling to b_0, and R grows with
    K_v."""
    device, bounds, factor = problem.device, problem.bounds, problem.stability.safety_factor
    most = Coupling(bounds.damping.max, bounds.mass.max, bounds.drag.max)
    K_v = max(bounds.velocity.min, _least_velocity(problem))
    limit = high_frequency_limit(device, Gains(K_v, bounds.position.min), most)
    rigid = bounds.damping.min == inf
    if _met(limit, factor) or (most.rigid and not rigid and limit.required < inf):
        return None
    b, offered = _damping(device), "b_0" if rigid else "b_c + b_0"
    if limit.required == inf:
        return (
            f"omega -> inf needs {offered} >= 2 m K_v/({b} T), which no coupling has for a device without damping",
            "lower stability.band_hz[1] to a finite edge, or add device damping",
        )
    need, unit = factor * limit.required, UNITS[device.units].damping
    key, least = ("drag", need) if rigid else ("damping", need - most.drag)
    return (
        f"omega -> inf needs {offered} >= 2 m K_v/({b} T), with K_v at least {K_v:.4g} {unit} and the safety factor at "
        f"least {need:.4g} {unit}, but the bounds allow {limit.coupling:.4g} {unit}",
        f"lower stability.band_hz[1] to a finite edge, or raise coupling.{key}.max to {least:.4g} {unit}",
    )


def _met(limit: EndLimit, factor: float) -> bool:
    """Return whether Re Z_c suffices at an end of the frequency axis; every coupling meets an R of 0 or less."""
    return limit.required <= 0 or limit.coupling >= factor * limit.required
