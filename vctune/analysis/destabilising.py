"""Find the passive environment with which the motion of a refuted loop grows in a hand (model/README.md, section 14).

Where Re(Z_c + Z_seen) < 0, a spring or mass cancels the imaginary part. A damper in parallel supplies the missing
resistance and thus holds a pole on the unit circle. The code reduces the damper step by step and follows the pole. If
the design just violates the constraint, the pole moves out of the unit circle until the damper is gone. If the
violation is large, the pole can return to the circle earlier, and part of the damper remains. The functions of the loop
in a hand are analytic in theta, z = e^(j theta), so the same formulas describe the moving pole.

For an impedance display, the code takes the same steps with admittances. A spring or mass cancels the imaginary part of
1/Z_c + G_y/(1 + K_v F G_y). A damper in series holds the pole, and the code then removes this damper (section 15).
"""

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

LEAST = 1e-7
"""Least angle omega T for a spring, because at 0 no spring is soft enough. With half or twice this angle, the growth is
the same."""
NYQUIST = 1e-6
"""Distance from pi within which environments have no reactance, and need none. With half or twice this distance, the
growth is the same."""
FIRST, LAST = 0.125, 1e-4
"""Shares of the damper that the code removes in one step: the first share, and the least one. With half or twice these
shares, the code follows the same poles."""
FARTHEST = 0.2
"""Greatest move of a pole in one step, relative to the pole's angle. With half this size, the code takes more steps;
with twice this size, it may switch to another pole."""
MOST = 64
"""Greatest number of steps for which the code follows a pole. Most poles take eight steps. With half or twice this
number, the code follows the same poles."""
GROWTH = 1e-10
"""Growth per radian above which the code reports that a motion grows. This threshold exceeds the rounding error of
Newton's method. With half or twice this threshold, the growth is the same."""
STEPS, CONVERGED, DIFFERENCE = 8, 1e-12, 1e-6
"""Number of Newton steps, the relative step at which they end, and the relative difference for the derivative. The
difference gives the derivative with an error of 1e-10. With half or twice as many steps, the code follows the same
poles."""


@dataclass(frozen=True, slots=True)
class GrowingEnvironment:
    """A spring or a mass in its discrete form, and the motion of the loop with this environment.

    Attributes
    ----------
    kind : "spring" or "mass"
    value : N/m or kg, >= 0; 0 for no environment
    damping : damping in parallel, N s/m, >= 0
    growth : growth rate of the motion, 1/s, > 0
    omega : frequency of the growing oscillation, rad/s
    stiffness : stiffness of a spring in parallel with a mass, N/m, >= 0
    rule, late : rule by which the firmware integrates the environment, and number of samples by which the environment's
        force is late
    """

    kind: Literal["spring", "mass"]
    value: float
    damping: float
    growth: float
    omega: float
    stiffness: float = 0.0
    rule: WorldRule = "trapezoid"
    late: int = 0

    @property
    def quantity(self) -> Literal["stiffness", "mass"]:
        """The quantity of the environment's value (`vctune.model.numbers.units`)."""
        return "stiffness" if self.kind == "spring" else "mass"


