"""The exact sampled loop of the device, let go or in a hand M s + B + K/s at the handle; not from vctune.

The plant is x' = A x + B u with u held over a sample; its states are motor position and velocity, the stretch and the
handle's velocity (flexible), the actuator and the force sensor's filter. A delay of any size shifts time: an output
late by n T + r is that of the undelayed plant at the instant (k - n - 1) T + (T - r), just before the next command.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import Any

import numpy as np
from arithmetic import DIGITS, Arithmetic
from device_oracle import Coupling, Gains, LowPass, Real, smoothing, spring


@dataclass(frozen=True)
class Hand:
    """A hand at the handle: M in kg, B in N s/m, K in N/m."""

    mass: float = 0.0
    damping: float = 0.0
    stiffness: float = 0.0


LET_GO = Hand()


@dataclass(frozen=True)
class Plant:
    """x' = A x + B u; motor position m and velocity m/s are states 0 and 1; sensed force N = force x + feed u."""

    A: np.ndarray
    B: np.ndarray
    force: np.ndarray
    feed: Any


def filtered(filter_: LowPass, source: np.ndarray, states: list[np.ndarray], num: Arithmetic) -> list[np.ndarray]:
    """Return the rates of a low-pass's states: y' = w (x - y), or y'' = w^2 (x - y) - sqrt(2) w y'."""
    if not states:
        return []
    w = 2 * num.pi * num.number(filter_.bandwidth_hz)
    if len(states) == 1:
        return [w * (source - states[0])]
    return [states[1], w**2 * (source - states[0]) - num.sqrt(num.number(2)) * w * states[1]]


def order(filter_: LowPass) -> int:
    """Return how many states a low-pass has."""
    return 0 if filter_.bandwidth_hz is None else filter_.order


@lru_cache(maxsize=256)
def plant(real: Real, hand: Hand, num: Arithmetic = DIGITS, sensor: bool = True) -> Plant:
    """Return the continuous plant; without the sensor's filter when only motions matter.

    Every signal is a row over (states..., u). The hand's force on the handle is f_h = -(M a + B v + K x).
    """
    body = 2 if real.structure is None else 4
    pushers, sensors = order(real.actuator), order(real.force_sensor) if sensor else 0
    size = body + pushers + sensors
    signal = list(num.array([[num.number(int(i == j)) for j in range(size + 1)] for i in range(size + 1)]))
    command, acting = signal[-1], signal[body : body + pushers]
    sensing = signal[body + pushers : size]
    push = acting[0] if acting else command
    b, M, B, K = (num.number(x) for x in (real.damping, hand.mass, hand.damping, hand.stiffness))
    x, v = signal[0], signal[1]
    if real.structure is None:
        x_h, v_h = x, v
        a_h = (push - (b + B) * v - K * x) / (num.number(real.mass) + M)
        rates = [v, a_h]
    else:
        stretch, v_h = signal[2], signal[3]
        x_h = x + stretch
        m2 = num.number(real.structure.handle_mass)
        k, c = spring(real, num)
        pull = k * stretch + c * (v_h - v)
        a_h = (-pull - B * v_h - K * x_h) / (m2 + M)
        rates = [v, (push + pull - b * v) / (num.number(real.mass) - m2), v_h - v, a_h]
    f_h = -(M * a_h + B * v_h + K * x_h)
    rates += filtered(real.actuator, command, acting, num) + filtered(real.force_sensor, f_h, sensing, num)
    sensed = sensing[0] if sensing else f_h
    matrix = num.array([list(rate) for rate in rates])
    return Plant(matrix[:, :size], matrix[:, size], sensed[:size], sensed[size])


