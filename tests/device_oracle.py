"""The device with its parts in the continuous frequency model, by the definitions and not from vctune.

Laws, with s = jw:
    u = A H [K_v (v_e - F v_m) + (K_p/s)(v_e - v_m)],   f_s = F_s f_h,
    v_h = P_hh f_h + P_hu u,   v_m = P_mh f_h + P_mu u.
The demand on the coupling is Re Z_c >= R with R = (|q| - Re q) / (2 Re G_hh), q = F_s G_he.
With DIGITS (50 digits, the default) every formula is used as it stands; with DOUBLES |q| - Re q cancels near q = 1.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from arithmetic import DIGITS, Arithmetic


@dataclass(frozen=True)
class LowPass:
    """A low-pass: 1/(1 + s/w) for order 1, w^2/(s^2 + sqrt(2) w s + w^2) for order 2; none without bandwidth_hz."""

    bandwidth_hz: float | None = None
    order: int = 1
    delay: float = 0.0  # s, used by the force sensor only


@dataclass(frozen=True)
class Velocity:
    """The velocity estimate: "measured" or "difference" of the sampled position, then a one-pole, once or twice."""

    source: str = "measured"
    filter_hz: float | None = None
    filter_order: int = 1


@dataclass(frozen=True)
class Structure:
    """A handle (kg) on a spring: the resonance (Hz) of the free-free pair and its damping ratio."""

    handle_mass: float
    frequency_hz: float
    damping_ratio: float = 0.0


@dataclass(frozen=True)
class Real:
    """A device: mass kg, damping N s/m, times s; what is absent costs nothing. The operator is the least hand Z_h."""

    mass: float
    damping: float
    sample_time: float
    hold: str = "zoh"
    delay: float = 0.0
    velocity: Velocity = Velocity()
    actuator: LowPass = LowPass()
    force_sensor: LowPass = LowPass()
    structure: Structure | None = None
    operator_mass: float = 0.0
    operator_damping: float = 0.0
    operator_stiffness: float = 0.0


@dataclass(frozen=True)
class Gains:
    """The velocity loop: K_v in N s/m, K_p in N/m."""

    velocity: float
    position: float


@dataclass(frozen=True)
class Coupling:
    """The virtual coupling: b_c in N s/m, m_c in kg, b_0 in N s/m."""

    damping: float
    mass: float
    drag: float = 0.0


def least(value: Any) -> float:
    """Return the least value of a plain number or of a table with min and max."""
    return float(value["min"] if isinstance(value, dict) else value)


def read_device(path: Path) -> Real:
    """Read the device and its least operator from a problem file (units as there)."""
    problem = tomllib.loads(path.read_text(encoding="utf-8"))
    device = problem["device"]
    velocity = dict(device.get("velocity", {}))
    operator = {f"operator_{key}": least(value) for key, value in problem.get("operator", {}).items()}
    return Real(
        mass=device["mass"],
        damping=device["damping"],
        sample_time=device["sample_time"],
        hold=device.get("hold", "zoh"),
        delay=device.get("delay", 0.0),
        velocity=Velocity(source=velocity.pop("from", "measured"), **velocity),
        actuator=LowPass(**device.get("actuator", {})),
        force_sensor=LowPass(**device.get("force_sensor", {})),
        structure=Structure(**device["structure"]) if "structure" in device else None,
        **operator,
    )


def laplace(frequency_hz: float, num: Arithmetic = DIGITS) -> Any:
    """Return s = j 2 pi f in rad/s."""
    return num.i * 2 * num.pi * num.number(frequency_hz)


def low_pass(filter_: LowPass, s: Any, num: Arithmetic = DIGITS) -> Any:
    """Return the response of a low-pass at s, its delay included (dimensionless)."""
    late = num.exp(-s * num.number(filter_.delay))
    if filter_.bandwidth_hz is None:
        return late
    w = 2 * num.pi * num.number(filter_.bandwidth_hz)
    if filter_.order == 1:
        return late / (1 + s / w)
    return late * w**2 / (s**2 + num.sqrt(num.number(2)) * w * s + w**2)


def hold(real: Real, s: Any, num: Arithmetic = DIGITS) -> Any:
    """Return H(s) = hold(s) e^{-s delay}: (1 - e^{-sT})/(sT) for "zoh", 2/(2 + sT) for "lag"."""
    T = num.number(real.sample_time)
    shape = (1 - num.exp(-s * T)) / (s * T) if real.hold == "zoh" else 2 / (2 + s * T)
    return shape * num.exp(-s * num.number(real.delay))


def smoothing(real: Real, z: Any, num: Arithmetic = DIGITS) -> Any:
    """Return the firmware's one-pole y += a (x - y), a = 1 - e^{-2 pi f T}, at z: (a / (1 - (1-a)/z))^order."""
    if real.velocity.filter_hz is None:
        return num.number(1)
    pole = num.exp(-2 * num.pi * num.number(real.velocity.filter_hz) * num.number(real.sample_time))
    return ((1 - pole) / (1 - pole / z)) ** real.velocity.filter_order


def velocity_estimate(real: Real, s: Any, num: Arithmetic = DIGITS) -> Any:
    """Return F: estimated over true motor velocity; the difference is (1 - e^{-sT})/(sT) of it."""
    sT = s * num.number(real.sample_time)
    difference = (1 - num.exp(-sT)) / sT if real.velocity.source == "difference" else num.number(1)
    return difference * smoothing(real, num.exp(sT), num)


