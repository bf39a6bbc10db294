"""The whole loop in exact time with environments by any rule, some samples late, as one matrix of one sample.

Not from vctune: the device in the hand is that of `world_loops`; coupling and environment are stepped here.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import floor, pi

import numpy as np
from scipy.linalg import expm
from scipy.optimize import lsq_linear
from world_loops import Whole, continuous, offered, seen

Box = tuple[tuple[float, float, float], tuple[float, float, float]]


@dataclass(frozen=True)
class InTime:
    """How the environment of a loop is stepped: its rule, and by how many samples its force is late."""

    rule: str
    late: int


def stepped(loop: Whole, world: InTime) -> np.ndarray:
    """Return the matrix of one sample of everything."""
    p, T, n_late = loop.plant, loop.plant.sample_time, world.late
    A, b, C, D = continuous(loop)
    whole = floor(p.delay / T * (1 + 1e-12))
    part = max(p.delay - whole * T, 0.0)

    def over(time: float) -> tuple[np.ndarray, np.ndarray]:
        n = len(A)
        both = expm(np.block([[A, b[:, None]], [np.zeros((1, n + 1))]]) * time)
        return both[:n, :n], both[:n, n]

    (first, pushed), (rest, later) = over(part), over(T - part)
    n, queue = len(A), whole + 1
    (K_v, K_p), (b_c, m_c, b_0), (m, d, k) = loop.gains, loop.coupling, loop.world
    rigid, h = np.isinf(b_c), 2 / T
    soft = h * m_c if rigid else b_c * h * m_c / (b_c + h * m_c)
    reach = {"trapezoid": T / 2, "explicit": 0.0, "implicit": T}[world.rule]
    inertance = {"trapezoid": 2 * m / T, "explicit": m / T, "implicit": m / T}[world.rule]
    ahead = world.rule == "explicit" and n_late == 0 and m > 0
    # an explicit mass is that of implicit Euler one sample earlier
    own = n_late - 1 if world.rule == "explicit" else n_late
    size = n + queue + 1 + 6 + n_late + max(own, 0)

    def one(memory: np.ndarray) -> np.ndarray:
        state, waiting = memory[:n], memory[n : n + queue + 1]
        x_p, p_c, last, g_m, f_c, v_next = memory[n + queue + 1 :][:6]
        held = memory[n + queue + 7 :]
        contacts, inertias = held[:n_late], held[n_late:]
        force = C @ state + D * waiting[1]
        at_once, known = b_0 + soft, force + (soft * last + f_c if rigid else soft * p_c)
        if n_late:
            known = known - contacts[0]
        else:
            at_once, known = at_once + d + k * reach, known - k * x_p
        carried = g_m if world.rule == "trapezoid" and m > 0 else 0.0
        if own > 0:
            known = known - inertias[0]
        elif own == 0:
            at_once, known = at_once + inertance, known + inertance * last + carried
        v_e, v_next = (v_next if ahead else known / at_once), 0.0
        if ahead:  # what is left of the force accelerates the mass
            v_next = v_e + T / m * (known - at_once * v_e)
        contact, inertia = d * v_e + k * (x_p + reach * v_e), inertance * (v_e - last) - carried
        f_c = soft * (v_e - last) - f_c if rigid else soft * (v_e - p_c)
        p_c = 0.0 if rigid else p_c + 2 * f_c / (h * m_c)
        if p.servo:
            command = (v_e + last) / 2 if p.interpolated else v_e
        else:
            command = K_v * (v_e - state[1]) + K_p * (x_p + T / 2 * v_e - state[0])
        queued = np.append(waiting[1:], command)
        state = rest @ (first @ state + pushed * queued[0]) + later * queued[1]
        kept = np.append(contacts[1:], contact) if n_late else contacts
        moved = np.append(inertias[1:], inertia) if own > 0 else inertias
        return np.concatenate((state, queued, [x_p + T * v_e, p_c, v_e, inertia, f_c, v_next], kept, moved))

    return np.array([one(row) for row in np.eye(size)]).T


def spectral_radius(loop: Whole, world: InTime) -> float:
    """Return the greatest modulus of the loop's eigenvalues."""
    return float(np.abs(np.linalg.eigvals(stepped(loop, world))).max())


def factors(theta: float, sample_time: float, world: InTime) -> np.ndarray:
    """Return what mass, damping and stiffness are multiplied with at an angle omega T."""
    z, T = np.exp(1j * theta), sample_time
    mass, spring = {
        "trapezoid": (2 / T * (z - 1) / (z + 1), T / 2 * (z + 1) / (z - 1)),
        "explicit": ((z - 1) / T, T / (z - 1)),
        "implicit": ((1 - 1 / z) / T, T / (1 - 1 / z)),
    }[world.rule]
    return z**-world.late * np.array([mass, 1.0, spring])


def cancelling(loop: Whole, world: InTime, box: Box, theta: float, share: float) -> tuple[float, float, float] | None:
    """Return the environment of a box that cancels the rest of the loop at an angle; None if there is none."""
    at = np.array([theta])
    return balancing((share * offered(loop, at) + seen(loop, at))[0], loop.plant.sample_time, world, box, theta)


def balancing(
    Y: complex, sample_time: float, world: InTime, box: Box, theta: float
) -> tuple[float, float, float] | None:
    """Return the environment of a box whose impedance is -Y at an angle; None if there is none."""
    each, low, high = factors(theta, sample_time, world), np.array(box[0]), np.array(box[1])
    free = high > low
    rest = -Y - each @ np.where(free, 0.0, low)
    scale = np.where(free, high - low, 1.0)
    rows = np.array([each.real, each.imag]) * scale
    if free.any():
        wanted = np.array([rest.real, rest.imag]) - rows[:, free] @ (low / scale)[free]
        size = np.abs(Y) + np.abs(rows).sum()
        found = lsq_linear(rows[:, free] / size, wanted / size, (0.0, 1.0), method="bvls", tol=1e-14)
        member = low.copy()
        member[free] += found.x * scale[free]
    else:
        member = low
    missed = abs(Y + each @ member)
    return tuple(member) if missed < 1e-7 * (abs(Y) + np.abs(each) @ high) else None  # type: ignore[return-value]


def cancelling_at_nyquist(loop: Whole, world: InTime, box: Box, share: float) -> tuple[float, float, float] | None:
    """Return the environment of a box that holds a pole at -1; None if there is none."""
    beside, low, high = pi - 1e-6, np.array(box[0]), np.array(box[1])
    if np.isinf(loop.coupling[0]) and world.rule == "trapezoid":  # the poles at -1 of both masses cancel
        mass = -share * loop.coupling[1] * (-1) ** world.late
        return (mass, low[1], low[2]) if low[0] <= mass <= high[0] else None
    at = np.array([beside])
    Y = (share * offered(loop, at) + seen(loop, at))[0].real
    each = factors(beside, loop.plant.sample_time, world).real
    ends = np.sort([each * low, each * high], axis=0)
    least, most = ends.sum(axis=1)
    if not least <= -Y <= most:
        return None
    along = (-Y - least) / (most - least) if most > least else 0.0
    parts = ends[0] + along * (ends[1] - ends[0])
    return tuple(np.where(each != 0, parts / np.where(each != 0, each, 1.0), low))  # type: ignore[return-value]
