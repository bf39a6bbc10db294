"""Find the passive environment with which the motion of a refuted loop grows in a hand (model/README.md, section
14)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import pi
from typing import Literal

import numpy as np

from vctune.model.coupling import coupling_impedance
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains, SpringDamper, series_coupling
from vctune.model.hands import Hand
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.sampled.hand_loop import loop_in_hand
from vctune.model.sampled.impedance_display import firmware_filter, spring_damper_admittance
from vctune.model.sampled.plant_in_hand import AnyPlantInHand, delays_of, plant_in_hand
from vctune.model.worlds import WorldRule, Worlds

LEAST = 1e-7  # Least angle omega T for a spring, because at 0 no spring is soft enough
NYQUIST = 1e-6  # Distance from pi within which environments have no reactance, and need none
FIRST, LAST = 0.125, 1e-4  # Shares of the damper that the code removes in one step: the first share, and the least one
FARTHEST = 0.2  # Greatest move of a pole in one step, relative to the pole's angle
MOST = 64  # Greatest number of steps for which the code follows a pole
GROWTH = 1e-10  # Growth per radian above which the code reports that a motion grows
# Number of Newton steps, the relative step at which they end, and the relative difference for the derivative
STEPS, CONVERGED, DIFFERENCE = 8, 1e-12, 1e-6


@dataclass(frozen=True, slots=True)
class GrowingEnvironment:
    """A spring or a mass in its discrete form, and the motion of the loop with this environment."""

    kind: Literal["spring", "mass"]  # "spring" or "mass"
    value: float  # N/m or kg, >= 0; 0 for no environment
    damping: float  # damping in parallel, N s/m, >= 0
    growth: float  # growth rate of the motion, 1/s, > 0
    omega: float  # frequency of the growing oscillation, rad/s
    stiffness: float = 0.0  # stiffness of a spring in parallel with a mass, N/m, >= 0
    rule: WorldRule = "trapezoid"
    late: int = 0

    @property
    def quantity(self) -> Literal["stiffness", "mass"]:
        """The quantity of the environment's value (`vctune.model.numbers.units`)."""
        return "stiffness" if self.kind == "spring" else "mass"


def destabilising(
    device: Device, gains: Gains, coupling: AnyCoupling, hand: Hand, omega: float
) -> GrowingEnvironment | None:
    """Return the environment with which the motion in a hand grows, given a frequency at which Re(Z_c + Z_seen) < 0."""
    T, plant = device.sample_time, plant_in_hand(device, hand, delays_of(device), FLOATS)

    def alone(theta: complex) -> complex:
        if isinstance(coupling, SpringDamper):
            return _met(plant, gains, theta) + _given(coupling, device, theta)
        return _seen(plant, gains, theta) + _coupling(coupling, _warped(theta, T))

    return growing_with(alone, omega * T, T, admittance=isinstance(coupling, SpringDamper))


def growing_in_worlds(
    device: Device, gains: Gains, coupling: AnyCoupling, hand: Hand, omega: float, worlds: Worlds
) -> GrowingEnvironment | None:
    """Return the environment of a box with which the motion in a hand grows, for a frequency at which a member puts a
    pole."""
    T, low = device.sample_time, worlds.low
    theta = min(max(omega * T, LEAST), pi - NYQUIST)
    alone, at = impedance_met(device, gains, coupling, hand), _warped(theta, T).real
    met = -alone(theta).imag
    heavier = met * at >= low.mass * at * at - low.stiffness
    mass = (met + low.stiffness / at) / at if heavier else low.mass
    stiffness = low.stiffness if heavier else (low.mass * at - met) * at
    if mass > worlds.high.mass or stiffness > worlds.high.stiffness:
        return None

    def unbalance(theta: complex, *, damping: float) -> complex:
        omega = _warped(theta, T)
        return alone(theta) + low.damping + damping + 1j * (mass * omega - stiffness / omega)

    found = _outwards(unbalance, theta) or (_with_more(unbalance, theta) if device.kind.inverse else None)
    if found is None:
        return None
    damping, growth, turn = low.damping + found[0], found[1] / T, found[2] / T
    if mass > 0:
        return GrowingEnvironment("mass", mass, damping, growth, turn, stiffness)
    return GrowingEnvironment("spring", stiffness, damping, growth, turn)


