"""The constraints of the NLP: for each kind, the constants at its points in doubles, and its margin in symbols."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import reduce
from math import exp, inf, pi
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from vctune.analysis.extrema import Floats
from vctune.analysis.hardest_hands import AtWall
from vctune.analysis.sampled_loop import plant_of, pulse_transfer
from vctune.design.nlp.symbols import CASADI
from vctune.design.nlp.working_set import TIGHTENING_IN_HANDS, ConstraintPoint, WorkingSet, points_as_one
from vctune.design.prepared import Posed
from vctune.model.device import Device
from vctune.model.display import Display
from vctune.model.gains import (
    AnyCoupling,
    Gains,
    Rule,
    SpringDamper,
    coupling_impedance,
    sampled_resistance,
    series_coupling,
)
from vctune.model.hands import hands_as_one
from vctune.model.loop.device_response import DeviceResponse, device_response
from vctune.model.loop.llewellyn import modulus_excess
from vctune.model.loop.loop import loop_response
from vctune.model.numbers.arithmetic import FLOATS, Arithmetic, Number
from vctune.model.numbers.pair import EvenOdd, Pair
from vctune.model.sampled.any_hand import any_hand
from vctune.model.sampled.hand_loop import LoopInHand, loop_in_hand, required_in_hand, seen_in_hand
from vctune.model.sampled.impedance_display import (
    Required,
    firmware_filter,
    offered_by_spring,
    spring_damper_admittance,
)
from vctune.model.sampled.loop_in_worlds import (
    ZSeen,
    disjuncts,
    disjuncts_in_walls,
    margin_names,
    offered_at,
    room_of,
    strip_in_walls,
)
from vctune.model.sampled.plant_in_hand import Delays, alike, as_one, delays_of, plant_in_hand
from vctune.model.sampled.velocity_loop import PlantLetGo, return_difference, sensitivity_abs2
from vctune.model.transparency import TermName, Terms, loop_terms, squared_terms
from vctune.model.worlds import World, Worlds

# Scale of the asinh with which the constraint in a hand compares Re Z_c and R, in units of Z_0, or Re(1/Z_c)/s^2 and R
# of an impedance display, in units of 1/Z_0
SCALE_IN_HAND = 0.05
BLUNT = 1e-2  # Width of the smooth function that replaces the maximum of several margins
ENDLESS = 1e12  # Substitute for the greatest mass of a box that does not limit the mass, in units of Z_0 T


class Sought(NamedTuple):
    """The design in symbols, and what all its constraints share."""

    kind: Display
    gains: Gains
    coupling: AnyCoupling
    corner: Number | None  # of the multiplier for walls
    terms: tuple[TermName, ...]  # terms of the error with a positive weight
    weights: Terms
    safety_factor: Number
    epigraph: Number


class AtFrequency(NamedTuple):
    """A device at frequencies, and the firmware's filter of an impedance display. With T = 1, omega equals theta."""

    device: DeviceResponse
    low_pass: Pair | None


class Pulse(NamedTuple):
    """The pulse transfer functions from force to velocity and position."""

    G_v: Pair
    G_x: Pair


class Perturbed(NamedTuple):
    """The pulse transfer functions, and the logarithm of the radius of unmodelled dynamics."""

    pulse: Pulse
    log_radius: Number


class ForceInHands(NamedTuple):
    """The loop of an impedance display: R/s^2 = (l_0 + l_1 K_v)/(q_0 + q_1 K_v + q_2 K_v^2)."""

    low_pass: Pair
    lost: tuple[Number, Number]
    size: tuple[Number, Number, Number]


class CommandInHands(NamedTuple):
    """R and -s Im Z_seen of a servo, which do not depend on any gain."""

    required: Number
    swing: Number


class InWorlds(NamedTuple):
    """A box of environments."""

    names: tuple[str, ...]  # of the margins that can be positive
    low: World  # limits, 0 for inf
    high: World
    reserve: Number
    spare: Number


class InWalls(NamedTuple):
    """The condition for walls, where `walled` is 1; where it is 0, that for linear environments."""

    walled: Number
    at: AtWall


class InHands(NamedTuple):
    """The loop in hands at angles, and the least permitted ratio Re Z_c / R."""

    theta: Number
    factor: Number
    loop: LoopInHand | ForceInHands | CommandInHands
    worlds: InWorlds | None
    walls: InWalls | None


