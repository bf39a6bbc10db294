"""The environment for which a design has the least reserve, with its hand and frequency.

At that angle it cancels the reactance of the loop with the coupling divided by the safety factor. Each passive
environment is a mass or a spring; for a box it is the lightest or softest member, or its limit if that is nearer.
"""

from __future__ import annotations

from math import inf, pi, tan

from vctune.analysis.destabilising import reaction
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.hands import Hand
from vctune.model.worlds import World, Worlds

LEAST = 1e-6
"""Angle next to an end at which no environment has a reactance."""


def binding_world(
    device: Device,
    gains: Gains,
    coupling: AnyCoupling,
    hand: Hand,
    omega: float,
    factor: float,
    worlds: Worlds | None = None,
) -> World | None:
    """Return the environment, without the damping that it lacks; None at an end of the angles, where any environment
    suffices.

    Parameters
    ----------
    device, gains, coupling : a design, plain numbers
    hand, omega : hand and frequency with the least reserve, rad/s
    factor : the safety factor
    worlds : the box; None for every passive environment
    """
    theta = omega * device.sample_time
    if not LEAST < theta < pi - LEAST:
        return None
    met, u = -reaction(device, gains, coupling, hand, theta, factor).imag, 2 / device.sample_time * tan(theta / 2)
    if device.kind.inverse:  # the reaction is an admittance, and so is 1/(mass s) or s/stiffness
        return World(0.0, 0.0, u / met) if met > 0 else World(-1 / (met * u), 0.0, 0.0) if met < 0 else None
    low, high = (worlds.low, worlds.high) if worlds else (World(0.0, 0.0, 0.0), World(inf, inf, inf))
    mass = (met + low.stiffness / u) / u
    if mass >= low.mass:
        return World(min(mass, high.mass), low.damping, low.stiffness)
    return World(low.mass, low.damping, min((low.mass * u - met) * u, high.stiffness))
