"""The design problem on a finite set of frequencies as a CasADi NLP. The only place that imports casadi.

See design/README.md, section 7.

Device, hold and delay enter as numbers per frequency, so that one compiled NLP serves every problem of its shape.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import dataclass, replace
from functools import lru_cache
from io import StringIO
from typing import Any

import casadi as ca

from vctune.design.shape import DEMANDS, TERMS, Shape
from vctune.interrupt import interrupt_deferred
from vctune.model.arithmetic import Arithmetic, Number
from vctune.model.coupling import coupling_impedance
from vctune.model.llewellyn import modulus_excess
from vctune.model.loop import HoldResponse, loop_response
from vctune.model.pair import Pair
from vctune.model.quantities import Coupling, Device, Gains, LeastOperator
from vctune.model.sampled import SampledPlant, return_difference, sensitivity_abs2
from vctune.model.transparency import PANEL_NODES, squared_terms

OPTIONS: dict[str, Any] = {
    "print_time": False,
    "show_eval_warnings": False,
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
"""The last six are for speed: some thirty well scaled equations need no scaling, and no exact barrier problems."""
COMMON = {False: 15, True: 17}
"""Numbers common to all frequencies; two more where an operator eases the conditions: its damping, the factor."""
COLUMN = {False: 3, True: 5}
"""Numbers of a place: omega and the hold; of an uncertain device its mass and damping, too."""
PULSE, PLANT = 4, 8
"""Numbers of a place of |S|: G_v and G_x there; of a peak of |S| that is followed: the sampled plant."""


class _SymbolArithmetic:
    """CasADi symbols."""

    @staticmethod
    def is_zero(x: Number) -> bool:
        return bool(ca.SX(x).is_zero())

    sqrt = staticmethod(ca.sqrt)
    exp = staticmethod(ca.exp)
    sin = staticmethod(ca.sin)
    cos = staticmethod(ca.cos)

    @staticmethod
    def sinc(x: Number) -> Number:
        return ca.sin(x) / x

    @staticmethod
    def decay_mean(x: Number) -> Number:
        return (1 - ca.exp(-x)) / x

    @staticmethod
    def decay_ramp(x: Number) -> Number:
        return (x - 1 + ca.exp(-x)) / (x * x)

    @staticmethod
    def where_positive(x: Number, yes: Callable[[], Number], no: Callable[[], Number]) -> Number:
        return ca.if_else(x > 0, yes(), no())


SYMBOLS: Arithmetic = _SymbolArithmetic()


@lru_cache(maxsize=1)
def ipopt_version() -> str:
    """Return the version that IPOPT's banner names; CasADi does not say it elsewhere."""
    banner = StringIO()
    x = ca.SX.sym("x")
    quiet: dict[str, Any] = {"print_time": False, "ipopt.sb": "yes", "ipopt.print_level": 5, "ipopt.max_iter": 0}
    with interrupt_deferred(), redirect_stdout(banner):
        ca.nlpsol("banner", "ipopt", {"x": x, "f": x * x}, quiet)(x0=0)
    found = re.search(r"Ipopt version (\d[\d.]*\d)", banner.getvalue())
    return found[1] if found else "unknown"


@dataclass(frozen=True, slots=True)
class _AtOneFrequency:
    """The NLP's building blocks as symbols: one frequency each, to be mapped over all of them.

    Attributes
    ----------
    z, common, epigraph : free variables, numbers common to all frequencies, epigraph variable
    inputs, values : per kind of frequency, its numbers and the objective's share or the constraint's value
    """

    z: ca.SX
    common: ca.SX
    epigraph: ca.SX
    inputs: dict[str, ca.SX]
    values: dict[str, Number]


