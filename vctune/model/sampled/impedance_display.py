"""Model an impedance display, motion in and force out, in sampled time (model/README.md, section 15)."""

from __future__ import annotations

from typing import NamedTuple

from vctune.model.device import Device
from vctune.model.gains import Gains, SpringDamper
from vctune.model.loop.filters import velocity_filter
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.pair import EvenOdd, Pair


class ForceInHand(NamedTuple):
    """The loop of an impedance display in a hand, without the coupling's force f_c: F = open + K_v velocity, G_y/s^2 =
    met/(2 j s F)."""

    open: EvenOdd  # coefficients of F
    velocity: EvenOdd
    met: EvenOdd  # numerator of G_y/s^2, which the environment sees, m/(N s)
    position: EvenOdd  # increase of F for each N/m of a spring between device and ground

    def closed(self, gains: Gains) -> EvenOdd:
        """Return F."""
        return self.open + self.velocity.scaled(gains.velocity)

    def before_wall(self, wall: SpringDamper, share: Number) -> EvenOdd:
        """Return F with a share of the coupling between device and ground."""
        return self.open + (self.velocity.scaled(wall.damping) + self.position.scaled(wall.stiffness)).scaled(share)

    def numerator(self, _gains: Gains) -> EvenOdd:
        """Return the numerator of G_y/s^2 over the denominator 2 j s F. It does not depend on the gains."""
        return self.met


def firmware_filter(device: Device, theta: Number, ops: Arithmetic) -> Pair | None:
    """Return F, the firmware's filter of the velocity, at z = e^{j theta}."""
    omega = theta / device.sample_time
    passed = velocity_filter(device, omega, ops)
    return None if passed is None else Pair(passed.re, -(omega * passed.lag))


class YOffered(NamedTuple):
    """1/Z_c/s^2 = (above + j spring/s)/below, m/(N s), with s = sin(theta/2) and below > 0."""

    above: Number  # Re Z_c, N s/m
    below: Number  # s^2 |Z_c|^2, (N s/m)^2
    spring: Number  # -s Im Z_c, N s/m

    @property
    def quotient(self) -> Number:
        """Re(1/Z_c)/sin^2(theta/2), m/(N s)."""
        return self.above / self.below


def offered_by_spring(
    coupling: SpringDamper, sample_time: Number, low_pass: Pair | None, theta: Number, ops: Arithmetic
) -> YOffered:
    """Return 1/Z_c/sin^2(theta/2) of a spring-damper as a quotient (model/README.md, section 15)."""
    half, sin, cos = coupling.stiffness * sample_time / 2, ops.sin(theta / 2), ops.cos(theta / 2)
    if low_pass is None:
        resistance = coupling.damping + half
        loss, spring = sin * resistance, half * cos
        return YOffered(resistance, loss * loss + spring * spring, spring)
    resistance = coupling.damping * low_pass.re + half
    loss, spring = sin * resistance, half * cos - sin * (coupling.damping * low_pass.im)
    return YOffered(resistance, loss * loss + spring * spring, spring)


def spring_forms(
    device: Device, theta: Number, ops: Arithmetic
) -> tuple[tuple[Number, Number], tuple[Number, Number, Number]]:
    """Return the coefficients of b_c and k_c in the numerator and the denominator of `offered_by_spring`."""
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
    """Return 1/Z_c of a spring-damper, Z_c = b_c F + k_c T/2 - j k_c (T/2) cot(theta/2)."""
    given, s = offered_by_spring(coupling, sample_time, low_pass, theta, ops), ops.sin(theta / 2)
    return Pair(s * s * given.above / given.below, s * given.spring / given.below)


class Required(NamedTuple):
    """R = lost/size, the least feasible Re Z_c; for an impedance display R/s^2, the least feasible Re(1/Z_c)/s^2."""

    lost: Number  # numerator, N s/m; for an impedance display m/(N s)
    size: Number  # denominator, dimensionless: |F|^2 in one hand, 1 for a servo
