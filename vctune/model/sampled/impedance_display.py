"""Model an impedance display, motion in and force out, in sampled time (model/README.md, section 15).

The firmware measures a position x and commands the force -(f_c + K_v F y). Here y = (1 - z^-1) x/T is the differenced
position, F its low-pass, and f_c the coupling's force. The environment and the coupling,

    Z_c = b_c F + k_c T/(1 - z^-1) = b_c F + k_c T/2 - j k_c (T/2) cot(theta/2),

act through y, so all responses are admittances. The loop is stable with every environment that is passive in (f, y) if
Re 1/Z_c > R = -Re(G_y/(1 + K_v F G_y)), where G_y is the response of y to the commanded force. At omega = 0, both sides
vanish like s^2 = sin^2(theta/2). The code therefore divides them by s^2: Re(1/Z_c)/s^2 must exceed R/s^2.

In one hand, G_y = 2 j s e^{-j theta/2} G_x/T comes from the sampled mechanism (`hand_loop`). The module `any_hand`
covers any passive hand.
"""

from __future__ import annotations

from typing import NamedTuple

from vctune.model.device import Device
from vctune.model.gains import Gains, SpringDamper
from vctune.model.loop.filters import firmware_low_pass
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.pair import EvenOdd, Pair


class ForceInHand(NamedTuple):
    """The loop of an impedance display in a hand, without the coupling's force f_c: F = open + K_v velocity, G_y/s^2 =
    met/(2 j s F).

    Attributes
    ----------
    open, velocity : coefficients of F
    met : numerator of G_y/s^2, which the environment sees, m/(N s)
    position : increase of F for each N/m of a spring between device and ground
    """

    open: EvenOdd
    velocity: EvenOdd
    met: EvenOdd
    position: EvenOdd

    def closed(self, gains: Gains) -> EvenOdd:
        """Return F."""
        return self.open + self.velocity.scaled(gains.velocity)

    def clamped(self, gains: Gains, coupling: SpringDamper) -> EvenOdd:
        """Return F for a virtual tool that is held fixed. The coupling is then a part of the loop.

        Parameters
        ----------
        gains, coupling : gains and coupling, in numbers of the loop's arithmetic
        """
        held = self.velocity.scaled(gains.velocity + coupling.damping)
        return self.open + held + self.position.scaled(coupling.stiffness)

    def numerator(self, _gains: Gains) -> EvenOdd:
        """Return the numerator of G_y/s^2 over the denominator 2 j s F. It does not depend on the gains."""
        return self.met


def firmware_filter(device: Device, theta: Number, ops: Arithmetic) -> Pair | None:
    """Return F, the product of the firmware's low-passes of the velocity, at z = e^{j theta}.

    Parameters
    ----------
    device : device; the function uses its sample time and velocity estimate
    theta : omega T, rad, in [0, pi]
    ops : arithmetic of device and theta

    Returns
    -------
    Pair or None
        Dimensionless. It has the shape of theta; None without a low-pass.
    """
    estimate, omega = device.velocity, theta / device.sample_time
    one = None if estimate is None else firmware_low_pass(estimate, device.sample_time, omega, ops)
    if one is None or estimate is None:
        return None
    once = Pair(one.re, -(omega * one.lag))
    return once if estimate.filter_order == 1 else once * once


class Offered(NamedTuple):
    """1/Z_c/s^2 = (above + j spring/s)/below, m/(N s), with s = sin(theta/2) and below > 0.

    Attributes
    ----------
    above : Re Z_c, N s/m
    below : s^2 |Z_c|^2, (N s/m)^2
    spring : -s Im Z_c, N s/m
    """

    above: Number
    below: Number
    spring: Number

    @property
    def quotient(self) -> Number:
        """Re(1/Z_c)/sin^2(theta/2), m/(N s)."""
        return self.above / self.below


