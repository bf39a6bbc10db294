"""Run the firmware of a display: one function from (state, measurement) to (state, command).

`control` and firmware/templates/vctune_controller.c.j2 have the same lines; the replay of exports compares them to the
last bit."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from math import inf
from typing import Any, NamedTuple

from vctune.model.device import Commanded
from vctune.model.experiment import Environment
from vctune.model.gains import AnyCoupling, Coupling, Rule, SpringDamper, stepped
from vctune.model.numbers.arithmetic import Number
from vctune.model.sections import Section


def exact(decimal: float) -> Fraction:
    """Return the printed decimal of a float as a fraction."""
    return Fraction(repr(float(decimal)))


def coupling_coefficients(
    coupling: AnyCoupling | None, sample_time: float, filters: Sequence[Section] = (), rule: Rule = "trapezoid"
) -> dict[str, float]:
    """Return the coefficients of a coupling; the rule is that of a servo or an admittance display."""
    if coupling is None:
        return {"resistance": 0.0}
    if isinstance(coupling, SpringDamper):
        at_once = math.prod((exact(section.now) for section in filters), start=Fraction(1))
        resistance = exact(coupling.stiffness) * exact(sample_time) + exact(coupling.damping) * at_once
        return {
            "coupling_stiffness": coupling.stiffness,
            "coupling_damping": coupling.damping,
            "resistance": float(resistance),
        }
    damping = coupling.damping if coupling.rigid else exact(coupling.damping)
    drag = exact(coupling.drag)
    step, decay = stepped(Coupling(damping, exact(coupling.mass), drag), exact(sample_time), rule)
    resistance = step + drag
    return {"coupling_step": float(step), "coupling_decay": float(decay), "resistance": float(resistance)}


def coupling_of(coefficients: dict[str, float], sample_time: float, rule: Rule = "trapezoid") -> AnyCoupling:
    """Return the coupling that has given coefficients, up to the rounding of its parameters."""
    if "coupling_stiffness" in coefficients:
        return SpringDamper(coefficients["coupling_damping"], coefficients["coupling_stiffness"])
    step, decay = coefficients["coupling_step"], coefficients["coupling_decay"]
    if rule == "euler":
        return Coupling(inf, sample_time * coefficients["resistance"], coefficients["resistance"] - step)
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
    rigid: bool = False  # whether it does not move where it is met


def rendering(environment: Environment, sample_time: Number) -> Rendering:
    """Return the coefficients of an environment, in the precision of its numbers."""
    T, trapezoid, rigid = sample_time, environment.rule == "trapezoid", environment.rigid
    reach = {"trapezoid": T / 2, "explicit": 0.0}.get(environment.rule, T)
    return Rendering(
        inertance=(2 * environment.mass if trapezoid else environment.mass) / T,
        inertia_carry=1.0 if trapezoid and environment.mass > 0 else 0.0,
        stiffness=0.0 if rigid else environment.stiffness,
        zero=environment.zero,
        slope=environment.damping + (0.0 if rigid else reach * environment.stiffness),
        least_contact=0.0 if environment.wall else -inf,
        explicit=environment.rule == "explicit",
        late=environment.late,
        rigid=rigid,
    )


class Operations(NamedTuple):
    """Elementary functions of one kind of number."""

    exp: Callable[[Any], Any]
    expm1: Callable[[Any], Any]
    absolute: Callable[[Any], Any]
    floor: Callable[[Any], Any]
    minimum: Callable[[Any, Any], Any]
    maximum: Callable[[Any, Any], Any]
    where: Callable[[Any, Any, Any], Any]  # (condition, yes, no); the caller evaluates both numbers


FLOATS = Operations(
    math.exp, math.expm1, abs, math.floor, min, max, lambda condition, yes, no: yes if condition else no
)


@dataclass(frozen=True, slots=True)
class Law:
    """The parameters of a firmware."""

    sample_time: float  # T, s
    velocity: float  # K_v, K_p and K_i of the law K_v + K_p/s + K_i/s^2, N s/m, N/m, N/(m s)
    position: float
    integral: float
    coupling: AnyCoupling | None
    virtual_mass: float  # mass and damping in parallel with the environment, kg, N s/m
    virtual_damping: float
    environment: Environment  # the rendered environment
    position_resolution: float  # resolution of the encoder, m; 0 for an ideal encoder
    difference: bool  # True if the velocity is the backward difference of the measured position
    velocity_filter: tuple[Section, ...]  # the filters of the velocity and of the sensed force
    force_filter: tuple[Section, ...]
    limit: float | None  # greatest force, N
    command: Commanded = "force"
    rule: Rule = "trapezoid"  # of the coupling
    own_stiffness: float = 0.0  # spring of the firmware on a servo's position, N/m, and where it is at rest, m
    own_zero: float = 0.0


@dataclass(frozen=True, slots=True)
class Controller:
    """A firmware with its coefficients, all in one precision. A part that is absent has a number without effect."""

    command: Commanded
    euler: bool  # whether it steps M a + D v = F by Euler
    spring: bool  # whether the coupling is a spring and a damper, as for an impedance display
    difference: bool
    velocity_filter: tuple[Section, ...]
    force_filter: tuple[Section, ...]
    environment: Rendering
    sample_time: Number
    half_sample_time: Number
    velocity_gain: Number
    position_gain: Number
    integral_gain: Number
    virtual_inertance: Number  # M_0/T of the virtual mass, N s/m
    resolution: Number
    limit: Number  # N; inf for none
    resistance: Number  # force per v_e of all but the environment, N s/m
    coupling_step: Number = 0.0  # force of the coupling per step of v_e, N s/m
    coupling_decay: Number = 0.0  # what a sample leaves of the coupling's force
    coupling_stiffness: Number = 0.0
    coupling_damping: Number = 0.0
    own_stiffness: Number = 0.0
    own_zero: Number = 0.0  # m


def controller_of(law: Law) -> Controller:
    """Return a firmware with the coefficients of its law."""
    T = law.sample_time
    coupling = coupling_coefficients(law.coupling, T, law.velocity_filter, law.rule)
    coupling["resistance"] += law.virtual_mass / T + law.virtual_damping
    return Controller(
        command=law.command,
        euler=law.rule == "euler",
        spring=isinstance(law.coupling, SpringDamper),
        difference=law.difference,
        velocity_filter=law.velocity_filter,
        force_filter=law.force_filter,
        environment=rendering(law.environment, T),
        sample_time=T,
        half_sample_time=T / 2,
        velocity_gain=law.velocity,
        position_gain=law.position,
        integral_gain=law.integral,
        virtual_inertance=law.virtual_mass / T,
        resolution=law.position_resolution,
        limit=inf if law.limit is None else law.limit,
        own_stiffness=law.own_stiffness,
        own_zero=law.own_zero,
        **coupling,
    )


@dataclass(frozen=True, slots=True)
class Measurement:
    """The measurement at a sample: position [m] and velocity [m/s] of the motor, and force of the hand [N]."""

    position: Number
    velocity: Number
    force: Number


@dataclass(frozen=True, slots=True)
class State:
    """The state of a firmware. Numbers that it does not use are 0."""

    reference: Number  # x_e and v_e, position and velocity of the rendered environment, m, m/s
    desired: Number
    measured: Number  # position at the previous sample, as the encoder has it, m
    coupling: Number  # force of the coupling's damper and mass, N; not for an impedance display
    integral: Number  # integral of the position error, m s
    inertia: Number  # force of the environment's mass, N
    ahead: Number  # v_e of the next sample, m/s, of a mass by explicit Euler
    filtered: tuple[Number, ...]  # memory of the filter of the velocity, m/s
    smoothed: tuple[Number, ...]  # memory of the same filter of v_e, m/s; for an impedance display
    sensed: tuple[Number, ...]  # memory of the filter of the sensed force, N
    late: tuple[Number, ...]  # forces of a late environment that act at the next samples, N


@dataclass(frozen=True, slots=True)
class Command:
    """The command, and the environment's force f_e, N. The command is the motor's force, N, or a servo's velocity, m/s,
    or position, m."""

    given: Number
    environment: Number


def at_rest(c: Controller, position: Number, reference: Number, force: Number = 0.0) -> State:
    """Return the state of a handle at rest, in a hand with a constant force."""
    still = (0.0,) * sum(map(memory_of, c.velocity_filter))
    late, smoothed = (0.0,) * c.environment.late, still if c.spring else ()
    sensed = (force,) * sum(map(memory_of, c.force_filter))
    return State(reference, 0.0, position, 0.0, 0.0, 0.0, 0.0, still, smoothed, sensed, late)


def memory_of(section: Section) -> int:
    """Return how many numbers a section remembers: y, and unless it is a low-pass y_2, x_1 and x_2."""
    return 1 if section.low_pass else 4


def control(c: Controller, state: State, read: Measurement, ops: Operations) -> tuple[State, Command]:
    """Run the firmware for one sample."""
    measured = encoded(c, read.position, ops)
    velocity = (measured - state.measured) / c.sample_time if c.difference else read.velocity
    velocity, filtered = passed(c.velocity_filter, state.filtered, velocity)
    sensed, heard = passed(c.force_filter, state.sensed, read.force)
    if c.own_stiffness > 0:
        sensed = sensed - c.own_stiffness * (read.position - c.own_zero)
    if c.environment.rigid:
        pressed = _pressed(c, measured, velocity, ops)
        still = replace(state, reference=c.environment.zero, measured=measured, filtered=filtered)
        return still, Command(_within(c.limit, -pressed - c.velocity_gain * velocity, ops), pressed)
    middle = state.reference + c.half_sample_time * state.desired
    if c.spring:
        apart = velocity - passed(c.velocity_filter, state.smoothed, 0.0)[0]  # without the share of the new v_e
        drive = c.coupling_stiffness * (measured - middle) + c.coupling_damping * apart
    else:
        drive = sensed + c.coupling_step * state.desired - c.coupling_decay * state.coupling
        drive = drive + c.virtual_inertance * state.desired
    desired, force, inertia, ahead, late = _rendered(c, state, drive, middle, ops)
    smoothed = passed(c.velocity_filter, state.smoothed, desired)[1] if c.spring else ()
    coupling = c.coupling_decay * state.coupling + c.coupling_step * (desired - state.desired)
    led, integral = middle + c.half_sample_time * desired, state.integral  # x_e, unless the limit acts
    if c.command != "force":
        # x += T v is half a step ahead of the trapezoidal sum
        commanded = led + c.half_sample_time * desired if c.euler else led
        reference, given = led, desired if c.command == "velocity" else commanded
    elif c.spring:
        asked = -(drive - c.resistance * desired) - c.velocity_gain * velocity
        reference, given = led, _within(c.limit, asked, ops)
    else:
        error = led - measured
        asked = c.velocity_gain * (desired - velocity) + c.position_gain * error
        if c.integral_gain > 0:
            integral = state.integral + c.sample_time * error
            asked = asked + c.integral_gain * integral
        limited = ops.maximum(-asked, asked) > c.limit
        if c.integral_gain > 0:
            held = _within(c.limit / c.integral_gain, integral, ops)
            integral = ops.where(limited, held, integral)
        # x_e goes back to the handle where the limit acts
        reach = c.limit / c.position_gain if c.position_gain > 0 else inf
        reference = ops.where(limited, led - (error - _within(reach, error, ops)), led)
        given = _within(c.limit, asked, ops)
    after = State(reference, desired, measured, coupling, integral, inertia, ahead, filtered, smoothed, heard, late)
    return after, Command(given, force)


def _pressed(c: Controller, measured: Number, velocity: Number, ops: Operations) -> Number:
    """Return the force of the coupling as a wall, N: its spring and its damper, which at a one-sided wall only push."""
    force = c.coupling_stiffness * (measured - c.environment.zero) + c.coupling_damping * velocity
    return ops.maximum(c.environment.least_contact, force)


def encoded(c: Controller, position: Number, ops: Operations) -> Number:
    """Return a position rounded to the encoder's steps, m; the position itself with an ideal encoder."""
    return in_steps(c.resolution, position, ops)


