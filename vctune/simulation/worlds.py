"""The firmware of a design before each environment in which it is told whether it shakes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product
from math import inf

from vctune.model.device import Device
from vctune.model.experiment import Environment
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.worlds import World, Worlds
from vctune.simulation.controller import Law
from vctune.simulation.scene import designed_law

NOTHING, RIGID = World(0.0, 0.0, 0.0), World(0.0, 0.0, inf)
IMMOVABLE = 1e30  # Damping of an environment that does not move, N s/m


def worlds_of(worlds: Worlds | None, *, rigid: bool) -> list[World]:
    """Return the environments of a problem: its rigid world, the corners of its box, or nothing and a rigid world if it
    states none."""
    if rigid:
        return [RIGID]
    if worlds is None:
        return [NOTHING, RIGID]
    low, high = worlds.low, worlds.high
    names = ("mass", "damping", "stiffness")
    ends = product(*(dict.fromkeys((getattr(low, name), getattr(high, name))) for name in names))
    return list(dict.fromkeys(RIGID if inf in end else World(*end) for end in ends))


def laws(device: Device, gains: Gains, coupling: AnyCoupling, worlds: Sequence[World]) -> Iterator[tuple[World, Law]]:
    """Yield each environment with the firmware before it.

    Where x_e does not move (an admittance display before a rigid world) or follows the handle without a force (an
    impedance display before nothing), the coupling is left out: its own motion there does not reach the hand.
    """
    spring = device.kind.inverse
    for world in worlds:
        if spring and world == RIGID:
            yield world, designed_law(device, gains, coupling, Environment(stiffness=inf))
        elif world in (NOTHING, RIGID) and spring == (world == NOTHING):
            alone = designed_law(device, gains, None, Environment(rule="trapezoid"))
            yield world, replace(alone, virtual_damping=IMMOVABLE)
        else:
            met = Environment(world.mass, world.damping, world.stiffness, rule="trapezoid")
            yield world, designed_law(device, gains, coupling, met)
