"""Run the firmware as one pure function from (state, measurement) to (state, command)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import lru_cache

from vctune.model.device import Commanded
from vctune.model.experiment import Environment
from vctune.model.gains import AnyCoupling, SpringDamper
from vctune.model.numbers.arithmetic import Number
from vctune.simulation.firmware import equations
from vctune.simulation.firmware.coefficient_values import (
    coupling_coefficients,
    environment_coefficients,
    limit_coefficients,
)
from vctune.simulation.firmware.equations import Equation, Parts
from vctune.simulation.firmware.expression import Symbol, value
from vctune.simulation.firmware.operations import Arithmetic


@dataclass(frozen=True, slots=True)
class Law:
    """The parameters of the firmware."""

    sample_time: float  # T, s
    velocity: float  # K_v, K_p and K_i of the law K_v + K_p/s + K_i/s^2, N s/m, N/m, N/(m s)
    position: float
    integral: float
    coupling: AnyCoupling | None  # damping b_c and mass m_c in series with the drag b_0 in parallel
    virtual_mass: float  # mass and damping in parallel with the environment, kg, N s/m
    virtual_damping: float
    environment: Environment  # the rendered environment
    position_resolution: float  # resolution of the encoder, m; 0 for an ideal encoder
    difference: bool  # True if the velocity is the backward difference of the measured position
    smoothing: float | None  # a of the low-passes y += a (x - y) of the velocity; None without low-passes
    low_passes: int  # number of these low-passes, up to 2
    limit: float | None  # greatest force, N
    command: Commanded = "force"  # kind of command


@dataclass(frozen=True, slots=True)
class Measurement:
    """The measurement at a sample: position [m] and velocity [m/s] of the motor, and force of the hand [N]."""

    position: Number
    velocity: Number
    force: Number


@dataclass(frozen=True, slots=True)
class State:
    """The state of the firmware."""

    reference: Number  # x_e and v_e, position and velocity of the rendered environment, m, m/s
    desired: Number
    coupling: Number  # force of the coupling's damper and mass, N; not for an impedance display
    integral: Number  # integral of the position error, m s; for a regular PID
    measured: Number  # position at the previous sample, rounded to the encoder's steps, m
    filtered: Number  # velocity after the first and after the second low-pass, m/s
    twice_filtered: Number
    inertia: Number = 0.0  # force of the environment's mass, N; only the trapezoidal rule needs this force
    smoothed: Number = 0.0  # v_e after the first and after the second low-pass, m/s; for an impedance display
    twice_smoothed: Number = 0.0
    ahead: Number = 0.0  # v_e of the next sample, m/s
    late_1: Number = 0.0
    late_2: Number = 0.0
    late_3: Number = 0.0
    late_4: Number = 0.0
    late_5: Number = 0.0
    late_6: Number = 0.0
    late_7: Number = 0.0
    late_8: Number = 0.0
    late_9: Number = 0.0
    late_10: Number = 0.0


@dataclass(frozen=True, slots=True)
class Command:
    """The command, and the environment's force f_e, N. The command is the motor's force, N, or a servo's velocity, m/s,
    or position, m."""

    given: Number
    environment: Number


def control(law: Law, state: State, measurement: Measurement, ops: Arithmetic) -> tuple[State, Command]:
    """Run the firmware for one sample."""
    equations_of_law, coefficients = _written(law)
    values = dict(coefficients)
    values |= {Symbol(name, before=True): getattr(state, name) for name in _REMEMBERED}
    values[Symbol("measured_position")] = measurement.position
    values[Symbol("measured_velocity")] = measurement.velocity
    values[Symbol("measured_force")] = measurement.force
    for equation in equations_of_law:
        values[Symbol(equation.quantity.name)] = value(equation.right, values, ops)
    remembered = {name: values[Symbol(name)] for name in remembered_by(law)}
    kept = State(**{name: remembered.get(name, getattr(state, name)) for name in _REMEMBERED})
    return kept, Command(values[Symbol("command")], values[Symbol("environment_force")])


_REMEMBERED = tuple(field.name for field in fields(State))


def parts_of(law: Law) -> Parts:
    """Return the parts of the firmware that runs a given law."""
    rendered = law.environment
    return Parts(
        quantised=law.position_resolution > 0,
        difference=law.difference,
        low_passes=law.low_passes,
        coupling=law.coupling is not None,
        virtual=law.virtual_mass > 0,
        mass=rendered.mass > 0,
        trapezoid=rendered.rule == "trapezoid",
        explicit=rendered.rule == "explicit",
        late=rendered.late,
        contact=rendered.stiffness > 0 or rendered.damping > 0,
        wall=rendered.wall,
        integral=law.integral > 0,
        limit=law.limit is not None,
        spring=isinstance(law.coupling, SpringDamper),
        command=law.command,
    )


def coefficients_of(law: Law) -> dict[str, float]:
    """Return the coefficients of a firmware, by their names in `equations.COEFFICIENTS`."""
    T, coefficients = (
        law.sample_time,
        coupling_coefficients(law.coupling, law.sample_time, law.smoothing, law.low_passes),
    )
    coefficients["resistance"] += law.virtual_mass / T + law.virtual_damping
    return {
        "sample_time": T,
        "half_sample_time": T / 2,
        "velocity_gain": law.velocity,
        "position_gain": law.position,
        "integral_gain": law.integral,
        "virtual_inertance": law.virtual_mass / T,
        "smoothing": 1.0 if law.smoothing is None else law.smoothing,
        "resolution": law.position_resolution,
        **coefficients,
        **environment_coefficients(law.environment, T),
        **limit_coefficients(law.limit, law.position, law.integral),
    }


def remembered_by(law: Law) -> tuple[str, ...]:
    """Return the fields of `State` that a firmware needs at its next sample."""
    return equations.remembered(parts_of(law))


@lru_cache(maxsize=64)
def _written(law: Law) -> tuple[tuple[Equation, ...], dict[Symbol, Number]]:
    """Return the equations of a firmware and the values of its coefficients."""
    written = tuple(_blocks(parts_of(law)))
    return written, {Symbol(name): number for name, number in coefficients_of(law).items()}


def _blocks(parts: Parts) -> Iterator[Equation]:
    yield from equations.estimate(parts)
    yield from equations.drive(parts)
    yield from equations.environment(parts)
    yield from equations.law(parts)


def encoded(law: Law, position: Number, ops: Arithmetic) -> Number:
    """Return a position rounded to the encoder's steps, m; the position itself with an ideal encoder."""
    return value(
        equations.encoded_position(parts_of(law)),
        {Symbol("measured_position"): position, Symbol("resolution"): law.position_resolution},
        ops,
    )