def reaction(
    device: Device, gains: Gains, coupling: AnyCoupling, hand: Hand, theta: complex, factor: float = 1.0
) -> complex:
    """Return Z_c/factor + Z_seen; for an impedance display 1/Z_c/factor + G_y/(1 + K_v F G_y)."""
    return reaction_in(device, gains, coupling, hand, factor)(theta)


def reaction_in(
    device: Device, gains: Gains, coupling: AnyCoupling, hand: Hand, factor: float = 1.0
) -> Callable[[complex], complex]:
    """Return `reaction` as a function of the angle, to evaluate it at many angles."""
    plant = plant_in_hand(device, hand, delays_of(device), FLOATS)

    def at(theta: complex) -> complex:
        if isinstance(coupling, SpringDamper):
            return _met(plant, gains, theta) + _given(coupling, device, theta) / factor
        return _seen(plant, gains, theta) + _coupling(coupling, _warped(theta, device.sample_time)) / factor

    return at


def impedance_met(
    device: Device, gains: Gains, coupling: AnyCoupling, hand: Hand, factor: float = 1.0
) -> Callable[[complex], complex]:
    """Return the impedance that an environment meets as a function of the angle: Z_c/factor + Z_seen, or its dual."""
    alone = reaction_in(device, gains, coupling, hand, factor)
    return (lambda theta: 1 / alone(theta)) if device.kind.inverse else alone


def growing_with(
    alone: Callable[[complex], complex], theta: float, sample_time: float, *, admittance: bool
) -> GrowingEnvironment | None:
    """Return the environment with which a loop grows."""
    theta = min(max(theta, LEAST), pi)
    reactance, at = alone(theta).imag if theta < pi - NYQUIST else 0.0, _warped(theta, sample_time).real
    # the numbers of a mass m and a spring k; for an impedance display, 1/k and 1/m
    mass, stiffness = max(0.0, -reactance / at), max(0.0, reactance * at)

    def unbalance(theta: complex, *, damping: float) -> complex:
        at = _warped(theta, sample_time)
        return alone(theta) + damping + 1j * (mass * at - stiffness / at)

    found = _outwards(unbalance, theta)
    if found is None:
        return None
    damping, growth, turn = found[0], found[1] / sample_time, found[2] / sample_time
    if admittance:
        return _dual(mass, stiffness, damping, growth, turn)
    kind: Literal["spring", "mass"] = "spring" if stiffness > 0 else "mass"
    return GrowingEnvironment(kind, stiffness or mass, damping, growth, turn)


def growing_without(alone: Callable[[complex], complex], theta: float, sample_time: float) -> GrowingEnvironment | None:
    """Return the growing motion of a loop without an environment; None if the code finds none."""
    found = _outwards(lambda theta, *, damping: alone(theta) + damping, theta)
    if found is None or found[0] > 0:
        return None
    return GrowingEnvironment("spring", 0.0, 0.0, found[1] / sample_time, found[2] / sample_time)


def _outwards(unbalance: Callable[..., complex], theta: float) -> tuple[float, float, float] | None:
    """Return the remaining damper, the growth per sample and the angle of a pole that has left the unit circle."""
    return _left_circle(unbalance, theta, -unbalance(theta, damping=0.0).real)


def _with_more(unbalance: Callable[..., complex], theta: float) -> tuple[float, float, float] | None:
    """Return the same result as `_outwards`, for a damper that grows to twice its size."""
    held: float = -unbalance(theta, damping=0.0).real
    found = _left_circle(lambda theta, *, damping: unbalance(theta, damping=2 * held - damping), theta, held)
    return None if found is None else (2 * held - found[0], *found[1:])


