"""The sampled velocity loop: plant 1/(m s + b) sampled exactly, any real delay (model/README.md, section 7).

Between samples the plant sees u[k-N-1] for the first delta T and u[k-N] for the rest, where
delay = (N + delta) T. With z = e^{j theta} the loop's return difference is

    F(z) = (1 - a/z)(1 - 1/z) + K_v z^-1 B (1 - 1/z) + K_p z^-2 (m phi B + G (z - a)),
    B = beta_0 z^-N + beta_1 z^-(N+1),   G = gamma_0 z^-N + gamma_1 z^-(N+1),

or F = (1 - a/z) + K_v z^-1 B when K_p = 0: the position is then not in the loop. With F_0 the part without gains the
loop's sensitivity is S = F_0/F = 1/(1 + K_v G_v + K_p G_x), G_v and G_x being the pulse transfer functions from the
held force to velocity and position; they are affine in the gains with complex constants that only the device knows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import floor

import numpy as np

from vctune.model.arithmetic import Arithmetic, Number
from vctune.model.pair import Pair
from vctune.model.quantities import Device, Gains


@dataclass(frozen=True, slots=True)
class SampledPlant:
    """The step-invariant plant with input delay.

    Attributes
    ----------
    pole : a = e^{-bT/m}
    one_minus_pole : 1 - a, by its own formula, which does not cancel for small b T/m
    drift : m phi(T), how far a unit velocity coasts in one sample, s
    velocity : beta_0, beta_1: velocity after one sample per unit held force, m/(N s)
    position : gamma_0, gamma_1: position after one sample per unit held force, m/N
    whole_samples : N, of the delay
    fractional : whether delta > 0, that is, whether beta_1 and gamma_1 are there at all
    """

    pole: Number
    one_minus_pole: Number
    drift: Number
    velocity: tuple[Number, Number]
    position: tuple[Number, Number]
    whole_samples: Number
    fractional: bool

    def converted(self, number: Callable[[Number], Number]) -> SampledPlant:
        """Return the plant in numbers of another arithmetic."""
        (beta_0, beta_1), (gamma_0, gamma_1) = self.velocity, self.position
        older = (number(beta_1), number(gamma_1)) if self.fractional else (beta_1, gamma_1)
        return SampledPlant(
            pole=number(self.pole),
            one_minus_pole=number(self.one_minus_pole),
            drift=number(self.drift),
            velocity=(number(beta_0), older[0]),
            position=(number(gamma_0), older[1]),
            whole_samples=self.whole_samples,
            fractional=self.fractional,
        )


SNAP = 1e-12
"""What of a sample counts as rounding: a quotient of decimals is off by 1e-16 relative, a delay that is meant is not as
near. Half and twice it are no different."""


def split_delay(delay: Number, sample_time: Number) -> tuple[Number, Number]:
    """Split a delay into whole samples and the fraction of one that remains.

    What differs from a whole sample by rounding noise counts as one.

    Parameters
    ----------
    delay : s, >= 0, a number or an array
    sample_time : s, > 0

    Returns
    -------
    whole : N, int or an array of int
    fraction : delta, 0 <= delta < 1, of the same shape
    """
    if np.ndim(delay) > 0:
        split = [split_delay(float(one), sample_time) for one in delay]
        return np.array([whole for whole, _ in split]), np.array([fraction for _, fraction in split])
    samples = delay / sample_time
    nearest = round(samples)
    if abs(samples - nearest) <= SNAP * max(1.0, samples):
        return nearest, 0.0
    return floor(samples), samples - floor(samples)


def sampled_plant(device: Device, whole_samples: Number, ops: Arithmetic, *, fractional: bool) -> SampledPlant:
    """Sample the plant exactly.

    Parameters
    ----------
    device : Device
    whole_samples : N, of its delay
    ops : arithmetic of the device's numbers
    fractional : whether a part of a sample remains, delta > 0

    Returns
    -------
    SampledPlant
        Its numbers of the shape of the device's.
    """
    m, T = device.mass, device.sample_time
    rate, t_1 = device.damping / m, device.delay - whole_samples * T

    def velocity_step(t: Number) -> Number:
        return t / m * ops.phi_1(rate * t)

    def position_step(t: Number) -> Number:
        return t * t / m * ops.phi_2(rate * t)

    t_0 = T - t_1 if fractional else T
    beta_0, gamma_0 = velocity_step(t_0), position_step(t_0)
    beta_1 = gamma_1 = 0
    if fractional:
        v_1 = velocity_step(t_1)  # what the older force leaves coasts on for t_0
        beta_1 = v_1 * ops.exp(-(rate * t_0))
        gamma_1 = position_step(t_1) + v_1 * (t_0 * ops.phi_1(rate * t_0))
    drift = T * ops.phi_1(rate * T)
    return SampledPlant(
        pole=ops.exp(-(rate * T)),
        one_minus_pole=rate * drift,
        drift=drift,
        velocity=(beta_0, beta_1),
        position=(gamma_0, gamma_1),
        whole_samples=whole_samples,
        fractional=fractional,
    )


@dataclass(frozen=True, slots=True)
class ReturnDifference:
    """F = open + K_v velocity + K_p position at one point of the unit circle."""

    open: Pair
    velocity: Pair
    position: Pair

    def closed(self, gains: Gains) -> Pair:
        """Return F for the given gains."""
        return self.open + self.velocity.scaled(gains.velocity) + self.position.scaled(gains.position)


def return_difference(plant: SampledPlant, theta: Number, ops: Arithmetic, *, position: bool) -> ReturnDifference:
    """Evaluate the parts of F at z = e^{j theta}.

    Parameters
    ----------
    plant : SampledPlant
    theta : omega T, rad, in [0, pi]
    ops : arithmetic of both
    position : whether the position is in the loop, K_p > 0; its part is 0 otherwise, and F that of the velocity loop

    Returns
    -------
    ReturnDifference
        Each part of the shape of theta.
    """

    def delayed(steps: int) -> Pair:
        return Pair(ops.cos(theta * steps), -ops.sin(theta * steps))

    first = delayed(plant.whole_samples + 1)
    second = delayed(plant.whole_samples + 2) if plant.fractional else None

    def input_path(taps: tuple[Number, Number]) -> Pair:
        path = first.scaled(taps[0])
        return path if second is None else path + second.scaled(taps[1])

    half_sine = ops.sin(theta / 2)  # 1 - cos theta = 2 sin^2(theta/2) does not cancel
    difference = Pair(2 * half_sine * half_sine, ops.sin(theta))
    decay = Pair(plant.one_minus_pole + plant.pole * difference.re, plant.pole * difference.im)
    velocity = input_path(plant.velocity)
    if not position:
        return ReturnDifference(decay, velocity, Pair(0, 0))
    travel = (delayed(1) * velocity).scaled(plant.drift) + input_path(plant.position) * decay
    return ReturnDifference(decay * difference, velocity * difference, travel)


def sensitivity_abs2(parts: ReturnDifference, gains: Gains) -> Number:
    """Return |S|^2 of the sampled loop at one point of the unit circle."""
    return parts.open.abs2() / parts.closed(gains).abs2()


def difference_slope(theta: Number, ops: Arithmetic) -> Pair:
    """Return (1 - e^{-j theta})/theta, regular at theta = 0: what the integrator adds to F, divided by theta."""
    half = theta / 2
    return Pair(ops.sin(half) * ops.sinc(half), ops.sinc(theta))


def characteristic_polynomial(plant: SampledPlant, gains: Gains) -> list[Number]:
    """Return the coefficients of the sampled loop's characteristic polynomial, highest power of z first."""
    delay = [*plant.velocity] if plant.fractional else [plant.velocity[0]]
    travel = [*plant.position] if plant.fractional else [plant.position[0]]
    a, K_v, K_p = plant.pole, gains.velocity, gains.position
    order = plant.whole_samples + len(delay)
    if K_p == 0:
        coefficients = [1, -a] + [0] * (order - 1)
        for i, beta in enumerate(delay):
            coefficients[plant.whole_samples + 1 + i] = coefficients[plant.whole_samples + 1 + i] + K_v * beta
        return coefficients
    coefficients = [1, -(1 + a), a] + [0] * (order - 1)
    for i, (beta, gamma) in enumerate(zip(delay, travel, strict=True)):
        at = plant.whole_samples + 1 + i
        coefficients[at] = coefficients[at] + K_v * beta + K_p * gamma
        coefficients[at + 1] = coefficients[at + 1] - K_v * beta + K_p * (plant.drift * beta - a * gamma)
    return coefficients