def offered_by_spring(
    coupling: SpringDamper, sample_time: Number, low_pass: Pair | None, theta: Number, ops: Arithmetic
) -> Offered:
    """Return 1/Z_c/sin^2(theta/2) of a spring-damper as a quotient (model/README.md, section 15).

    Parameters
    ----------
    coupling : b_c >= 0, N s/m, and k_c > 0, N/m
    sample_time : T, s
    low_pass : F at theta, which filters the damper's velocity; None for 1
    theta : omega T, rad, in [0, pi]
    ops : arithmetic of the other arguments

    Returns
    -------
    Offered
        m/(N s). It has the shape of theta.
    """
    half, sin, cos = coupling.stiffness * sample_time / 2, ops.sin(theta / 2), ops.cos(theta / 2)
    if low_pass is None:
        resistance = coupling.damping + half
        loss, spring = sin * resistance, half * cos
        return Offered(resistance, loss * loss + spring * spring, spring)
    resistance = coupling.damping * low_pass.re + half
    loss, spring = sin * resistance, half * cos - sin * (coupling.damping * low_pass.im)
    return Offered(resistance, loss * loss + spring * spring, spring)


def spring_forms(
    device: Device, theta: Number, ops: Arithmetic
) -> tuple[tuple[Number, Number], tuple[Number, Number, Number]]:
    """Return the coefficients of b_c and k_c in the numerator and the denominator of `offered_by_spring`.

    Numerator: Re Z_c = a_1 b_c + a_0 k_c. Denominator: s^2 |Z_c|^2 = q_2 b_c^2 + q_1 b_c k_c + q_0 k_c^2. The function
    evaluates three couplings; their values determine the quadratic form.

    Parameters
    ----------
    device : device that runs the couplings; the function uses its sample time and velocity filter
    theta : omega T, rad, in [0, pi]
    ops : arithmetic of device and theta

    Returns
    -------
    resistance : a_1 and a_0, each with the shape of theta
    size : q_2, q_1 and q_0, each with the shape of theta
    """
    T, low_pass, zero = device.sample_time, firmware_filter(device, theta, ops), 0 * theta
    damper, spring, both = (
        offered_by_spring(SpringDamper(b_c, k_c), T, low_pass, theta, ops)
        for b_c, k_c in ((T, 0 * T), (0 * T, 1 + 0 * T), (T, 1 + 0 * T))
    )
    crossed = (both.below - damper.below - spring.below) / T
    return (damper.above / T + zero, spring.above + zero), (damper.below / (T * T), crossed, spring.below + zero)


def spring_damper_admittance(
    coupling: SpringDamper, sample_time: Number, low_pass: Pair | None, theta: Number, ops: Arithmetic
) -> Pair:
    """Return 1/Z_c of a spring-damper, Z_c = b_c F + k_c T/2 - j k_c (T/2) cot(theta/2) (model/README.md, section 15).

    Parameters
    ----------
    coupling : b_c >= 0, N s/m, and k_c > 0, N/m
    sample_time : T, s
    low_pass : F at theta, which filters the damper's velocity; None for 1
    theta : omega T, rad, in (0, pi]
    ops : arithmetic of the other arguments

    Returns
    -------
    Pair
        m/(N s). It has the shape of theta.
    """
    half, sin, cos = coupling.stiffness * sample_time / 2, ops.sin(theta / 2), ops.cos(theta / 2)
    passed = low_pass or Pair(1, 0)
    re, im = coupling.damping * passed.re + half, coupling.damping * passed.im - half * cos / sin
    size = re * re + im * im
    return Pair(re / size, -im / size)


class Required(NamedTuple):
    """R = lost/size, the least feasible Re Z_c; for an impedance display R/s^2, the least feasible Re(1/Z_c)/s^2.

    Attributes
    ----------
    lost : numerator, N s/m; for an impedance display m/(N s)
    size : denominator, dimensionless: |F|^2 in one hand, 1 for a servo. In any hand, `size` is positive if no hand
        makes the loop with K_v alone unstable at this frequency
    """

    lost: Number
    size: Number