def _at_one_frequency(shape: Shape) -> _AtOneFrequency:
    z, common, epigraph = ca.SX.sym("z", len(shape.free)), ca.SX.sym("common", COMMON[shape.held]), ca.SX.sym("t")
    operator = LeastOperator(0.0, common[15]) if shape.held else None
    device = Device(common[0], common[1], 1.0, 0.0, "zoh", operator)
    scale, fixed, weights = common[2:7], common[7:12], dict(zip(TERMS, ca.vertsplit(common[12:15]), strict=True))
    values = ca.vertsplit(fixed)
    for k, (index, from_zero) in enumerate(shape.free):
        values[index] = scale[index] * ca.expm1(z[k]) if from_zero else ca.exp(z[k])
    gains = Gains(values[0], values[1] if shape.integrator else 0.0)
    coupling = Coupling(values[2], values[3], values[4])

    column, weight, cut = ca.SX.sym("column", COLUMN[shape.uncertain]), ca.SX.sym("weight"), ca.SX.sym("cut", 3)
    here = replace(device, mass=column[3], damping=column[4]) if shape.uncertain else device
    hold = HoldResponse(column[1], column[2])
    loop = loop_response(here, gains, column[0], hold, SYMBOLS)
    Z_c = coupling_impedance(coupling, column[0])
    squares = squared_terms(loop, Z_c, 1.0)
    error2 = sum((weights[term] ** 2 * getattr(squares, term) for term in shape.terms), start=ca.SX(0))
    offered = 2 * loop.resistance * Z_c.re
    if loop.relief is not None:  # R may be negative and has no logarithm then
        offered += common[16] * loop.relief
    pulse, y, plant = ca.SX.sym("pulse", PULSE), ca.SX.sym("y"), ca.SX.sym("plant", PLANT)
    inverse_S = Pair(1 + gains.velocity * pulse[0], gains.velocity * pulse[1])
    if shape.integrator:
        inverse_S += Pair(pulse[2], pulse[3]).scaled(gains.position)
    sampled = SampledPlant(plant[0], plant[1], plant[2], (plant[3], plant[4]), (plant[5], plant[6]), plant[7], True)
    followed = return_difference(sampled, ca.exp(y), SYMBOLS, position=shape.integrator)
    log_peak = ca.log(sensitivity_abs2(followed, gains)) / 2
    return _AtOneFrequency(
        z,
        common,
        epigraph,
        inputs={
            "node": ca.vertcat(column, weight),
            "ratio": column,
            "sensitivity": pulse,
            "stability": cut,
            "peak": column,
            "moving": ca.vertcat(y, plant),
        },
        values={
            "node": weight * error2,
            "ratio": ca.log(offered) - ca.log(modulus_excess(loop, SYMBOLS)),
            "sensitivity": ca.log(inverse_S.abs2()) / 2,
            "stability": cut[0] + gains.velocity * cut[1] + gains.position * cut[2],
            "peak": epigraph - ca.log(error2) / 2,
            "moving": ca.vertcat(-log_peak, ca.gradient(log_peak, y)),
        },
    )


@lru_cache(maxsize=16)
def compiled(shape: Shape) -> ca.Function:
    """Return the solver of a shape."""
    return ca.nlpsol("design", "ipopt", assembled(shape), OPTIONS)


def assembled(shape: Shape) -> dict[str, ca.MX]:
    """Return the NLP of a shape: parameters are `common`, then the columns of each kind of frequency."""
    one = _at_one_frequency(shape)
    z, common = ca.MX.sym("z", one.z.numel()), ca.MX.sym("common", one.common.numel())
    epigraph = ca.MX.sym("t") if shape.epigraph else ca.MX(0)
    y = ca.MX.sym("y", shape.moving)
    parameters: list[ca.MX] = [common]

    def columns(name: str, rows: int, count: int) -> ca.MX:
        numbers = ca.MX.sym(name, rows, count)
        parameters.append(ca.vec(numbers))
        return numbers

    def at_each(kind: str, count: int) -> ca.MX:
        inputs = one.inputs[kind]
        value = ca.Function(kind, [one.z, one.common, one.epigraph, inputs], [one.values[kind]])
        return value.map(count)(z, common, epigraph, columns(kind, inputs.numel(), count)).T

    errors = [_mean_errors(shape, at_each)] if shape.norm == "rms" else []
    demands = [at_each(kind, count) for kind, count in zip(DEMANDS, shape.slots, strict=True) if count]
    if shape.moving:
        follow = ca.Function("moving", [one.z, one.common, one.inputs["moving"]], [one.values["moving"]])
        places = ca.vertcat(y.T, columns("plants", PLANT, shape.moving))
        demands.append(ca.vec(follow.map(shape.moving)(z, common, places)))
    if shape.epigraph:
        unknowns, objective = ca.vertcat(z, y, epigraph), epigraph
        demands += [epigraph - error for error in errors if shape.errors]
    else:
        unknowns, objective = ca.vertcat(z, y), errors[0]
    return {"x": unknowns, "f": objective, "g": ca.vertcat(*demands), "p": ca.vertcat(*parameters)}


def _mean_errors(shape: Shape, at_each: Callable[[str, int], ca.MX]) -> ca.MX:
    """Return the logarithm of the error in the mean for each device that counts."""
    nodes = PANEL_NODES * shape.panels
    squares = at_each("node", nodes * shape.counted)
    if shape.counted > 1:
        squares = ca.reshape(squares, nodes, shape.counted)
    return ca.log(ca.sum1(squares)).T / 2
