"""State the firmware as difference equations with named coefficients, in the order of execution."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from vctune.model.device import Commanded
from vctune.model.experiment import MOST_LATE
from vctune.model.numbers.units import Units
from vctune.simulation.firmware.expression import Expression, Symbol, Term, choice, floor, maximum, minimum


@dataclass(frozen=True, slots=True)
class Quantity:
    """A quantity of the firmware: its name, symbol, unit and meaning."""

    name: str  # name in code, and symbol in formulas
    symbol: str
    of: str  # kind of quantity, which determines the unit (`vctune.model.numbers.units`); "" if dimensionless
    meaning: str  # meaning, in the words of a linear device

    def unit(self, units: Units) -> str:
        """Return the unit of the quantity; "1" if it is dimensionless."""
        return units.of(self.of) or "1"


@dataclass(frozen=True, slots=True)
class Equation:
    """An equation: a quantity, and its formula in earlier quantities, coefficients and inputs."""

    quantity: Quantity
    right: Term


@dataclass(frozen=True, slots=True)
class Parts:
    """The parts of a firmware."""

    quantised: bool = False  # whether the equations round the position to the encoder's steps
    difference: bool = False  # True if the velocity is the backward difference of the position
    low_passes: int = 0  # number of low-passes of the velocity, 0 to 2
    coupling: bool = True  # whether there is a virtual coupling
    virtual: bool = False  # whether there is a virtual mass and damping in parallel with the environment
    mass: bool = True  # whether the environment has a mass, and whether this mass may follow the trapezoidal rule
    trapezoid: bool = True
    contact: bool = True  # whether the environment has stiffness or damping
    explicit: bool = False  # whether the firmware integrates the environment by explicit Euler
    late: int = 0  # number of samples by which the environment's force is late
    wall: bool = True  # whether stiffness and damping may be one-sided
    integral: bool = False  # whether the law also integrates the position error
    limit: bool = True  # whether the firmware limits the force, and with the force also the integral terms of the law
    spring: bool = False  # whether the coupling is a spring and a damper, as for an impedance display
    command: Commanded = "force"  # kind of command: a force, or the velocity or the position that a servo follows

    @property
    def ahead(self) -> bool:
        """Whether the environment's mass responds to a force only at the next sample, and the environment is not
        late."""
        return self.mass and self.explicit and self.late == 0


# exports print these meanings after name and symbol of the quantity
COMMANDS: Mapping[Commanded, Quantity] = MappingProxyType(
    {
        "force": Quantity("command", "u", "force", "force that the motor is commanded"),
        "velocity": Quantity("command", "u", "speed", "velocity that the servo is commanded"),
        "position": Quantity("command", "u", "position", "position that the servo is commanded"),
    }
)
INPUTS = (
    Quantity("measured_position", "x", "position", "position of the motor, as the encoder has it"),
    Quantity("measured_velocity", "v", "speed", "velocity of the motor, where it is measured"),
    Quantity("measured_force", "f_s", "force", "force of the hand, as the sensor has it just before the command acts"),
)
COEFFICIENTS = {
    name: Quantity(name, *fields)
    for name, fields in {
        "sample_time": ("T", "time", "sample time"),
        "half_sample_time": ("T/2", "time", "half the sample time"),
        "velocity_gain": ("K_v", "damping", "velocity gain"),
        "position_gain": ("K_p", "stiffness", "position gain"),
        "integral_gain": ("K_i", "integral_gain", "gain of the integrated position error"),
        "coupling_step": ("b_c/(1 + a)", "damping", "force of the coupling per step of v_e, a = T b_c/(2 m_c)"),
        "coupling_decay": ("(1 - a)/(1 + a)", "", "what a sample leaves of the coupling's force"),
        "coupling_stiffness": ("k_c", "stiffness", "stiffness of the coupling"),
        "coupling_damping": ("b_c", "damping", "damping of the coupling"),
        "resistance": ("R_v", "damping", "force per v_e, of all but the environment"),
        "virtual_inertance": ("M_0/T", "damping", "of the virtual mass"),
        "smoothing": ("a_f", "", "of the velocity's low-pass, 1 - exp(-2 pi f T)"),
        "resolution": ("q", "position", "of the encoder"),
        "limit": ("u_max", "force", "greatest force"),
        "position_reach": ("u_max/K_p", "position", "position error whose force is the limit"),
        "integral_reach": ("u_max/K_i", "position_integral", "integrated position error whose force is the limit"),
        "inertance": ("M/T", "damping", "of the environment's mass; twice that by the trapezoidal rule"),
        "inertia_carry": ("c", "", "0 by backward Euler, 1 by the trapezoidal rule"),
        "stiffness": ("k", "stiffness", "of the environment's spring"),
        "zero": ("x_0", "position", "where the spring is without force"),
        "slope": ("b + k h", "damping", "of damper and spring per v_e; h is T, by the trapezoidal rule T/2"),
        "least_contact": ("f_min", "force", "least force of spring and damper: 0 at a wall, else none"),
    }.items()
}
# All quantities that may belong to the state of a firmware
STATE = {
    name: Quantity(name, *fields)
    for name, fields in {
        "reference": ("x_e", "position", "position of the environment"),
        "desired": ("v_e", "speed", "velocity of the environment"),
        "coupling": ("f_c", "force", "force of the coupling's damper and mass"),
        "integral": ("i", "position_integral", "integrated position error"),
        "measured": ("x", "position", "position of the motor"),
        "filtered": ("v_1", "speed", "velocity behind the first low-pass"),
        "twice_filtered": ("v_2", "speed", "velocity behind the second low-pass"),
        "smoothed": ("w_1", "speed", "v_e behind the first low-pass"),
        "twice_smoothed": ("w_2", "speed", "v_e behind the second low-pass"),
        "inertia": ("f_m", "force", "force of the environment's mass"),
        "ahead": ("v_e+", "speed", "velocity of the environment's mass at the next sample"),
        **{
            f"late_{k}": (f"f_{k}", "force", f"force of the environment that acts {k} samples later")
            for k in range(1, MOST_LATE + 1)
        },
    }.items()
}


def remembered(parts: Parts) -> tuple[str, ...]:
    """Return the part of `STATE` that a firmware needs at its next sample."""
    needed = {
        "coupling": parts.coupling and not parts.spring,
        "integral": parts.integral,
        "measured": parts.difference,
        "filtered": parts.low_passes > 0,
        "twice_filtered": parts.low_passes > 1,
        "smoothed": parts.spring and parts.low_passes > 0,
        "twice_smoothed": parts.spring and parts.low_passes > 1,
        "inertia": parts.mass and parts.trapezoid,
        "ahead": parts.ahead,
        **{f"late_{k}": k <= parts.late for k in range(1, MOST_LATE + 1)},
    }
    return tuple(name for name in STATE if needed.get(name, True))


def _new(name: str, symbol: str, of: str, meaning: str, right: Term) -> Equation:
    return Equation(Quantity(name, symbol, of, meaning), right)


def _kept(name: str, right: Term) -> Equation:
    return Equation(STATE[name], right)


def _now(name: str) -> Symbol:
    return Symbol(name)


def _was(name: str) -> Symbol:
    return Symbol(name, before=True)


def encoded_position(parts: Parts) -> Term:
    """Return the measured position, rounded to the encoder's steps."""
    position = _now("measured_position")
    if parts.quantised:
        return _now("resolution") * floor(position / _now("resolution") + 0.5)
    return position


