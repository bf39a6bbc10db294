"""A device with an actuator or a structure over one sample, exactly: states, their step, and what it does to them.

Time is counted in T, impedances in m/T, so that all numbers are dimensionless and of the size of what they mean for the
sampled loop (README, section 12). Matrices are tuples of rows; a 0 that is there by structure is the integer 0, takes
no part in products, and stays exactly 0.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import count
from math import ceil, factorial, inf, log2

from vctune.model.arithmetic import Arithmetic, Number
from vctune.model.device_response import mechanism
from vctune.model.quantities import Device

Matrix = tuple[tuple[Number, ...], ...]
Vector = tuple[Number, ...]

LEFT_OUT = 2.0**-10
"""What Taylor's polynomial of e^A, A of norm at most 1/2, leaves out, as a share of rounding; it is enclosed. Half and
twice it are the same order mostly: 15 for doubles, 29 for 128 bits."""


@dataclass(frozen=True, slots=True)
class StepResponse:
    """What a sample does, over the polynomials of its step: x[k+1] - x[k] = psi x[k] + the forces' shares.

    Attributes
    ----------
    open : coefficients of det(x - psi), without the last, which is 1
    velocity, position : numerators from the newer and from the older force of the sample; T/m and T^2/m
    """

    open: Vector
    velocity: tuple[Vector, Vector]
    position: tuple[Vector, Vector]


def sampled_states(device: Device, older: Number | None, ops: Arithmetic) -> StepResponse:
    """Sample a device with an actuator or a structure.

    Parameters
    ----------
    device : its numbers in the arithmetic
    older : how long of a sample the older force acts, s; None if it does not
    ops : arithmetic of both
    """
    rates = _rates(device, ops)
    if older is None:
        step = exponential_less_one(rates, ops)
        newer, older_force = _column(step, -1), tuple(0 for _ in rates)
    else:
        share = older / device.sample_time
        early = exponential_less_one(_times(rates, share), ops)
        late = exponential_less_one(_times(rates, 1 - share), ops)
        # e^late e^early - 1, and what the early force leaves behind moves on with the late part
        step, left = _sum(_sum(late, early), _product(late, early)), _column(early, -1)
        newer = _column(late, -1)
        older_force = tuple(_add(a, b) for a, b in zip(left, _applied(late, left), strict=True))
    psi = tuple(row[1:-1] for row in step[1:-1])
    coefficients, adjugate = characteristic(psi)
    travel = step[0][1:-1]

    def numerators(force: Vector) -> tuple[Vector, Vector]:
        left = [_applied(matrix, force[1:-1]) for matrix in adjugate]
        velocity = tuple(states[0] for states in left)
        position = [_add(_dot(travel, states), _mul(force[0], c)) for states, c in zip(left, coefficients, strict=True)]
        return velocity, (*position, force[0])

    (v_0, x_0), (v_1, x_1) = numerators(newer), numerators(older_force)
    return StepResponse(coefficients, (v_0, v_1), (x_0, x_1))


def _rates(device: Device, ops: Arithmetic) -> Matrix:
    """Return d/dt of (position, motor's velocity, bend, handle's velocity, force, its rate, command), dimensionless."""
    T, m = device.sample_time, device.mass
    one = 0 * T + 1  # in the arithmetic, so that what it is divided by is enclosed
    names = ["position", "velocity"]
    names += ["bend", "handle"] if device.structure is not None else []
    names += ["force", "rate"][: device.actuator.order] if device.actuator is not None else []
    names += ["command"]
    at = {name: index for index, name in enumerate(names)}
    rows: list[list[Number]] = [[0] * len(names) for _ in names]
    rows[at["position"]][at["velocity"]] = one
    pushed = "command" if device.actuator is None else "force"
    if device.structure is None:
        rows[at["velocity"]][at["velocity"]] = -(device.damping * T / m)
        rows[at["velocity"]][at[pushed]] = one
    else:
        parts = mechanism(device, device.structure, ops)
        spring, loss = parts.stiffness * (T * T), parts.viscosity * T
        motor, handle = rows[at["velocity"]], rows[at["handle"]]
        motor[at["velocity"]] = -((device.damping * T + loss) / parts.motor)
        motor[at["bend"]], motor[at["handle"]] = -(spring / parts.motor), loss / parts.motor
        motor[at[pushed]] = m / parts.motor
        rows[at["bend"]][at["velocity"]], rows[at["bend"]][at["handle"]] = one, -one
        handle[at["velocity"]], handle[at["bend"]] = loss / parts.handle, spring / parts.handle
        held = loss if parts.damping is None else loss + parts.damping * T
        handle[at["handle"]] = -(held / parts.handle)
    if device.actuator is not None:
        corner = 2 * ops.pi * device.actuator.bandwidth_hz * T
        if device.actuator.order == 1:
            rows[at["force"]][at["force"]], rows[at["force"]][at["command"]] = -corner, corner
        else:
            rows[at["force"]][at["rate"]] = corner
            rows[at["rate"]][at["force"]], rows[at["rate"]][at["command"]] = -corner, corner
            rows[at["rate"]][at["rate"]] = -ops.sqrt(2 * (corner * corner))
    return tuple(map(tuple, rows))


def exponential_less_one(matrix: Matrix, ops: Arithmetic) -> Matrix:
    """Return e^A - 1 by scaling, Taylor's polynomial, what it leaves out enclosed, and squaring.

    Parameters
    ----------
    matrix : A
    ops : arithmetic of its entries
    """
    norm = max(sum(ops.magnitude(entry) for entry in row if not _nothing(entry)) for row in matrix)
    halvings = max(0, ceil(log2(norm)) + 1) if 0 < norm < inf else 0
    scaled = _times(matrix, 2.0**-halvings)
    total = term = scaled
    x = norm / 2.0**halvings
    last = next(n for n in count(2) if not x ** (n + 1) / factorial(n + 1) > LEFT_OUT * ops.precision * x)
    for order in range(2, last + 1):
        term = _shared(_product(term, scaled), order)
        total = _sum(total, term)
    rest = ops.within(1.1 * x ** (last + 1) / factorial(last + 1))
    found = tuple(tuple(entry if _nothing(entry) else entry + rest for entry in row) for row in total)
    for _ in range(halvings):
        found = _sum(_times(found, 2), _product(found, found))
    return found


def characteristic(psi: Matrix) -> tuple[Vector, list[Matrix]]:
    """Return det(x - psi) and the adjugate of x - psi, by Faddeev and LeVerrier.

    Parameters
    ----------
    psi : n x n

    Returns
    -------
    coefficients : of x^0 to x^(n-1); that of x^n is 1
    adjugate : matrices that are its coefficients, of x^0 to x^(n-1)
    """
    n = len(psi)
    identity: Matrix = tuple(tuple(1 if i == j else 0 for j in range(n)) for i in range(n))
    matrix, matrices, coefficients = identity, [identity], []
    for k in range(1, n + 1):
        product = _product(psi, matrix)
        trace: Number = 0
        for i in range(n):
            trace = _add(trace, product[i][i])
        c = trace / -k
        coefficients.append(c)
        if k < n:
            matrix = tuple(
                tuple(_add(entry, c) if i == j else entry for j, entry in enumerate(row))
                for i, row in enumerate(product)
            )
            matrices.append(matrix)
    return tuple(reversed(coefficients)), matrices[::-1]


def _nothing(x: Number) -> bool:
    return type(x) is int and x == 0


def _add(a: Number, b: Number) -> Number:
    return b if _nothing(a) else a if _nothing(b) else a + b


def _mul(a: Number, b: Number) -> Number:
    return 0 if _nothing(a) or _nothing(b) else a * b


def _dot(a: Iterable[Number], b: Iterable[Number]) -> Number:
    total: Number = 0
    for x, y in zip(a, b, strict=True):
        total = _add(total, _mul(x, y))
    return total


def _applied(matrix: Matrix, vector: Vector) -> Vector:
    return tuple(_dot(row, vector) for row in matrix)


def _product(a: Matrix, b: Matrix) -> Matrix:
    columns = tuple(zip(*b, strict=True))
    return tuple(tuple(_dot(row, column) for column in columns) for row in a)


def _sum(a: Matrix, b: Matrix) -> Matrix:
    return tuple(tuple(_add(x, y) for x, y in zip(one, two, strict=True)) for one, two in zip(a, b, strict=True))


def _times(matrix: Matrix, factor: Number) -> Matrix:
    return tuple(tuple(_mul(entry, factor) for entry in row) for row in matrix)


def _shared(matrix: Matrix, count: int) -> Matrix:
    return tuple(tuple(entry if _nothing(entry) else entry / count for entry in row) for row in matrix)


def _column(matrix: Matrix, index: int) -> Vector:
    return tuple(row[index] for row in matrix)