def _left_circle(unbalance: Callable[..., complex], theta: float, held: float) -> tuple[float, float, float] | None:
    with np.errstate(all="ignore"):
        path = _followed(unbalance, theta, held)
    growing = [step for step in path if step[1].imag < -GROWTH * abs(step[1])]
    if not growing:
        return None
    damping, pole = growing[-1] if growing[-1][0] == 0 else min(growing, key=lambda step: step[1].imag)
    return damping, -pole.imag, abs((pole.real + pi) % (2 * pi) - pi)


def _dual(compliance: float, mobility: float, damping: float, growth: float, omega: float) -> GrowingEnvironment | None:
    """Return the environment with 1/k = compliance or 1/m = mobility; None if a damper in series remains."""
    if damping > 0 or compliance == mobility == 0:  # experiments contain neither a damper in series nor a rigid wall
        return None
    if compliance > 0:
        return GrowingEnvironment("spring", 1 / compliance, 0.0, growth, omega)
    return GrowingEnvironment("mass", 1 / mobility, 0.0, growth, omega)


def _followed(unbalance: Callable[..., complex], theta: float, damping: float) -> list[tuple[float, complex]]:
    """Follow a pole from the unit circle while reducing, step by step, the damper that holds it there."""
    pole, left, share, path = complex(theta), 1.0, FIRST, []
    for _ in range(MOST):
        if damping <= 0 or left <= 0 or share <= LAST:
            break
        held = max(left - share, 0.0)
        found = zero_near(partial(unbalance, damping=held * damping), pole)
        if found is None or abs(found - pole) > FARTHEST * abs(pole):
            share /= 2
            continue
        pole, left, share = found, held, min(2 * share, FIRST)
        path.append((held * damping, pole))
    return path


def _warped(theta: complex, sample_time: float) -> complex:
    """Return the frequency (2/T) tan(theta/2) of the trapezoidal rule, rad/s."""
    return complex(2 / sample_time * np.tan(theta / 2))


def _coupling(coupling: AnyCoupling, omega: complex) -> complex:
    Z_c = coupling_impedance(series_coupling(coupling), omega)
    return complex(Z_c.re + 1j * Z_c.im)


def _given(coupling: SpringDamper, device: Device, theta: complex) -> complex:
    """Return 1/Z_c."""
    low_pass = firmware_filter(device, theta, FLOATS)
    found = spring_damper_admittance(coupling, device.sample_time, low_pass, theta, FLOATS)
    return complex(found.re + 1j * found.im)


def _met(plant: AnyPlantInHand, gains: Gains, theta: complex) -> complex:
    """Return G_y/(1 + K_v F G_y) = s P/(2 j F) of an impedance display."""
    return _seen(plant, gains, theta) * complex(np.sin(theta / 2) ** 2)


def _seen(plant: AnyPlantInHand, gains: Gains, theta: complex) -> complex:
    """Return Z_seen = P/(2 j s F)."""
    loop, s = loop_in_hand(plant, theta, FLOATS), complex(np.sin(theta / 2))
    F, P = loop.closed(gains), loop.numerator(gains)
    even, odd = P.even * F.even + s * s * (P.odd * F.odd), P.odd * F.even - P.even * F.odd
    size = F.even * F.even + s * s * (F.odd * F.odd)
    return complex(odd / (2 * size) - 1j * (even / (2 * s * size)))


def zero_near(f: Callable[[complex], complex], start: complex) -> complex | None:
    """Return the zero of an analytic function to which Newton's method converges; None if it does not converge."""
    at = start
    for _ in range(STEPS):
        h = DIFFERENCE * abs(at)
        step = f(at) / ((f(at + h) - f(at - h)) / (2 * h))
        at -= step
        if not np.isfinite(at):
            return None
        if abs(step) < CONVERGED * abs(at):
            return at
    return None
