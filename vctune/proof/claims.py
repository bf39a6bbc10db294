"""What is to be proved of a design, as functions that must be positive; written once for every arithmetic."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, nextafter, pi

from vctune.model.arithmetic import Arithmetic, Number
from vctune.model.coupling import coupling_impedance
from vctune.model.llewellyn import modulus_excess
from vctune.model.loop import hold_response, loop_response
from vctune.model.quantities import Coupling, Device, Gains

HALF_TURN = nextafter(pi, inf)
"""theta = omega T at the Nyquist frequency, rounded upwards; the sampled loop's curve is symmetric there."""


@dataclass(frozen=True, slots=True)
class Design:
    """What is judged: a device with its gains and its coupling, in numbers of any arithmetic."""

    device: Device
    gains: Gains
    coupling: Coupling


def conditions_margin(design: Design, omega: Number, factor: Number, ops: Arithmetic, *, integrator: bool) -> Number:
    """Return 2 Re D Re Z_c - factor N at omega > 0, (N s/m)^2 (DESIGN 1.4).

    N = |C||D| - Re(C conj D) >= 0 and Re Z_c > 0, so that where it is positive Re G_hh > 0 and ratio >= factor.
    """
    device = design.device
    loop = loop_response(device, design.gains, omega, hold_response(device, omega, ops), integrator=integrator)
    return 2 * loop.re_D * coupling_impedance(design.coupling, omega).re - factor * modulus_excess(loop, ops)


def sensitivity_margin(
    device: Device, gains: Gains, omega: Number, limit: Number, ops: Arithmetic, *, integrator: bool
) -> Number:
    """Return limit^2 |D|^2 - |Z_d|^2 times the loop's scale squared, positive where |S| < limit."""
    loop = loop_response(device, gains, omega, hold_response(device, omega, ops), integrator=integrator)
    return limit * limit * loop.D.abs2() - loop.Z_d.abs2()


def along_hold(device: Device, gains: Gains, omega: Number, ops: Arithmetic) -> tuple[Number, Number]:
    """Return Re(D conj H) and |H|^2, neither of which depends on K_p; regular at omega = 0.

    The integrator's K_p H/(j omega) is at right angles to H. Where Re(D conj H) > 0, D is not 0 for any K_p.
    """
    hold = hold_response(device, omega, ops)
    lagging = omega * hold.im
    H2 = hold.re * hold.re + lagging * lagging
    return device.damping * hold.re - device.mass * omega * lagging + gains.velocity * H2, H2


def sensitivity_floor(device: Device, gains: Gains, omega: Number, limit: Number, ops: Arithmetic) -> Number:
    """Return limit Re(D conj H) - |Z_d||H|, positive only where |S| < limit for every K_p >= 0."""
    along, H2 = along_hold(device, gains, omega, ops)
    reactance = device.mass * omega
    return limit * along - ops.sqrt((device.damping * device.damping + reactance * reactance) * H2)


def outwards(band: tuple[float, float]) -> tuple[float, float]:
    """Return a band in rad/s widened by the rounding of 2 pi f."""
    low, high = band
    for _ in range(4):
        low, high = nextafter(low, 0.0), nextafter(high, inf)
    return low, high


def inwards(band: tuple[float, float]) -> tuple[float, float]:
    """Return a band in rad/s that lies within the one that was meant, whatever the rounding of 2 pi f."""
    low, high = band
    for _ in range(4):
        low, high = nextafter(low, inf), nextafter(high, 0.0)
    return low, high