def mechanism(real: Real, s: Any, num: Arithmetic = DIGITS) -> tuple[Any, Any, Any, Any]:
    """Return the admittances P_hh, P_hu, P_mh, P_mu in m/(N s) from (f_h, u) to (v_h, v_m)."""
    mass, damping = num.number(real.mass), num.number(real.damping)
    if real.structure is None:
        rigid = 1 / (mass * s + damping)
        return rigid, rigid, rigid, rigid
    m2 = num.number(real.structure.handle_mass)
    m1 = mass - m2
    k, c = spring(real, num)
    Z_1, Z_2, Z_s = m1 * s + damping, m2 * s, c + k / s
    E = Z_1 * Z_2 + Z_s * (Z_1 + Z_2)
    return (Z_1 + Z_s) / E, Z_s / E, Z_s / E, (Z_2 + Z_s) / E


def spring(real: Real, num: Arithmetic = DIGITS) -> tuple[Any, Any]:
    """Return stiffness k = mu w^2 (N/m) and damping c = 2 zeta mu w (N s/m) of the handle, mu = m1 m2 / mass."""
    m2 = num.number(real.structure.handle_mass)
    mu = (num.number(real.mass) - m2) * m2 / num.number(real.mass)
    w = 2 * num.pi * num.number(real.structure.frequency_hz)
    return mu * w**2, 2 * num.number(real.structure.damping_ratio) * mu * w


def coupling_impedance(coupling: Coupling, s: Any, num: Arithmetic = DIGITS) -> Any:
    """Return Z_c = b_0 + b_c m_c s / (b_c + m_c s) in N s/m."""
    b_c, m_c = num.number(coupling.damping), num.number(coupling.mass)
    return num.number(coupling.drag) + b_c * m_c * s / (b_c + m_c * s)


def operator_impedance(real: Real, s: Any, num: Arithmetic = DIGITS) -> Any:
    """Return Z_h = M s + B + K/s of the least operator in N s/m."""
    M, B, K = (num.number(x) for x in (real.operator_mass, real.operator_damping, real.operator_stiffness))
    return M * s + B + K / s


@dataclass(frozen=True)
class Response:
    """What the device with its gains is at one frequency; impedances N s/m, admittances m/(N s), R N s/m."""

    C_0: Any  # from v_e to u
    C_f: Any  # from v_m to -u
    Delta: Any  # 1 + P_mu C_f
    G_hh: Any  # handle admittance, without the operator
    G_he: Any  # from v_e to v_h, without the operator
    q: Any  # F_s G_he, or F_s G_he / A_h^2 with an operator
    tracking: Any  # 1 - G_he
    required: Any  # R: the least Re Z_c


def response(real: Real, gains: Gains, frequency_hz: float, num: Arithmetic = DIGITS) -> Response:
    """Return everything at one frequency in Hz, above 0; a decimal string is taken to all its digits."""
    return response_at(real, gains, laplace(frequency_hz, num), num)


def response_at(real: Real, gains: Gains, s: Any, num: Arithmetic = DIGITS) -> Response:
    """Return everything at one s.

    C_0 = A H (K_v + K_p/s), C_f = A H (K_v F + K_p/s), Delta = 1 + P_mu C_f,
    G_hh = (P_hh + C_f (P_hh P_mu - P_hu P_mh)) / Delta, G_he = P_hu C_0 / Delta, q = F_s G_he,
    and with an operator A_h = 1 + Z_h G_hh: G_hh/A_h, q/A_h^2, less Re(F_s Z_h G_he / A_h) in R.

    Parameters
    ----------
    real, gains
        The device (with its least operator) and K_v in N s/m, K_p in N/m.
    s
        j omega, or any complex number that is no pole, in rad/s.
    num
        DIGITS or DOUBLES (the latter takes arrays of s too).

    Returns
    -------
    Response
        Impedances in N s/m, admittances in m/(N s).
    """
    K_v, K_p = num.number(gains.velocity), num.number(gains.position)
    push = low_pass(real.actuator, s, num) * hold(real, s, num)
    C_0 = push * (K_v + K_p / s)
    C_f = push * (K_v * velocity_estimate(real, s, num) + K_p / s)
    P_hh, P_hu, P_mh, P_mu = mechanism(real, s, num)
    Delta = 1 + P_mu * C_f
    G_hh = (P_hh + C_f * (P_hh * P_mu - P_hu * P_mh)) / Delta
    G_he = P_hu * C_0 / Delta
    F_s = low_pass(real.force_sensor, s, num)
    Z_h = operator_impedance(real, s, num)
    A_h = 1 + Z_h * G_hh
    q = F_s * G_he / A_h**2
    required = (abs(q) - q.real) / (2 * (G_hh / A_h).real) - (F_s * Z_h * G_he / A_h).real
    return Response(C_0, C_f, Delta, G_hh, G_he, q, 1 - G_he, required)


def ratio(real: Real, gains: Gains, coupling: Coupling, frequency_hz: float, num: Arithmetic = DIGITS) -> Any:
    """Return Re Z_c / R (dimensionless): at least 1 is absolute stability."""
    Z_c = coupling_impedance(coupling, laplace(frequency_hz, num), num)
    return Z_c.real / response(real, gains, frequency_hz, num).required
