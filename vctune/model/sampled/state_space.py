"""Compute the exact step over one sample of a device with an actuator or a structure."""

from __future__ import annotations

from dataclasses import dataclass

from vctune.model.device import Device
from vctune.model.loop.device_response import mechanism
from vctune.model.loop.drive import COMMAND, Rows, drive_rows, drive_states, pushed
from vctune.model.loop.filters import plain_low_pass_rates
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.matrices import (
    Matrix,
    Vector,
    add,
    added,
    applied,
    characteristic,
    column,
    dot,
    exponential_less_one,
    product,
    scaled,
    times,
)


@dataclass(frozen=True, slots=True)
class StepResponse:
    """The responses of velocity and position to a held force, as polynomials of x = z - 1, lowest power first."""

    open: Vector  # coefficients of det(x - psi) without the last, which is 1
    velocity: tuple[Vector, Vector]  # numerators for the newer and the older force of the sample
    position: tuple[Vector, Vector]


def sampled_states(device: Device, older: Number | None, ops: Arithmetic) -> StepResponse:
    """Sample a device with a held force, and with an actuator or a structure, exactly (model/README.md, section 12)."""
    share = None if older is None else older / device.sample_time
    chain = sampled_chain(_rates(device, ops), share, ops)
    newer, late = (tuple(states[0] for states in force) for force in chain.states)
    return StepResponse(chain.open, (newer, late), chain.position)


@dataclass(frozen=True, slots=True)
class SampledChain:
    """Responses of the states and of the first state's integral to a held input, as polynomials of x = z - 1."""

    open: Vector  # coefficients of det(x - psi) without the last, which is 1
    states: tuple[list[Vector], list[Vector]]
    position: tuple[Vector, Vector]


def sampled_chain(rates: Matrix, older: Number | None, ops: Arithmetic) -> SampledChain:
    """Sample a chain of n states and the integral of the first state exactly, as polynomials of x = z - 1."""
    step, newer, older_force = stepped(rates, older, ops)
    psi = tuple(row[1:-1] for row in step[1:-1])  # without the integral and the input
    coefficients, adjugate = characteristic(psi)
    travel = step[0][1:-1]

    def numerators(force: Vector) -> tuple[list[Vector], Vector]:
        left = [applied(matrix, force[1:-1]) for matrix in adjugate]
        position = [add(dot(travel, states), times(force[0], c)) for states, c in zip(left, coefficients, strict=True)]
        return left, (*position, force[0])

    (x_0, p_0), (x_1, p_1) = numerators(newer), numerators(older_force)
    return SampledChain(coefficients, (x_0, x_1), (p_0, p_1))


def stepped(rates: Matrix, older: Number | None, ops: Arithmetic) -> tuple[Matrix, Vector, Vector]:
    """Return the change of a linear system over one sample, and its parts due to the newer and to the older force."""
    if older is None:
        step = exponential_less_one(rates, ops)
        return step, column(step, -1), tuple(0 for _ in rates)
    early, late = _halves(rates, older, ops)
    # e^late e^early - 1
    return added(added(late, early), product(late, early)), column(late, -1), _moved_on(early, late)


def left_by_older(rates: Matrix, older: Number, ops: Arithmetic) -> Vector:
    """Return the change of the states over one sample per unit of the older force."""
    return _moved_on(*_halves(rates, older, ops))


def _halves(rates: Matrix, older: Number, ops: Arithmetic) -> tuple[Matrix, Matrix]:
    """Return e^A - 1 over the part of a sample in which the older force acts, and over the rest."""
    return exponential_less_one(scaled(rates, older), ops), exponential_less_one(scaled(rates, 1 - older), ops)


def _moved_on(early: Matrix, late: Matrix) -> Vector:
    """Return the change of the states at the end of the sample per unit of the early force."""
    left = column(early, -1)
    return tuple(add(a, b) for a, b in zip(left, applied(late, left), strict=True))


def _rates(device: Device, ops: Arithmetic) -> Matrix:
    """Return the matrix of d/dt, T = 1, for position, motor velocity, bend, handle velocity, drive and command."""
    T, m = device.sample_time, device.mass
    one = 0 * T + 1  # a number of the arithmetic, so that the code encloses the quotient below
    bent = ("bend", "handle") if device.structure is not None else ()
    names = ("position", "velocity", *bent, *drive_states(device), COMMAND)
    rows: Rows = {name: {} for name in names}
    rows["position"]["velocity"] = one
    force = drive_rows(rows, device, ops, plain_low_pass_rates)
    if device.structure is None:
        rows["velocity"] = {"velocity": -(device.damping * T / m), **pushed(force, one)}
    else:
        parts = mechanism(device, device.structure, ops)
        spring, loss = parts.stiffness * (T * T), parts.viscosity * T
        rows["velocity"] = {
            "velocity": -((device.damping * T + loss) / parts.motor),
            "bend": -(spring / parts.motor),
            "handle": loss / parts.motor,
            **pushed(force, m / parts.motor),
        }
        rows["bend"] = {"velocity": one, "handle": -one}
        held = loss if parts.damping is None else loss + parts.damping * T
        rows["handle"] = {
            "velocity": loss / parts.handle,
            "bend": spring / parts.handle,
            "handle": -(held / parts.handle),
        }
    return tuple(tuple(row.get(name, 0) for name in names) for row in rows.values())