def estimate(parts: Parts) -> Iterator[Equation]:
    """Yield the estimates of the motion: position, and the velocity for the law."""
    if parts.command != "force":
        return
    yield _kept("measured", encoded_position(parts))
    velocity: Term = _now("measured_velocity")
    if parts.difference:
        velocity = (_now("measured") - _was("measured")) / _now("sample_time")
    yield _new("raw_velocity", "v'", "speed", "velocity before the low-passes", velocity)
    source = "raw_velocity"
    for name in ("filtered", "twice_filtered")[: parts.low_passes]:
        yield _kept(name, _was(name) + _now("smoothing") * (_now(source) - _was(name)))
        source = name
    yield _new("velocity", "v_hat", "speed", "velocity that the law acts on", _now(source))


def drive(parts: Parts) -> Iterator[Equation]:
    """Yield the force that drives the environment, and x_e, both without the share of the new v_e."""
    if parts.spring:
        yield from _pulled(parts)
        return
    force: Expression = _now("measured_force")
    if parts.coupling:
        force = force + _now("coupling_step") * _was("desired") - _now("coupling_decay") * _was("coupling")
    if parts.virtual:
        force = force + _now("virtual_inertance") * _was("desired")
    yield _new("drive", "f", "force", "force that is left to drive v_e", force)
    yield _middle()