def in_steps(step: Number, value: Number, ops: Operations) -> Number:
    """Return a value rounded to the steps of a reading; the value itself if these are 0."""
    return step * ops.floor(value / step + 0.5) if step > 0 else value


def _within(bound: Number, value: Number, ops: Operations) -> Number:
    return ops.maximum(-bound, ops.minimum(bound, value))


def passed(
    filters: tuple[Section, ...], memory: tuple[Number, ...], source: Number
) -> tuple[Number, tuple[Number, ...]]:
    """Return a signal behind the sections of a filter, and their memory."""
    value, before, after = source, list(memory), list[Number]()
    for section in filters:
        y, *older = before[: memory_of(section)]
        del before[: memory_of(section)]
        now = y + section.now * (value - y)
        after.append(now)
        if older:
            y_2, x_1, x_2 = older
            now = now + section.before * (x_1 - y) + section.earlier * (x_2 - y) + section.again * (y - y_2)
            after[-1:] = now, y, value, x_1
        value = now
    return value, tuple(after)


# v_e [m/s], the environment's force f_e [N], the force of its mass, v_e of the next sample, and the forces that wait
Rendered = tuple[Number, Number, Number, Number, tuple[Number, ...]]


def _rendered(c: Controller, state: State, drive: Number, middle: Number, ops: Operations) -> Rendered:
    """Solve resistance v_e + f_e(v_e) = drive."""
    e = c.environment
    if e.late or (e.explicit and e.inertance > 0):
        return _late_or_explicit(c, state, drive, middle)
    pushed = drive + e.inertance * state.desired + e.inertia_carry * state.inertia
    total = c.resistance + e.inertance
    offset = e.stiffness * (middle - e.zero)
    desired = (pushed - offset) / (total + e.slope)
    if e.least_contact > -inf:  # only a wall is left, and a loop with only a spring has no total
        free = pushed / total  # v_e without spring and damper
        desired = ops.where(offset + e.slope * free < e.least_contact, free, desired)
    contact = ops.maximum(e.least_contact, offset + e.slope * desired)
    inertia = e.inertance * (desired - state.desired) - e.inertia_carry * state.inertia
    return desired, contact + inertia, inertia, state.ahead, ()


def _late_or_explicit(c: Controller, state: State, drive: Number, middle: Number) -> Rendered:
    """Render an environment that an export cannot: its force acts later, or its mass steps by explicit Euler."""
    e, spring = c.environment, c.environment.stiffness * (middle - c.environment.zero)
    if not e.late:  # the mass answers to a force at the next sample
        desired = state.ahead
        contact = spring + e.slope * desired
        left = drive - c.resistance * desired - contact
        return desired, contact + left, state.inertia, desired + left / e.inertance, ()
    inertia_late = e.late - e.explicit
    acting, *waiting = state.late
    at_once = 0.0 if inertia_late else e.inertance
    desired = (drive - acting + at_once * state.desired) / (c.resistance + at_once)
    inertia = e.inertance * (desired - state.desired) - e.inertia_carry * state.inertia
    late = [*waiting, spring + e.slope * desired]
    if inertia_late:
        late[inertia_late - 1] = late[inertia_late - 1] + inertia
        return desired, acting, inertia, state.ahead, tuple(late)
    return desired, acting + inertia, inertia, state.ahead, tuple(late)
