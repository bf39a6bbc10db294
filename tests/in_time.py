"""The whole loop in exact time: device, hand, coupling and environment as the firmware runs them; not from vctune.

Command u = K_v (v_e - v_hat) + K_p (x_e - x) with x_e the trapezoidal integral of v_e; the sensed force drives
coupling and environment, f_s = (Z_c + Z_e) v_e, and is sampled just before the new command acts. The matrix of one
sample of all this is what nature does: no frequency response, no passivity theorem.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from arithmetic import DOUBLES, Arithmetic
from device_oracle import Coupling, Gains, Real
from firmware import Device
from sampled_device_oracle import Hand, circle, coupling_at, matrix_of, seen_at


@dataclass(frozen=True)
class Environment:
    """A discrete-passive environment: mass kg (trapezoid), damping N s/m, stiffness N/m (by `spring_rule`)."""

    mass: float = 0.0
    damping: float = 0.0
    stiffness: float = 0.0
    spring_rule: str = "trapezoid"  # or "backward"


def environment_at(real: Real, environment: Environment, z: Any, num: Arithmetic = DOUBLES) -> Any:
    """Return Z_e(z) in N s/m: M (2/T)(z-1)/(z+1) + B + K (T/2)(z+1)/(z-1), or K T z/(z-1) by backward Euler."""
    T = num.number(real.sample_time)
    lag = T / 2 * (z + 1) / (z - 1) if environment.spring_rule == "trapezoid" else T * z / (z - 1)
    inert = num.number(environment.mass) * 2 / T * (z - 1) / (z + 1) if environment.mass else 0
    return inert + num.number(environment.damping) + num.number(environment.stiffness) * lag


@dataclass(frozen=True)
class Loop:
    """Everything that runs together; its memory is the device's and then (x_p m, p_c m/s, p_e m/s or nothing).

    x_e = x_p + (T/2) v_e is the commanded position; the coupling's mass has v_m = p_c + T/(2 m_c) f, its damper
    f = b_c (v_e - v_m); the environment's mass has v_e = p_e + T/(2 M) f. (All three are the trapezoidal rule.)
    """

    real: Real
    gains: Gains
    coupling: Coupling
    hand: Hand
    environment: Environment
    num: Arithmetic = DOUBLES

    @property
    def device(self) -> Device:
        """The sampled device in the hand, its force sensor included."""
        return Device(self.real, self.hand, self.num)

    def step(self, memory: np.ndarray) -> np.ndarray:
        """Return the memory one sample later."""
        number = self.num.number
        device, size = self.device, self.device.size
        T = number(self.real.sample_time)
        K_v, K_p = number(self.gains.velocity), number(self.gains.position)
        b_c, m_c, b_0 = number(self.coupling.damping), number(self.coupling.mass), number(self.coupling.drag)
        M, B, K = (number(x) for x in (self.environment.mass, self.environment.damping, self.environment.stiffness))
        body, x_p, p_c = memory[:size], memory[size], memory[size + 1]
        p_e = memory[size + 2] if self.environment.mass else 0
        reach = T / 2 if self.environment.spring_rule == "trapezoid" else T
        soft = b_c / (1 + b_c * T / (2 * m_c))
        hard = 2 * M / T
        at_once = b_0 + soft + B + K * reach + hard
        v_e = (device.force(body) + soft * p_c - K * x_p + hard * p_e) / at_once
        x_e = x_p + T / 2 * v_e
        command = K_v * (v_e - device.velocity(body)) + K_p * (x_e - device.position(body))
        ahead = [x_p + T * v_e, p_c + T / m_c * soft * (v_e - p_c)]
        if self.environment.mass:
            ahead.append(2 * v_e - p_e)
        return np.array([*device.wait(body, command), *ahead], dtype=memory.dtype)

    def matrix(self) -> np.ndarray:
        """Return the matrix of a sample, without what is free to be anywhere.

        x is the memory's first number and x_p the device.size-th. Where neither hand nor environment has a spring only
        x_p - x counts (K_p > 0); a position that nothing depends on is left out.
        """
        at = self.device.size
        whole = matrix_of(self.step, at + (3 if self.environment.mass else 2), self.num)
        tied = self.gains.position != 0
        held_x, held_e = self.hand.stiffness != 0, self.environment.stiffness != 0
        if tied and not held_x and not held_e:
            whole[at, :] = whole[at, :] - whole[0, :]
        drop = [0] if not held_x and not (tied and held_e) else []
        drop += [at] if not held_e and not tied else []
        keep = [i for i in range(len(whole)) if i not in drop]
        return whole[np.ix_(keep, keep)]

    def spectral_radius(self) -> Any:
        """Return the largest |eigenvalue| of a sample: above 1 grows, below 1 dies out."""
        return max(abs(value) for value in self.num.eigenvalues(self.matrix()))

    def unbalance(self, z: Any) -> Any:
        """Return Z_c + Z_e + Z_seen (N s/m) at z: zero at every eigenvalue that force and motion take part in."""
        seen = seen_at(self.real, self.gains, self.hand, z, self.num)
        virtual = environment_at(self.real, self.environment, z, self.num)
        return coupling_at(self.real, self.coupling, z, self.num) + virtual + seen


def passivity(
    real: Real, gains: Gains, coupling: Coupling, hand: Hand, frequency_hz: float, *, num: Arithmetic = DOUBLES
) -> Any:
    """Return Z_c + Z_seen at e^{jwT}.

    Parameters
    ----------
    real, gains, coupling, hand
        As in Loop.
    frequency_hz
        Frequency in Hz, above 0 and below Nyquist.
    num
        DOUBLES or DIGITS.

    Returns
    -------
    complex number
        In N s/m; its real part must be positive up to Nyquist.
    """
    z = circle(real, frequency_hz, num)
    return coupling_at(real, coupling, z, num) + seen_at(real, gains, hand, z, num)


def cancelling(real: Real, reactance: float, frequency_hz: float, damping: float = 0.0) -> Environment:
    """Return the spring or mass (trapezoid) whose reactance at a frequency is minus the one given (N s/m).

    On the unit circle a spring is -j K (T/2) / tan(wT/2), a mass j (2 M/T) tan(wT/2).
    """
    bend = 2 / real.sample_time * math.tan(math.pi * frequency_hz * real.sample_time)
    if reactance > 0:
        return Environment(damping=damping, stiffness=reactance * bend)
    return Environment(damping=damping, mass=-reactance / bend)


def random_hand(rng: np.random.Generator) -> Hand:
    """Return a hand within about 0.5 kg, 30 N s/m and 3000 N/m, each part at times absent (damping never)."""
    mass, stiffness = rng.uniform(0, 0.5), rng.uniform(0, 3000)
    return Hand(mass * rng.integers(2), 10 ** rng.uniform(-0.5, 1.5), stiffness * rng.integers(2))


def random_environment(rng: np.random.Generator) -> Environment:
    """Return a discrete-passive environment over many decades, each part at times absent."""
    mass, damping, stiffness = 10 ** rng.uniform([-3, -3, 0], [2, 3, 7]) * rng.integers(2, size=3)
    return Environment(float(mass), float(damping), float(stiffness), str(rng.choice(["trapezoid", "backward"])))