def _middle() -> Equation:
    middle = _was("reference") + _now("half_sample_time") * _was("desired")
    return _new("middle", "x_m", "position", "x_e without the share of the new v_e", middle)


def _pulled(parts: Parts) -> Iterator[Equation]:
    """Yield the force of spring and damper between handle and tool, without the part that depends on the new v_e."""
    yield _middle()
    apart: Expression = _now("velocity")
    for name in ("smoothed", "twice_smoothed")[: parts.low_passes]:
        carried = _was(name) - _now("smoothing") * _was(name)
        yield _new(f"{name}_carried", f"{STATE[name].symbol}'", "speed", "what a sample leaves of it", carried)
    if parts.low_passes == 1:
        apart = apart - _now("smoothed_carried")
    elif parts.low_passes == 2:
        apart = apart - _now("twice_smoothed_carried") - _now("smoothing") * _now("smoothed_carried")
    yield _new("apart", "d", "speed", "velocity of the handle from the tool, without the share of the new v_e", apart)
    force = _now("coupling_stiffness") * (_now("measured") - _now("middle")) + _now("coupling_damping") * _now("apart")
    yield _new("drive", "f", "force", "force of the coupling, without the share of the new v_e", force)


def environment(parts: Parts) -> Iterator[Equation]:
    """Yield the environment: f_e, and the v_e that solves resistance v_e + f_e = drive."""
    if parts.late or parts.ahead:
        yield from _late_environment(parts) if parts.late else _explicit_environment()
        return
    total: Term = _now("resistance")
    pushed: Term = _now("drive")
    if parts.mass:
        total = total + _now("inertance")
        pushed = pushed + _now("inertance") * _was("desired")
        if parts.trapezoid:
            pushed = pushed + _now("inertia_carry") * _was("inertia")
    yield _new("pushed", "f_p", "force", "drive plus the terms of the mass from the previous sample", pushed)
    yield _new("total", "r", "damping", "force per v_e without spring and damper", total)
    yield _new("free", "v_f", "speed", "v_e without spring and damper", _now("pushed") / _now("total"))
    contact: Term = 0.0
    if parts.contact:
        offset = _now("stiffness") * (_now("middle") - _now("zero"))
        yield _new("offset", "f_0", "force", "force of the spring without a step", offset)
        met: Term = (_now("pushed") - _now("offset")) / (_now("total") + _now("slope"))
        if parts.wall:
            met = choice(_now("offset") + _now("slope") * _now("free"), _now("least_contact"), met, _now("free"))
        yield _kept("desired", met)
        contact = _now("offset") + _now("slope") * _now("desired")
        if parts.wall:
            contact = maximum(_now("least_contact"), contact)
    else:
        yield _kept("desired", _now("free"))
    if parts.mass:
        inertia = _now("inertance") * (_now("desired") - _was("desired"))
        yield _kept("inertia", inertia - _now("inertia_carry") * _was("inertia") if parts.trapezoid else inertia)
        contact = contact + _now("inertia")
    yield _new("environment_force", "f_e", "force", "force of the environment", contact)


def _explicit_environment() -> Iterator[Equation]:
    """Yield an environment whose mass steps by explicit Euler and responds to a force at the next sample."""
    yield _kept("desired", _was("ahead"))
    yield _contact()
    inertia = _now("drive") - _now("resistance") * _now("desired") - _now("contact")
    yield _new("accelerating", "f_m", "force", "force that is left to the mass", inertia)
    yield _kept("ahead", _now("desired") + _now("accelerating") / _now("inertance"))
    yield _force(_now("contact") + _now("accelerating"))


