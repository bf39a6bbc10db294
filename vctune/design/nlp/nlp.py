"""State the design problem on a finite set of frequencies as a CasADi NLP (design/README.md, section 7)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, reduce
from math import inf, pi
from typing import Any

import casadi as ca

from vctune.design.nlp.nlp_parameters import (
    PERTURBED_LOOP,
    PULSE_TRANSFER,
    STABILITY_CUT,
    Layout,
    common_layout,
    device_of,
    frequency_layout,
    plant_layout,
    plant_of,
    tables,
    unpacked,
)
from vctune.design.nlp.nlp_structure import DEMANDS, NlpStructure
from vctune.design.variables import CORNER, coupling_from
from vctune.model.gains import AnyCoupling, Gains, SpringDamper, coupling_impedance, sampled_resistance, series_coupling
from vctune.model.loop.llewellyn import modulus_excess
from vctune.model.loop.loop import loop_response
from vctune.model.numbers.arithmetic import Arithmetic, Number, by_conjugate
from vctune.model.numbers.pair import EvenOdd, Pair
from vctune.model.sampled.hand_loop import LoopInHand, required_in_hand, seen_in_hand
from vctune.model.sampled.impedance_display import offered_by_spring, spring_damper_admittance
from vctune.model.sampled.velocity_loop import return_difference, sensitivity_abs2
from vctune.model.sampled.worlds.loop_in_walls import disjuncts_in_walls, strip_in_walls
from vctune.model.sampled.worlds.loop_in_worlds import Seen, disjuncts, offered_at, room_of
from vctune.model.transparency import PANEL_NODES, TERMS, loop_terms, squared_terms
from vctune.model.worlds import World, Worlds

# Options of IPOPT
OPTIONS: dict[str, Any] = {
    "print_time": False,
    "show_eval_warnings": False,
    "calc_lam_p": False,
    "expand": True,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.bound_relax_factor": 0.0,
    "ipopt.tol": 1e-9,
    "ipopt.nlp_scaling_method": "none",
    "ipopt.max_iter": 100,
    "ipopt.mu_init": 1e-3,
    "ipopt.mumps_pivot_order": 0,
    "ipopt.barrier_tol_factor": 100.0,
    "ipopt.constr_mult_init_max": 0.0,
    "ipopt.mumps_permuting_scaling": 0,
    "ipopt.mumps_scaling": 0,
    "ipopt.min_refinement_steps": 0,
    "ipopt.max_refinement_steps": 1,
}


class _SymbolArithmetic:
    """Arithmetic of CasADi symbols."""

    pi = pi
    precision = 2.0**-53
    arrays = None

    @staticmethod
    def is_zero(x: Number) -> bool:
        return bool(ca.SX(x).is_zero())

    sqrt = staticmethod(ca.sqrt)
    exp = staticmethod(ca.exp)
    sin = staticmethod(ca.sin)
    cos = staticmethod(ca.cos)
    reciprocal = staticmethod(by_conjugate)

    @staticmethod
    def modulus(re: Number, im: Number) -> Number:
        return ca.sqrt(re * re + im * im)

    @staticmethod
    def sinc(x: Number) -> Number:
        return ca.sin(x) / x

    @staticmethod
    def sinc_curvature(x: Number) -> Number:
        return (1 - ca.sin(x) / x) / (x * x)

    @staticmethod
    def phi_1(x: Number) -> Number:
        return (1 - ca.exp(-x)) / x

    @staticmethod
    def phi_2(x: Number) -> Number:
        return (x - 1 + ca.exp(-x)) / (x * x)

    @staticmethod
    def where_positive(x: Number, yes: Callable[[], Number], no: Callable[[], Number]) -> Number:
        return ca.if_else(x > 0, yes(), no())

    @staticmethod
    def interpolated(x: Number, table: tuple[tuple[float, float], ...]) -> Number:
        raise NotImplementedError("a symbol lies between no two points of a table")

    @staticmethod
    def within(radius: Number) -> Number:
        return 0.0

    @staticmethod
    def middle(x: Number) -> Number:
        return x

    @staticmethod
    def magnitude(x: Number) -> float:
        raise NotImplementedError("a symbol has no size")


SYMBOLS: Arithmetic = _SymbolArithmetic()


@dataclass(frozen=True, slots=True)
class _AtOneFrequency:
    """The expressions of the NLP as symbols at one frequency. `assembled` applies them to all frequencies."""

    z: ca.SX  # free variables, parameters common to all frequencies, epigraph variable
    common: ca.SX
    epigraph: ca.SX
    inputs: dict[str, ca.SX]
    values: dict[str, Number]  # value of the constraint, or term of the objective, for each kind


def _at_one_frequency(structure: NlpStructure) -> _AtOneFrequency:
    z, epigraph, weight, y = ca.SX.sym("z", len(structure.free)), ca.SX.sym("t"), ca.SX.sym("weight"), ca.SX.sym("y")
    common_column, common = _symbols("common", common_layout(structure))
    frequency_column, frequency = _symbols("frequency", frequency_layout(structure))
    pulse_column, pulse = _symbols("pulse", PULSE_TRANSFER)
    perturbed_column, perturbed = _symbols("perturbed", PERTURBED_LOOP)
    cut_column, cut = _symbols("cut", STABILITY_CUT)
    in_hand_column, in_hand = _symbols("held", tables(structure)["in_hand"].layout)
    plant_column, plant = _symbols("plant", plant_layout(structure))

    gains, coupling, corner = _design(structure, z, common)
    operator = common["operator_damping"] if structure.operator_damping else None
    at = device_of(structure, common | frequency, operator)
    loop, response = loop_response(at, gains, SYMBOLS), _coupling_response(coupling, frequency)
    squares = squared_terms(loop_terms(loop, at, structure.kind), response, 1.0)
    weights = dict(zip(TERMS, ca.vertsplit(common["weights"]), strict=True))
    error2 = sum((weights[term] ** 2 * getattr(squares, term) for term in structure.terms), start=ca.SX(0))
    offered = 2 * loop.resistance * response.re
    if loop.operator_relief is not None:  # R may be negative; with the relief on this side, both sides are > 0
        offered += common["safety_factor"] * loop.operator_relief
    L, perturbed_L = _loop_gain(structure, gains, pulse), _loop_gain(structure, gains, perturbed)
    sampled = plant_of(structure, {name: ca.vertsplit(column) for name, column in plant.items()})
    on_peak = return_difference(sampled, ca.exp(y), SYMBOLS, position=structure.integrator)
    log_peak = ca.log(sensitivity_abs2(on_peak, gains)) / 2
    return _AtOneFrequency(
        z,
        common_column,
        epigraph,
        inputs={
            "node": ca.vertcat(frequency_column, weight),
            "ratio": frequency_column,
            "sensitivity": pulse_column,
            "stability": cut_column,
            "peak": frequency_column,
            "unmodelled": perturbed_column,
            "in_hand": in_hand_column,
            "tracked_peaks": ca.vertcat(y, plant_column),
        },
        values={
            "node": weight * error2,
            "ratio": ca.log(offered) - ca.log(modulus_excess(loop, SYMBOLS)),
            "sensitivity": ca.log(Pair(1 + L.re, L.im).abs2()) / 2,
            "stability": cut["open"] + gains.velocity * cut["velocity"] + gains.position * cut["position"],
            "peak": epigraph - ca.log(error2) / 2,
            "unmodelled": _room(perturbed_L) - perturbed["log_radius"],
            "in_hand": _demanded_in_hand(structure, in_hand, gains, coupling, corner),
            "tracked_peaks": ca.vertcat(-log_peak, ca.gradient(log_peak, y)),
        },
    )


def _loop_gain(structure: NlpStructure, gains: Gains, pulse: dict[str, ca.SX]) -> Pair:
    """Return L = K_v G_v + K_p G_x of the sampled loop, where S = 1/(1 + L)."""
    L = Pair(pulse["re_G_v"], pulse["im_G_v"]).scaled(gains.velocity)
    return L + Pair(pulse["re_G_x"], pulse["im_G_x"]).scaled(gains.position) if structure.integrator else L


def _room(L: Pair) -> Number:
    """Return -log |1 - S|, the logarithm of the greatest permitted radius of unmodelled dynamics."""
    return (ca.log(Pair(1 + L.re, L.im).abs2()) - ca.log(L.abs2())) / 2


# Scale of the asinh with which the constraint in a hand compares Re Z_c and R, in units of Z_0, or Re(1/Z_c)/s^2 and R
# of an impedance display, in units of 1/Z_0
SCALE_IN_HAND = 0.05


def _coupling_response(coupling: AnyCoupling, frequency: dict[str, ca.SX]) -> Pair:
    """Return Z_c, or 1/Z_c for an impedance display. Omega is dimensionless, so that theta = omega."""
    if isinstance(coupling, SpringDamper):
        return spring_damper_admittance(coupling, 1.0, _low_pass(frequency), frequency["omega"], SYMBOLS)
    return coupling_impedance(series_coupling(coupling), frequency["omega"])


def _low_pass(numbers: dict[str, ca.SX]) -> Pair:
    return Pair(numbers["low_pass_re"], numbers["low_pass_im"])


def _margin_in_hand(in_hand: dict[str, ca.SX], gains: Gains, coupling: AnyCoupling) -> Number:
    """Return asinh(Re Z_c) - asinh(factor R), scaled, which is >= 0 if the coupling suffices in a hand."""
    if isinstance(coupling, SpringDamper):
        (l_0, l_1), (q_0, q_1, q_2), K_v = ca.vertsplit(in_hand["lost"]), ca.vertsplit(in_hand["size"]), gains.velocity
        required = (l_0 + l_1 * K_v) / (q_0 + K_v * (q_1 + q_2 * K_v))
        wanted = ca.fmax(in_hand["factor"] * required, required)  # the greater of the two if R is negative
        offered = offered_by_spring(coupling, 1.0, _low_pass(in_hand), in_hand["theta"], SYMBOLS).quotient
        return ca.asinh(offered / SCALE_IN_HAND) - ca.asinh(wanted / SCALE_IN_HAND)
    offered = sampled_resistance(series_coupling(coupling), 1.0, in_hand["theta"], SYMBOLS)
    wanted = in_hand["factor"] * (in_hand["required"] if "required" in in_hand else _required_of_loop(in_hand, gains))
    return ca.asinh(offered / SCALE_IN_HAND) - ca.asinh(wanted / SCALE_IN_HAND)


# Amount that the NLP subtracts from a margin that the problem does not have, so that this margin is never the greatest
UNPOSED = 1e3
BLUNT = 1e-2  # Width of the smooth function that replaces the maximum of several margins


def _demanded_in_hand(
    structure: NlpStructure, in_hand: dict[str, ca.SX], gains: Gains, coupling: AnyCoupling, corner: ca.SX | None
) -> Number:
    if corner is not None:
        return _margin_with_walls(in_hand, gains, coupling, corner)
    if structure.worlds:
        return _margin_in_worlds(in_hand, gains, coupling)
    return _margin_in_hand(in_hand, gains, coupling)


def _margin_in_worlds(in_hand: dict[str, ca.SX], gains: Gains, coupling: AnyCoupling) -> Number:
    """Return a smooth lower bound of the greatest of the margins, one of which must be positive."""
    low, high = _box_of(in_hand)
    theta, factor, raised = in_hand["theta"], in_hand["reserve"], in_hand["factor"]
    at, seen = offered_at(series_coupling(coupling), 1.0, theta, SYMBOLS), _seen(in_hand, gains)
    margin_terms = disjuncts(at, Worlds(low, high), 1.0, seen, factor, theta, SYMBOLS)
    offered, wanted = at.resistance + factor * low.damping, raised * (seen.lost / seen.size)
    margins = {"resistive": ca.asinh(offered / SCALE_IN_HAND) - ca.asinh(wanted / SCALE_IN_HAND)}
    for name in margin_terms._fields[1:]:
        margins[name] = room_of(getattr(margin_terms, name), ca.fabs) - in_hand["spare"]
    alike = 1 + ca.fmax(in_hand["by_above"], in_hand["by_below"])
    return _greatest([margins[name] - UNPOSED * (1 - in_hand[f"by_{name}"]) for name in margins], alike)


ENDLESS = 1e12  # Substitute for the greatest mass of a box that does not limit the mass, in units of Z_0 T


def _margin_with_walls(in_hand: dict[str, ca.SX], gains: Gains, coupling: AnyCoupling, corner: ca.SX) -> Number:
    """Return the margin of the condition on walls or, at a point for linear environments, the margin for these
    environments."""
    theta, (low, high), T = in_hand["theta"], _box_of(in_hand), 1.0
    at = offered_at(series_coupling(coupling), T, theta, SYMBOLS)
    high = replace(high, mass=high.mass + ENDLESS * (1 - in_hand["by_above"]))
    worlds = Worlds(low, high, True, corner)
    strip = strip_in_walls(at, worlds, T, _seen(in_hand, gains), in_hand["share"], theta, SYMBOLS)
    margin_terms = disjuncts_in_walls(strip, worlds, in_hand["lead"], T, theta, SYMBOLS)
    wall_margins = [room_of(terms, ca.fabs) - in_hand["spare"] for terms in margin_terms if terms is not None]
    linear = _margin_in_worlds(in_hand, gains, coupling)
    return in_hand["walled"] * _greatest(wall_margins) + (1 - in_hand["walled"]) * linear


def _greatest(margins: list[Number], alike: Number = 2) -> Number:
    """Return a smooth lower bound of the greatest of some margins."""
    greatest = reduce(ca.fmax, margins)
    others = sum(ca.exp((margin - greatest) / BLUNT) for margin in margins)
    return greatest + BLUNT * (ca.log(others) - ca.log(alike))


def _box_of(in_hand: dict[str, ca.SX]) -> tuple[World, World]:
    """Return the least and the greatest environment of the box."""
    numbers = ("mass", "damping", "stiffness")
    low, high = (World(*(in_hand[f"environment_{end}_{name}"] for name in numbers)) for end in ("low", "high"))
    return low, high


def _seen(in_hand: dict[str, ca.SX], gains: Gains) -> Seen:
    return (
        Seen(in_hand["required"], in_hand["swing"], 1.0)
        if "required" in in_hand
        else seen_in_hand(_loop(in_hand), gains)
    )


def _loop(in_hand: dict[str, ca.SX]) -> LoopInHand:
    """Return a velocity loop in a hand."""
    sine = ca.sin(in_hand["theta"] / 2)
    each = (EvenOdd(in_hand[f"{part}_even"], in_hand[f"{part}_odd"], sine * sine) for part in LoopInHand._fields)
    return LoopInHand(*each)


def _required_of_loop(in_hand: dict[str, ca.SX], gains: Gains) -> Number:
    """Return R of a velocity loop in a hand."""
    required = required_in_hand(_loop(in_hand), gains)
    return required.lost / required.size


def _symbols(name: str, layout: Layout) -> tuple[ca.SX, dict[str, ca.SX]]:
    """Return a column of symbols for a layout, and the parts of this column by name."""
    column = ca.SX.sym(name, sum(layout.values()))
    return column, unpacked(layout, column)


def _design(structure: NlpStructure, z: ca.SX, common: dict[str, ca.SX]) -> tuple[Gains, AnyCoupling, ca.SX | None]:
    """Return gains, coupling and the corner of the multiplier for walls."""
    values = ca.vertsplit(common["fixed"])
    for k, (index, from_zero) in enumerate(structure.free):
        values[index] = common["scales"][index] * ca.expm1(z[k]) if from_zero else ca.exp(z[k])
    K_v, K_p, *of_coupling = values[: len(structure.kind.keys)]
    coupling = [inf, *of_coupling[1:]] if structure.rigid else of_coupling
    corner = values[CORNER] if structure.walls else None
    return Gains(K_v, K_p if structure.integrator else 0.0), coupling_from(coupling), corner


@lru_cache(maxsize=16)
def compiled(structure: NlpStructure) -> ca.Function:
    """Return the compiled solver of a structure."""
    return ca.nlpsol("design", "ipopt", assembled(structure), OPTIONS)


def assembled(structure: NlpStructure) -> dict[str, ca.MX]:
    """Return the NLP of a structure."""
    one = _at_one_frequency(structure)
    columns = {name: ca.MX.sym(name, table.rows, table.columns) for name, table in tables(structure).items()}
    z, common, y = ca.MX.sym("z", len(structure.free)), columns["common"], ca.MX.sym("y", structure.tracked_peaks)
    epigraph = ca.MX.sym("t") if structure.epigraph else ca.MX(0)

    def at_each(kind: str, inputs: ca.MX) -> ca.MX:
        arguments = [one.z, one.common, one.epigraph, one.inputs[kind]]
        value = ca.Function(kind, arguments, [one.values[kind]])
        return value.map(inputs.columns())(z, common, epigraph, inputs)

    errors = [_mean_errors(structure, at_each("node", columns["node"]).T)] if structure.norm == "rms" else []
    demands = [at_each(kind, columns[kind]).T for kind in DEMANDS if columns[kind].columns()]
    if structure.tracked_peaks:
        demands.append(ca.vec(at_each("tracked_peaks", ca.vertcat(y.T, columns["tracked_peaks"]))))
    if structure.epigraph:
        unknowns, objective = ca.vertcat(z, y, epigraph), epigraph
        demands += [epigraph - error for error in errors if structure.mean_errors]
    else:
        unknowns, objective = ca.vertcat(z, y), errors[0]
    parameters = ca.vertcat(*(ca.vec(table) for table in columns.values()))
    return {"x": unknowns, "f": objective, "g": ca.vertcat(*demands), "p": parameters}


def _mean_errors(structure: NlpStructure, squares: ca.MX) -> ca.MX:
    """Return the logarithm of the root mean square error on each device, from the weighted squares at all nodes."""
    devices = structure.objective_devices
    if devices > 1:
        squares = ca.reshape(squares, PANEL_NODES * structure.panels, devices)
    return ca.log(ca.sum1(squares)).T / 2