def destabilising(
    device: Device, gains: Gains, coupling: AnyCoupling, hand: Hand, omega: float
) -> GrowingEnvironment | None:
    """Return the environment with which the motion in a hand grows, given a frequency at which Re(Z_c + Z_seen) < 0.

    Parameters
    ----------
    device, gains, coupling : a design with plain numbers
    hand : hand in which the constraint is violated
    omega : frequency at which the constraint is violated, rad/s, from 0 to pi/T

    Returns
    -------
    GrowingEnvironment or None
        The environment has no damper if the motion grows without one. The result is None if the code finds no growing
        motion, for example where the constraint holds.
    """
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
    pole.

    Parameters
    ----------
    device, gains, coupling : a design with plain numbers
    hand : hand in which the constraint is violated
    omega : frequency at which the constraint is violated, rad/s, from 0 to pi/T
    worlds : the box of environments

    Returns
    -------
    GrowingEnvironment or None
        The environment has the least damping of the box if the motion grows with this damping. It has more damping if
        the motion of an impedance display grows with the tool held. The result is None if the motion grows with no
        member.
    """
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
    """Return Z_c/factor + Z_seen; for an impedance display 1/Z_c/factor + G_y/(1 + K_v F G_y).

    Parameters
    ----------
    device, gains, coupling : a design with plain numbers
    hand : hand at the handle
    theta : omega T, rad, in (0, pi)
    factor : number by which the function divides Z_c or 1/Z_c
    """
    return reaction_in(device, gains, coupling, hand, factor)(theta)


def reaction_in(
    device: Device, gains: Gains, coupling: AnyCoupling, hand: Hand, factor: float = 1.0
) -> Callable[[complex], complex]:
    """Return `reaction` as a function of the angle, to evaluate it at many angles.

    Parameters
    ----------
    device, gains, coupling, hand, factor : see `reaction`
    """
    plant = plant_in_hand(device, hand, delays_of(device), FLOATS)

    def at(theta: complex) -> complex:
        if isinstance(coupling, SpringDamper):
            return _met(plant, gains, theta) + _given(coupling, device, theta) / factor
        return _seen(plant, gains, theta) + _coupling(coupling, _warped(theta, device.sample_time)) / factor

    return at


def impedance_met(
    device: Device, gains: Gains, coupling: AnyCoupling, hand: Hand, factor: float = 1.0
) -> Callable[[complex], complex]:
    """Return the impedance that an environment meets as a function of the angle: Z_c/factor + Z_seen, or its dual.

    Parameters
    ----------
    device, gains, coupling, hand, factor : see `reaction`
    """
    alone = reaction_in(device, gains, coupling, hand, factor)
    return (lambda theta: 1 / alone(theta)) if device.kind.inverse else alone


def growing_with(
    alone: Callable[[complex], complex], theta: float, sample_time: float, *, admittance: bool
) -> GrowingEnvironment | None:
    """Return the environment with which a loop grows.

    Parameters
    ----------
    alone : Z_c + Z_seen, analytic in the angle; for an impedance display 1/Z_c + G_y/(1 + K_v F G_y)
    theta : angle, rad, in [0, pi], at which the real part of `alone` is negative
    sample_time : T, s
    admittance : whether `alone` belongs to an impedance display

    Returns
    -------
    GrowingEnvironment or None
        The environment has no damper if the motion grows without one. The result is None if the code finds no growing
        motion.
    """
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
    """Return the growing motion of a loop without an environment; None if the code finds none.

    Parameters
    ----------
    alone : -1 - 1/L of the loop, analytic in the angle
    theta : angle, rad, in (0, pi), at which L is real and less than -1; a share of the gain puts a pole there
    sample_time : T, s
    """
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
    """Follow a pole from the unit circle while reducing, step by step, the damper that holds it there.

    If no damper holds a pole there, the path is empty. The path ends where the function can no longer follow the pole.
    """
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
    """Return Z_seen = P/(2 j s F).

    The code evaluates o/(2 N) + e/(2 j s N) with e + j s o = P (F.even - j s F.odd) and N = F.even^2 + s^2 F.odd^2. On
    the unit circle, the two terms are the real and the imaginary part. With a single quotient, the rounding error of
    one part would exceed the other part near theta = 0.
    """
    loop, s = loop_in_hand(plant, theta, FLOATS), complex(np.sin(theta / 2))
    F, P = loop.closed(gains), loop.numerator(gains)
    even, odd = P.even * F.even + s * s * (P.odd * F.odd), P.odd * F.even - P.even * F.odd
    size = F.even * F.even + s * s * (F.odd * F.odd)
    return complex(odd / (2 * size) - 1j * (even / (2 * s * size)))


def zero_near(f: Callable[[complex], complex], start: complex) -> complex | None:
    """Return the zero of an analytic function to which Newton's method converges; None if it does not converge.

    Parameters
    ----------
    f : the analytic function
    start : start of the iteration, not 0
    """
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