def at_frequencies(device: Device, omega: Floats) -> AtFrequency:
    """Return a device at frequencies."""
    at = device_response(device, omega, FLOATS)
    operator = at.operator if at.operator is not None and np.any(at.operator > 0) else None
    return AtFrequency(at._replace(operator=operator), _filter(device, omega) if device.kind.inverse else None)


def _filter(device: Device, theta: Any) -> Pair:
    return firmware_filter(device, theta, FLOATS) or Pair(1.0, 0.0)


def pulses(points: Sequence[ConstraintPoint], *, position: bool) -> Pulse:
    """Return the pulse transfer functions at some points."""
    G_v, G_x = pulse_transfer(*points_as_one(points), position=position)
    return Pulse(Pair(G_v.real, G_v.imag), Pair(G_x.real, G_x.imag))


def unmodelled_radius(given: Posed, point: ConstraintPoint) -> float:
    """Return the radius of the unmodelled dynamics at a dimensionless point."""
    assert given.problem.uncertainty is not None
    return float(FLOATS.interpolated(point.omega / (2 * pi), given.problem.uncertainty.unmodelled))


def constants(given: Posed, points: WorkingSet, tightening: float, *, position: bool) -> dict[str, Any]:
    """Return the constants of each kind of constraint at its points; a kind without points is absent."""
    found: dict[str, Any] = {}
    if points.ratio:
        found["ratio"] = at_frequencies(*points_as_one(points.ratio))
    if points.sensitivity:
        found["sensitivity"] = pulses(points.sensitivity, position=position)
    if points.peak:
        found["peak"] = at_frequencies(*points_as_one(points.peak))
    if points.unmodelled:
        radii = np.array([unmodelled_radius(given, point) for point in points.unmodelled])
        found["unmodelled"] = Perturbed(pulses(points.unmodelled, position=position), np.log(radii))
    if points.in_hand:
        found["in_hand"] = _in_hands(given, points.in_hand, max(tightening, TIGHTENING_IN_HANDS))
    if points.tracked_peaks:
        (peak,) = points.tracked_peaks
        found["tracked_peaks"] = _any_delay(plant_of(peak.device))
    return found


def _any_delay(of: PlantLetGo) -> PlantLetGo:
    """Return a plant in the form that all delays have."""
    plant = of.plant
    older = plant.older or (0.0,) * len(plant.push)
    delays = Delays(float(plant.delays.loop), True, float(plant.delays.felt), True)
    return replace(of, plant=replace(plant, older=older, felt_older=older, delays=delays))


def _in_hands(given: Posed, points: Sequence[ConstraintPoint], spare: float) -> InHands:
    problem, count, name = given.problem, len(points), points[0].device.kind.name
    theta = np.array([min(at.omega, pi) for at in points])
    factor, walls, worlds = problem.stability.safety_factor * exp(spare), None, None
    if (met := problem.worlds_met) is not None:
        low, high = (
            World(*(0.0 if x == inf else x for x in (end.mass, end.damping, end.stiffness)))
            for end in (met.worlds.low, met.worlds.high)
        )
        worlds = InWorlds(margin_names(met.worlds, met.factor), low, high, met.factor, spare)
        if met.worlds.walls or (problem.worlds is not None and problem.worlds.walls):
            walled = np.array([1.0 * (at.wall is not None) for at in points])
            each = [at.wall or AtWall(1.0, 0.0) for at in points]
            walls = InWalls(walled, AtWall(*np.array(each, float).T))
    if name == "admittance":
        loop: Any = _loops_in_hands(points, theta)
    else:
        of = _command_in_hand if name == "servo" else _force_in_hand
        loop = _along([of(at, x) for at, x in zip(points, theta.tolist(), strict=True)])
    return InHands(theta, np.full(count, factor), loop, worlds, walls)


def _along(trees: Sequence[Any]) -> Any:
    """Return trees of single numbers as one tree of arrays."""
    first = trees[0]
    if isinstance(first, Pair):
        return Pair(*(np.array([getattr(each, part) for each in trees], float) for part in ("re", "im")))
    if isinstance(first, tuple):
        parts = [_along([each[k] for each in trees]) for k in range(len(first))]
        return type(first)(*parts) if hasattr(first, "_fields") else tuple(parts)
    return np.array(trees, float)