def _late_environment(parts: Parts) -> Iterator[Equation]:
    """Yield an environment whose force acts some samples later."""
    inertia_delay = parts.late - 1 if parts.explicit else parts.late
    inertia_acts_at_once = parts.mass and inertia_delay == 0
    total: Term = _now("resistance")
    pushed: Term = _now("drive") - _was("late_1")
    if inertia_acts_at_once:
        total = total + _now("inertance")
        pushed = pushed + _now("inertance") * _was("desired")
    yield _new("pushed", "f_p", "force", "drive without the force that acts", pushed)
    yield _kept("desired", _now("pushed") / total)
    yield _contact()
    new_force: dict[int, Term] = {parts.late: _now("contact")}
    if parts.mass:
        inertia = _now("inertance") * (_now("desired") - _was("desired"))
        if parts.trapezoid:
            yield _kept("inertia", inertia - _now("inertia_carry") * _was("inertia"))
        else:
            yield _new("inertia", "f_m", "force", "force of the mass", inertia)
        if inertia_delay:
            new_force[inertia_delay] = (
                new_force[inertia_delay] + _now("inertia") if inertia_delay in new_force else _now("inertia")
            )
    yield _force(_was("late_1") + _now("inertia") if inertia_acts_at_once else _was("late_1"))
    for k in range(1, parts.late + 1):
        waiting = _was(f"late_{k + 1}")
        yield _kept(
            f"late_{k}", new_force[k] if k == parts.late else waiting + new_force[k] if k in new_force else waiting
        )


def _contact() -> Equation:
    """Return the equation of the environment's spring and damper force at the velocity of this sample."""
    spring = _now("stiffness") * (_now("middle") - _now("zero")) + _now("slope") * _now("desired")
    return _new("contact", "f_0", "force", "force of spring and damper", spring)


def _force(right: Term) -> Equation:
    return _new("environment_force", "f_e", "force", "force of the environment", right)


def law(parts: Parts) -> Iterator[Equation]:
    """Yield the coupling, the reference, and the law K_v + K_p/s + K_i/s^2 on the velocity error, with its limit."""
    if parts.spring:
        yield from _rendered(parts)
        return
    if parts.coupling:
        step = _now("coupling_step") * (_now("desired") - _was("desired"))
        yield _kept("coupling", _now("coupling_decay") * _was("coupling") + step)
    reference = _now("middle") + _now("half_sample_time") * _now("desired")
    if parts.command != "force":
        yield _kept("reference", reference)
        yield Equation(COMMANDS[parts.command], _now("desired" if parts.command == "velocity" else "reference"))
        return
    yield _new("led", "x_e'", "position", "x_e, unless the limit acts", reference)
    yield _new("error", "e", "position", "position error", _now("led") - _now("measured"))
    force = _now("velocity_gain") * (_now("desired") - _now("velocity")) + _now("position_gain") * _now("error")
    if parts.integral:
        integral = _was("integral") + _now("sample_time") * _now("error")
        yield _new("summed", "i'", "position_integral", "integrated position error, unless the limit acts", integral)
        force = force + _now("integral_gain") * _now("summed")
    yield _new("asked", "u'", "force", "force before it is limited", force)
    if not parts.limit:
        yield _kept("reference", _now("led"))
        if parts.integral:
            yield _kept("integral", _now("summed"))
        yield Equation(COMMANDS["force"], _now("asked"))
        return
    yield _new("size", "|u'|", "force", "its size", maximum(-_now("asked"), _now("asked")))
    slip = choice(_now("size"), _now("limit"), _now("error") - _within("position_reach", _now("error")), 0.0)
    yield _new("slip", "d", "position", "by how much x_e goes back to the handle where the limit acts", slip)
    yield _kept("reference", _now("led") - _now("slip"))
    if parts.integral:
        held = _within("integral_reach", _now("summed"))
        yield _kept("integral", choice(_now("size"), _now("limit"), held, _now("summed")))
    yield Equation(COMMANDS["force"], _within("limit", _now("asked")))


def _rendered(parts: Parts) -> Iterator[Equation]:
    """Yield the state of the tool, and the command, with which coupling and damping oppose the motion."""
    source = "desired"
    for name in ("smoothed", "twice_smoothed")[: parts.low_passes]:
        yield _kept(name, _was(name) + _now("smoothing") * (_now(source) - _was(name)))
        source = name
    yield _kept("reference", _now("middle") + _now("half_sample_time") * _now("desired"))
    met = _now("drive") - _now("resistance") * _now("desired")
    yield _new("coupled", "f_c", "force", "force of the coupling", met)
    asked = -_now("coupled") - _now("velocity_gain") * _now("velocity")
    yield _new("asked", "u'", "force", "force before it is limited", asked)
    yield Equation(COMMANDS["force"], _within("limit", _now("asked")) if parts.limit else _now("asked"))


def _within(bound: str, term: Symbol) -> Expression:
    """Return a term, limited to the range from -bound to bound."""
    return maximum(-_now(bound), minimum(_now(bound), term))
