"""The device in continuous time, as Llewellyn's theorem needs it: from a problem's tables, by the definitions.

    u = A H [K_v (v_e - F v_m) + (K_p/s)(v_e - v_m)],   f_s = F_s f_h,
    v_h = P_hh f_h + P_hu u,   v_m = P_mh f_h + P_mu u.
With 50 digits every formula is used as it stands. Nothing of vctune is imported.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import inf
from typing import Any, NamedTuple

import numpy as np
from arithmetic import DIGITS, DOUBLES, Arithmetic

Tables = Mapping[str, Any]
STRUCTURES = ("structure", "structure_2", "structure_3")
"""The tables of springs, from the motor to the handle."""


class Demanded(NamedTuple):
    """R in N s/m, the resistance Re G_hh/A_h that must be positive, D whose turns count poles, and what they are of."""

    required: Any
    resistance: Any
    D: Any
    G_hh: Any  # m/(N s), without the operator
    G_he: Any
    q: Any

    @property
    def tracking(self) -> Any:
        """1 - G_he."""
        return 1 - self.G_he


def firmware(table: Tables, sample_time: Any, z: Any, num: Arithmetic = DOUBLES) -> Any:
    """Return the response of the firmware's filter in one of the device's tables: low-passes, then sections."""
    found, w = num.number(1), 1 / z
    a = num.number(table.get("filter_coefficient", 1))
    if "filter_hz" in table:
        a = 1 - num.exp(-2 * num.pi * num.number(table["filter_hz"]) * sample_time)
    found = found * (a / (1 - (1 - a) * w)) ** table.get("filter_order", 1)
    for row in table.get("sections", ()):
        b_0, b_1, b_2, a_0, a_1, a_2 = (num.number(each) for each in row)
        found = found * (b_0 + b_1 * w + b_2 * w**2) / (a_0 + a_1 * w + a_2 * w**2)
    return found


def low_pass(table: Tables, s: Any, num: Arithmetic) -> Any:
    """Return the response of a low-pass with a delay."""
    late = num.exp(-s * num.number(table.get("delay", 0.0)))
    if "bandwidth_hz" not in table:
        return late
    w = 2 * num.pi * num.number(table["bandwidth_hz"])
    if table.get("order", 1) == 1:
        return late / (1 + s / w)
    return late * w**2 / (s**2 + num.sqrt(num.number(2)) * w * s + w**2)


def hold(device: Tables, s: Any, num: Arithmetic) -> Any:
    """Return hold(s) e^{-s delay}."""
    T = num.number(device["sample_time"])
    shape = 2 / (2 + s * T) if device.get("hold") == "lag" else (1 - num.exp(-s * T)) / (s * T)
    return shape * num.exp(-s * num.number(device.get("delay", 0.0)))


def estimate(device: Tables, s: Any, num: Arithmetic) -> Any:
    """Return the estimated over the true velocity of the motor."""
    table, T = device.get("velocity", {}), num.number(device["sample_time"])
    found = (1 - num.exp(-s * T)) / (s * T) if table.get("from") == "difference" else num.number(1)
    return found * firmware(table, T, num.exp(s * T), num)


def mechanism(device: Tables, s: Any, num: Arithmetic) -> tuple[Any, Any, Any, Any]:
    """Return P_hh, P_hu, P_mh, P_mu in m/(N s)."""
    m, b = num.number(device["mass"]), num.number(device["damping"])
    if "structure" not in device:
        rigid = 1 / (m * s + b)
        return rigid, rigid, rigid, rigid
    tables = [device[table] for table in STRUCTURES if table in device]
    masses = [num.number(table["handle_mass"]) for table in tables]
    masses.insert(0, m - sum(masses))
    inertia, springs = [mass * s for mass in masses], []
    inertia[0] = inertia[0] + b
    for n, table in enumerate(tables):
        mu = sum(masses[: n + 1]) * sum(masses[n + 1 :]) / m
        w = 2 * num.pi * num.number(table.get("frequency_hz", 0.0))
        k = num.number(table["stiffness"]) if "stiffness" in table else mu * w**2
        springs.append(2 * num.number(table["damping_ratio"]) * num.sqrt(k * mu) + k / s)
    behind, passed = inertia[-1], num.number(1)  # impedance of what is behind a mass, and the share that moves
    for n in reversed(range(len(springs))):
        passed = passed * springs[n] / (springs[n] + behind)
        behind = inertia[n] + springs[n] * behind / (springs[n] + behind)
    before = inertia[0]
    for n, spring in enumerate(springs):
        before = inertia[n + 1] + spring * before / (spring + before)
    return 1 / before, passed / behind, passed / behind, 1 / behind


def resonances(device: Tables) -> tuple[np.ndarray, np.ndarray]:
    """Return the resonances of the springs without losses, rad/s: with a free motor, and with one that stands still."""
    tables = [device[table] for table in STRUCTURES if table in device]
    masses = np.array([device["mass"] - sum(t["handle_mass"] for t in tables), *(t["handle_mass"] for t in tables)])
    rate = np.zeros((masses.size, masses.size))  # accelerations by places
    for n, table in enumerate(tables):
        mu = masses[: n + 1].sum() * masses[n + 1 :].sum() / masses.sum()
        k = table["stiffness"] if "stiffness" in table else mu * (2 * np.pi * table["frequency_hz"]) ** 2
        rate[n, [n, n + 1]] += np.array([k, -k]) / masses[n]
        rate[n + 1, [n, n + 1]] += np.array([-k, k]) / masses[n + 1]
    free, held = (np.sort(np.abs(np.linalg.eigvals(each))) ** 0.5 for each in (rate, rate[1:, 1:]))
    return free[1:], held


def demanded(tables: Tables, gains: tuple[float, float], s: Any, num: Arithmetic = DIGITS, delta: Any = 0) -> Demanded:
    """Return what a problem's device with its gains demands of a coupling at one s.

    R = (|q| - Re q)/(2 Re G_hh/A_h) - Re F_s Z_h G_he/A_h with A_h = 1 + Z_h G_hh and q = F_s G_he/A_h^2. The mechanism
    is multiplied by 1 + delta.
    """
    device, hand = tables["device"], tables.get("operator", {})
    K_v, K_p = (num.number(x) for x in gains)
    push = low_pass(device.get("actuator", {}), s, num) * hold(device, s, num)
    C_0, C_f = push * (K_v + K_p / s), push * (K_v * estimate(device, s, num) + K_p / s)
    P_hh, P_hu, P_mh, P_mu = (P * (1 + delta) for P in mechanism(device, s, num))
    at_handle = device.get("velocity", {}).get("at") == "handle"
    P_sh, P_su = (P_hh, P_hu) if at_handle else (P_mh, P_mu)  # of what is sensed
    D = 1 + P_su * C_f
    G_hh, G_he = (P_hh + C_f * (P_hh * P_su - P_hu * P_sh)) / D, P_hu * C_0 / D
    sensor, T = device.get("force_sensor", {}), num.number(device["sample_time"])
    F_s = low_pass(sensor, s, num) * firmware(sensor, T, num.exp(s * T), num)
    Z_h = num.number(hand.get("mass", 0.0)) * s + num.number(hand.get("damping", 0.0))
    A_h = 1 + Z_h * G_hh
    q, resistance = F_s * G_he / A_h**2, (G_hh / A_h).real
    if num is DOUBLES:  # where q is nearly 1 the difference has no digits
        with np.errstate(all="ignore"):
            excess = np.where(q.real > 0, q.imag**2 / (abs(q) + abs(q.real)), abs(q) - q.real)
    else:
        excess = abs(q) - q.real
    if num is not DOUBLES and resistance == 0:
        return Demanded(inf, resistance, D, G_hh, G_he, q)
    required = excess / (2 * resistance) - (F_s * Z_h * G_he / A_h).real
    return Demanded(required, resistance, D, G_hh, G_he, q)


def offered(coupling: tuple[float, float, float], s: Any, num: Arithmetic = DIGITS) -> Any:
    """Return Z_c = b_0 + b_c m_c s/(b_c + m_c s)."""
    b_c, m_c, b_0 = (num.number(x) for x in coupling)
    return b_0 + b_c * m_c * s / (b_c + m_c * s)


def unstable_poles(tables: Tables, gains: tuple[float, float]) -> float:
    """Return how many zeros D has in the right half plane, by its turns just right of the imaginary axis."""
    T = tables["device"]["sample_time"]
    grids = [np.geomspace(1e-13, 1e5, 20_000) / T]
    grids += [resonance * np.geomspace(0.5, 2, 8000) for resonance in resonances(tables["device"])[0]]
    s = 1e-10 / T + 1j * np.unique(np.concatenate(grids))
    phase = np.unwrap(np.angle(demanded(tables, gains, s, DOUBLES).D))
    return float(-(phase[-1] - phase[0]) / np.pi)


def impedance_in_any_hand(device: Tables, K_v: float, theta: Any) -> Any:
    """Return R of an impedance display without parts: the worst of all passive hands, one at each alias.

    A rigid motor in a passive hand has an admittance in the disc around 1/(2 b) through 0. The centre is a damper of
    2 b, whose mean speed over a sample is that of the held force; the aliases' radii add up to 1/(2 b).
    """
    b, T = device["damping"], device["sample_time"]
    z = np.exp(1j * np.atleast_1d(theta))[:, None]
    whole, part = divmod(round(device.get("delay", 0.0) / T, 12), 1.0)
    smooth = firmware(device.get("velocity", {}), T, z)
    edge = (z ** -(1 + whole) * (1 - part + part / z) + np.exp(2j * np.pi * np.linspace(0, 1, 20001))) / (2 * b)
    return (-(edge / (1 + K_v * smooth * edge)).real).max(axis=1)
