"""The firmware: one pure function from (state, measurement) to (state, force), to be ported line by line."""

from __future__ import annotations

from dataclasses import dataclass

from vctune.model.arithmetic import Number
from vctune.model.experiment import Environment
from vctune.model.quantities import Coupling
from vctune.simulation.arithmetic import Arithmetic


@dataclass(frozen=True, slots=True)
class Law:
    """The numbers of the firmware.

    Attributes
    ----------
    sample_time : s
    velocity, position, integral : K_v, K_p and K_i of the law K_v + K_p/s + K_i/s^2, N s/m, N/m, N/(m s)
    coupling : damping b_c and mass m_c in series and the drag b_0 beside them; None for no coupling
    virtual_mass, virtual_damping : beside the environment, kg, N s/m
    environment : what is rendered
    position_resolution : of the encoder, m; 0 for none
    difference : whether the velocity is the backward difference of the measured position; measured itself if not
    smoothing : a of the low-passes y += a (x - y) that the velocity goes through; None for none
    low_passes : how many of them, up to 2
    limit : greatest force, N; None for none
    """

    sample_time: float
    velocity: float
    position: float
    integral: float
    coupling: Coupling | None
    virtual_mass: float
    virtual_damping: float
    environment: Environment
    position_resolution: float
    difference: bool
    smoothing: float | None
    low_passes: int
    limit: float | None


@dataclass(frozen=True, slots=True)
class Measurement:
    """What the sensors say at a sample: position [m] and velocity [m/s] of the motor, force of the hand [N]."""

    position: Number
    velocity: Number
    force: Number


@dataclass(frozen=True, slots=True)
class State:
    """What the firmware remembers.

    Attributes
    ----------
    reference, desired : x_e and v_e, position and velocity of the rendered environment, m, m/s
    coupling : velocity of the coupling's mass, m/s
    integral : of the position error, m s
    measured : position at the sample before, m
    filtered, twice_filtered : velocity behind the first low-pass and behind the second, m/s
    inertia : force of the environment's mass, N; of the trapezoidal rule alone
    """

    reference: Number
    desired: Number
    coupling: Number
    integral: Number
    measured: Number
    filtered: Number
    twice_filtered: Number
    inertia: Number = 0.0


@dataclass(frozen=True, slots=True)
class Command:
    """The force that the motor is commanded, and the environment's share f_e of the hand's force, N."""

    force: Number
    environment: Number


def control(law: Law, state: State, measurement: Measurement, ops: Arithmetic) -> tuple[State, Command]:
    """Run the firmware for one sample.

    The hand's force drives coupling and environment, which move as one: f_h = (Z_c + Z_e) v_e (paper eqs. 15 to 18).
    What is stiff is implicit: v_e solves this equation at the end of the sample. Coupling and x_e follow the
    trapezoidal rule, whose impedances at omega are the continuous ones at (2/T) tan(omega T/2): it takes nothing
    from Re Z_c, on which the certificate rests. The environment follows backward Euler, which stays passive and
    damps what it cannot resolve, so that a wall may be as stiff as one likes; or the trapezoidal rule too, lossless.

    Parameters
    ----------
    law : the numbers of the firmware
    state : what it remembers from the sample before
    measurement : what its sensors say
    ops : arithmetic of state and measurement

    Returns
    -------
    state : to remember
    command : for the motor
    """
    T = law.sample_time
    position = encoded(law, measurement.position, ops)
    velocity, filtered, twice_filtered = _velocity(law, state, measurement.velocity, position)

    lossless = law.environment.rule == "trapezoid" and law.environment.mass > 0
    rendered = 2 * law.environment.mass if lossless else law.environment.mass
    mass = (law.virtual_mass + rendered) / T
    resistance, memory = mass + law.virtual_damping, mass * state.desired
    if lossless:
        memory = memory + state.inertia
    alpha = share = 0.0
    if law.coupling is not None:
        alpha = T * law.coupling.damping / (2 * law.coupling.mass)
        share = law.coupling.damping / (1 + alpha)
        resistance = resistance + share + law.coupling.drag
        memory = memory + share * ((1 - alpha) * state.coupling + alpha * state.desired)
    middle = state.reference + T / 2 * state.desired
    desired, environment = _rendered(law, measurement.force + memory, resistance, middle, ops)
    inertia = rendered / T * (desired - state.desired)
    if lossless:
        inertia = inertia - state.inertia
    environment = environment + inertia
    reference = middle + T / 2 * desired
    coupling = state.coupling
    if law.coupling is not None:
        coupling = ((1 - alpha) * state.coupling + alpha * (desired + state.desired)) / (1 + alpha)

    error = reference - position
    force = law.velocity * (desired - velocity) + law.position * error
    integral = state.integral
    if law.integral > 0:
        integral = state.integral + T * error
        force = force + law.integral * integral
    if law.limit is not None:
        force = ops.maximum(-law.limit, ops.minimum(law.limit, force))
    remembered = State(
        reference=reference,
        desired=desired,
        coupling=coupling,
        integral=integral,
        measured=position if law.difference else state.measured,
        filtered=filtered,
        twice_filtered=twice_filtered,
        inertia=inertia if lossless else state.inertia,
    )
    return remembered, Command(force, environment)


def encoded(law: Law, position: Number, ops: Arithmetic) -> Number:
    """Return a position as the encoder has it, m.

    Parameters
    ----------
    law : with the encoder's resolution, m
    position : m
    ops : arithmetic of the position
    """
    if law.position_resolution == 0:
        return position
    return law.position_resolution * ops.floor(position / law.position_resolution + 0.5)


def _velocity(law: Law, state: State, measured: Number, position: Number) -> tuple[Number, Number, Number]:
    """Return the velocity that the law acts on, and what its two low-passes remember."""
    velocity = (position - state.measured) / law.sample_time if law.difference else measured
    if law.smoothing is None:
        return velocity, state.filtered, state.twice_filtered
    filtered = state.filtered + law.smoothing * (velocity - state.filtered)
    if law.low_passes == 1:
        return filtered, filtered, state.twice_filtered
    twice_filtered = state.twice_filtered + law.smoothing * (filtered - state.twice_filtered)
    return twice_filtered, filtered, twice_filtered


def _rendered(law: Law, force: Number, resistance: Number, middle: Number, ops: Arithmetic) -> tuple[Number, Number]:
    """Return v_e with resistance v_e + damping v_e + stiffness (middle + h v_e - zero) = force, and f_e without mass.

    h is T, and T/2 by the trapezoidal rule. At a wall the last two terms are left out where their sum would pull.
    """
    Z_e = law.environment
    reach = law.sample_time / 2 if Z_e.rule == "trapezoid" else law.sample_time
    if Z_e.stiffness == 0 and Z_e.damping == 0:
        return force / resistance, 0.0
    offset, slope = Z_e.stiffness * (middle - Z_e.zero), Z_e.damping + reach * Z_e.stiffness
    desired = (force - offset) / (resistance + slope)
    if Z_e.wall:
        free = force / resistance
        desired = ops.where(offset + slope * free > 0, desired, free)
        return desired, ops.maximum(0.0, offset + slope * desired)
    return desired, offset + slope * desired