def _loops_in_hands(points: Sequence[ConstraintPoint], theta: Floats) -> LoopInHand:
    """Return the loops in hands, evaluated together for devices of the same form."""
    square = np.sin(theta / 2) ** 2
    found = LoopInHand(*(EvenOdd(np.zeros(len(points)), np.zeros(len(points)), square) for _ in LoopInHand._fields))
    for group in alike([at.device for at in points]):
        device, delays = as_one([points[k].device for k in group], (-1,))
        hand = hands_as_one([at.hand for at in (points[k] for k in group) if at.hand is not None])
        loop = loop_in_hand(plant_in_hand(device, hand, delays, FLOATS), theta[group], FLOATS)
        assert isinstance(loop, LoopInHand)
        for whole, part in zip(found, loop, strict=True):
            whole.even[group], whole.odd[group] = part.even, part.odd
    return found


def _force_in_hand(at: ConstraintPoint, theta: float) -> ForceInHands:
    """Return the polynomials in K_v of R's numerator and denominator, from the values at K_v = 0, 1 and -1."""
    delays = delays_of(at.device)

    def required(K_v: float) -> Required:
        if at.hand is None:
            hand = any_hand(at.device, delays.loop, theta, FLOATS, fractional=delays.loop_fractional)
            return hand.required(Gains(K_v, 0.0))
        plant = plant_in_hand(at.device, at.hand, delays, FLOATS)
        return required_in_hand(loop_in_hand(plant, theta, FLOATS), Gains(K_v, 0.0))

    without, plus, minus = (required(K_v) for K_v in (0.0, 1.0, -1.0))
    lost = without.lost, (plus.lost - minus.lost) / 2
    size = without.size, (plus.size - minus.size) / 2, (plus.size + minus.size) / 2 - without.size
    return ForceInHands(_filter(at.device, theta), lost, size)


def _command_in_hand(at: ConstraintPoint, theta: float) -> CommandInHands:
    assert at.hand is not None
    loop = loop_in_hand(plant_in_hand(at.device, at.hand, delays_of(at.device), FLOATS), theta, FLOATS)
    required, seen = required_in_hand(loop, Gains(0.0, 0.0)), seen_in_hand(loop, Gains(0.0, 0.0))
    return CommandInHands(required.lost / required.size, seen.swing / seen.size)


def error2(at: AtFrequency, sought: Sought) -> Number:
    """Return the squared error at a frequency."""
    loop = loop_response(at.device, sought.gains, CASADI)
    of_loop = loop_terms(loop, at.device, sought.kind)
    squares = squared_terms(of_loop, _coupling_response(at, sought.coupling), 1.0)
    return sum((getattr(sought.weights, x) ** 2 * getattr(squares, x) for x in sought.terms), start=ca.SX(0))


def _coupling_response(at: AtFrequency, coupling: AnyCoupling) -> Pair:
    """Return Z_c, or 1/Z_c for an impedance display."""
    if isinstance(coupling, SpringDamper):
        return spring_damper_admittance(coupling, 1.0, at.low_pass, at.device.omega, CASADI)
    return coupling_impedance(series_coupling(coupling), at.device.omega)


def _ratio(at: AtFrequency, sought: Sought) -> Number:
    """Return the logarithm of Re Z_c / R."""
    loop = loop_response(at.device, sought.gains, CASADI)
    offered = 2 * loop.resistance * _coupling_response(at, sought.coupling).re
    if loop.operator_relief is not None:  # R may be negative; with the relief on this side, both sides are > 0
        offered += sought.safety_factor * loop.operator_relief
    return ca.log(offered) - ca.log(modulus_excess(loop, CASADI))


def _loop_gain(pulse: Pulse, gains: Gains) -> Pair:
    """Return L = K_v G_v + K_p G_x of the sampled loop, where S = 1/(1 + L)."""
    return pulse.G_v.scaled(gains.velocity) + pulse.G_x.scaled(gains.position)


def _sensitivity(pulse: Pulse, sought: Sought) -> Number:
    """Return -log |S|."""
    return ca.log(_loop_gain(pulse, sought.gains).plus(1).abs2()) / 2


def _unmodelled(at: Perturbed, sought: Sought) -> Number:
    """Return -log(|1 - S| r)."""
    L = _loop_gain(at.pulse, sought.gains)
    return (ca.log(L.plus(1).abs2()) - ca.log(L.abs2())) / 2 - at.log_radius


def tracked_peak(plant: PlantLetGo, y: Number, sought: Sought) -> Number:
    """Return -log |S| at omega = exp(y), and the slope of log |S|, which is 0 at a peak."""
    parts = return_difference(plant, ca.exp(y), CASADI, position=not CASADI.is_zero(sought.gains.position))
    log_peak = ca.log(sensitivity_abs2(parts, sought.gains)) / 2
    return ca.vertcat(-log_peak, ca.gradient(log_peak, y))