@lru_cache(maxsize=1024)
def held(real: Real, hand: Hand, time: Fraction, num: Arithmetic, sensor: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return e^{A t} and its integral times B, for a command held during t seconds."""
    body = plant(real, hand, num, sensor)
    size = len(body.B)
    zero = num.number(0)
    block = num.array([[zero] * (size + 1) for _ in range(size + 1)])
    block[:size, :size] = body.A * num.number(time)
    block[:size, size] = body.B * num.number(time)
    power = num.expm(block)
    return power[:size, :size], power[:size, size]


@lru_cache(maxsize=256)
def split(delay: Fraction, sample_time: Fraction) -> tuple[int, Fraction]:
    """Return whole samples and the rest (s) of a delay, exactly (in decimals)."""
    whole = math.floor(delay / sample_time)
    return whole, delay - whole * sample_time


@lru_cache(maxsize=256)
def exact(decimal: float) -> Fraction:
    """Return a number as the decimal it is printed as."""
    return Fraction(str(decimal))


@dataclass(frozen=True)
class Output:
    """What is sampled, C x + D u, `delay` seconds late in all."""

    C: np.ndarray
    D: Any
    delay: Fraction


def pulse(real: Real, hand: Hand, output: Output, z: Any, num: Arithmetic) -> Any:
    """Return the pulse transfer function from the command to a late output.

    z^{-n-1} [C (e^{A h} (z - e^{A T})^{-1} Gamma(T) + Gamma(h)) + D], delay = n T + r, h = T - r.
    """
    T = exact(real.sample_time)
    whole, rest = split(output.delay, T)
    Phi, Gamma = held(real, hand, T, num, True)
    Phi_h, Gamma_h = held(real, hand, T - rest, num, True)
    one = num.array([[num.number(int(i == j)) for j in range(len(Gamma))] for i in range(len(Gamma))])
    state = num.solve(z * one - Phi, Gamma)
    return (output.C @ (Phi_h @ state + Gamma_h) + output.D) / z ** (whole + 1)


def circle(real: Real, frequency_hz: float, num: Arithmetic = DIGITS) -> Any:
    """Return z = e^{jwT}."""
    return num.exp(num.i * 2 * num.pi * num.number(frequency_hz) * num.number(real.sample_time))


def pulses(real: Real, hand: Hand, z: Any, num: Arithmetic = DIGITS) -> tuple[Any, Any, Any]:
    """Return the exact pulse transfer functions from the held command u.

    Parameters
    ----------
    real, hand
        The device and the hand that holds it (kg, N s/m, N/m).
    z
        Any complex number that is no pole; on the unit circle `circle(real, frequency_hz)`.
    num
        DIGITS or DOUBLES.

    Returns
    -------
    G_x, G_v, G_f
        To motor position (m/N), velocity estimate (m/(N s)) and sensed force (N/N).
    """
    body = plant(real, hand, num)
    unit = num.array([[num.number(int(i == j)) for j in range(len(body.B))] for i in range(2)])
    late = exact(real.delay)
    G_x = pulse(real, hand, Output(unit[0], 0, late), z, num)
    if real.velocity.source == "measured":
        G_v = pulse(real, hand, Output(unit[1], 0, late), z, num)
    else:
        G_v = (1 - 1 / z) / num.number(real.sample_time) * G_x
    felt = Output(body.force, body.feed, late + exact(real.force_sensor.delay))
    G_f = pulse(real, hand, felt, z, num)
    return G_x, smoothing(real, z, num) * G_v, G_f


def sensitivity(real: Real, gains: Gains, frequency_hz: float, num: Arithmetic = DIGITS, hand: Hand = LET_GO) -> Any:
    """Return S = 1/(1 + K_v G_v + K_p G_x) at z = e^{jwT} (dimensionless), of the device let go unless told."""
    G_x, G_v, _ = pulses(real, hand, circle(real, frequency_hz, num), num)
    return 1 / (1 + num.number(gains.velocity) * G_v + num.number(gains.position) * G_x)


def seen_at(real: Real, gains: Gains, hand: Hand, z: Any, num: Arithmetic = DIGITS) -> Any:
    """Return Z_seen = X / Delta in N s/m at any z, X = -G_f (K_v + K_p (T/2)(z+1)/(z-1))."""
    G_x, G_v, G_f = pulses(real, hand, z, num)
    K_v, K_p, T = (num.number(x) for x in (gains.velocity, gains.position, real.sample_time))
    return -G_f * (K_v + K_p * T / 2 * (z + 1) / (z - 1)) / (1 + K_v * G_v + K_p * G_x)


def coupling_at(real: Real, coupling: Coupling, z: Any, num: Arithmetic = DIGITS) -> Any:
    """Return Z_c as the firmware runs it, in N s/m at z: 1.3 with s = (2/T)(z-1)/(z+1)."""
    T = num.number(real.sample_time)
    b_c, m_c = num.number(coupling.damping), num.number(coupling.mass)
    rise = 2 * m_c * (z - 1)
    return num.number(coupling.drag) + b_c * rise / (b_c * T * (z + 1) + rise)


def matrix_of(step: Callable[[np.ndarray], np.ndarray], size: int, num: Arithmetic) -> np.ndarray:
    """Return the matrix of a linear step, by its columns."""
    one = num.array([[num.number(int(i == j)) for j in range(size)] for i in range(size)])
    return num.array([list(step(one[i])) for i in range(size)]).T
