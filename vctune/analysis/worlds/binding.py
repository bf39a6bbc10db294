"""Find the environment with which a design has the least reserve, with its hand and frequency."""

from __future__ import annotations

from math import inf, pi, tan

from vctune.analysis.destabilising import impedance_met, reaction
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.hands import Hand
from vctune.model.worlds import World, Worlds

LEAST = 1e-6  # Distance, rad, of an angle from 0 and pi within which no environment has a reactance


def binding_world(
    device: Device,
    gains: Gains,
    coupling: AnyCoupling,
    hand: Hand,
    omega: float,
    factor: float,
    worlds: Worlds | None = None,
) -> World | None:
    """Return the environment without additional damping; None near angles 0 and pi, where any environment suffices."""
    theta = omega * device.sample_time
    if not LEAST < theta < pi - LEAST:
        return None
    u = 2 / device.sample_time * tan(theta / 2)
    if device.kind.inverse and worlds is None:  # the reaction is an admittance, as are 1/(mass s) and s/stiffness
        met = -reaction(device, gains, coupling, hand, theta, factor).imag
        return World(0.0, 0.0, u / met) if met > 0 else World(-1 / (met * u), 0.0, 0.0) if met < 0 else None
    met = -impedance_met(device, gains, coupling, hand, factor)(theta).imag
    low, high = (worlds.low, worlds.high) if worlds else (World(0.0, 0.0, 0.0), World(inf, inf, inf))
    mass = (met + low.stiffness / u) / u
    if mass >= low.mass:
        return World(min(mass, high.mass), low.damping, low.stiffness)
    return World(low.mass, low.damping, min((low.mass * u - met) * u, high.stiffness))