def _in_hand(at: InHands, sought: Sought) -> Number:
    if at.walls is not None:
        return _margin_with_walls(at, at.walls, sought)
    return _margin_in_worlds(at, sought) if at.worlds is not None else _margin_in_hand(at, sought)


def _margin_in_hand(at: InHands, sought: Sought) -> Number:
    """Return asinh(Re Z_c) - asinh(factor R), scaled, which is >= 0 if the coupling suffices in a hand."""
    coupling, loop = sought.coupling, at.loop
    if isinstance(loop, ForceInHands):
        assert isinstance(coupling, SpringDamper)
        (l_0, l_1), (q_0, q_1, q_2), K_v = loop.lost, loop.size, sought.gains.velocity
        required = (l_0 + l_1 * K_v) / (q_0 + K_v * (q_1 + q_2 * K_v))
        wanted = ca.fmax(at.factor * required, required)  # the greater of the two if R is negative
        return _more(offered_by_spring(coupling, 1.0, loop.low_pass, at.theta, CASADI).quotient, wanted)
    offered, seen = sampled_resistance(series_coupling(coupling), *_there(at)), _seen(loop, sought.gains)
    return _more(offered, at.factor * (seen.lost / seen.size))


def _there(at: InHands) -> tuple[float, Rule, Number, Arithmetic]:
    """Return where the coupling is evaluated, in units of T; other rules than this one are not searched by an NLP."""
    return 1.0, "trapezoid", at.theta, CASADI


def _more(offered: Number, wanted: Number) -> Number:
    return ca.asinh(offered / SCALE_IN_HAND) - ca.asinh(wanted / SCALE_IN_HAND)


def _seen(loop: Any, gains: Gains) -> ZSeen:
    return ZSeen(loop.required, loop.swing, 1.0) if isinstance(loop, CommandInHands) else seen_in_hand(loop, gains)


def _margin_in_worlds(at: InHands, sought: Sought) -> Number:
    """Return a smooth lower bound of the greatest of the margins, one of which must be positive."""
    worlds = at.worlds
    assert worlds is not None
    met, seen = offered_at(series_coupling(sought.coupling), *_there(at)), _seen(at.loop, sought.gains)
    found = disjuncts(met, Worlds(worlds.low, worlds.high), 1.0, seen, worlds.reserve, at.theta, CASADI)
    wanted = at.factor * (seen.lost / seen.size)
    margins = [_more(met.resistance + worlds.reserve * worlds.low.damping, wanted)]
    margins += [room_of(getattr(found, name), ca.fabs) - worlds.spare for name in worlds.names[1:]]
    return _greatest(margins, 2 if {"above", "below"} & {*worlds.names} else 1)


def _margin_with_walls(at: InHands, walls: InWalls, sought: Sought) -> Number:
    """Return the margin of the condition on walls or, at a point for linear environments, that for these."""
    worlds = at.worlds
    assert worlds is not None
    met = offered_at(series_coupling(sought.coupling), *_there(at))
    high = worlds.high if "above" in worlds.names else replace(worlds.high, mass=ENDLESS)
    box = Worlds(worlds.low, high, True, sought.corner)
    strip = strip_in_walls(met, box, 1.0, _seen(at.loop, sought.gains), walls.at.share, at.theta, CASADI)
    found = disjuncts_in_walls(strip, box, walls.at.lead, 1.0, at.theta, CASADI)
    margins = [room_of(terms, ca.fabs) - worlds.spare for terms in found if terms]
    return walls.walled * _greatest(margins, 2) + (1 - walls.walled) * _margin_in_worlds(at, sought)


def _greatest(margins: list[Number], alike: int) -> Number:
    """Return a smooth lower bound of the greatest of some margins."""
    greatest = reduce(ca.fmax, margins)
    others = sum(ca.exp((margin - greatest) / BLUNT) for margin in margins)
    return greatest + BLUNT * (ca.log(others) - ca.log(alike))


# The margin of each kind of constraint, in the order of `WorkingSet.sizes`
MARGINS: dict[str, Callable[[Any, Sought], Number]] = {
    "ratio": _ratio,
    "sensitivity": _sensitivity,
    "peak": lambda at, sought: sought.epigraph - ca.log(error2(at, sought)) / 2,
    "unmodelled": _unmodelled,
    "in_hand": _in_hand,
}
