"""The mechanism of a device: a chain of masses on springs, from the motor to the handle (model/README.md, section
12)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import NamedTuple

from vctune.model.device import Device
from vctune.model.hands import LeastOperator
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.matrices import add, times
from vctune.model.parts import Structure

Combination = dict[str, Number]  # a linear combination of states and inputs, by name
Rates = dict[str, Combination]  # rates of the states, by name
POSITION, MOTOR, HANDLE = "position", "velocity", "handle"  # of the motor, and the velocity of a handle on a spring


class Link(NamedTuple):
    """A spring of the chain, and the mass behind it."""

    mass: Number  # kg
    stiffness: Number  # N/m
    viscosity: Number  # N s/m
    swing2: Number  # square of the frequency at which the two sides of the spring swing, (rad/s)^2, without a load
    decay: Number  # viscosity per reduced mass of the two sides, rad/s


class Chain(NamedTuple):
    """The masses of a device: its motor, and those behind each spring; the last one is the handle."""

    motor: Number  # kg
    damping: Number  # of the motor, N s/m
    links: tuple[Link, ...] = ()
    held: Number | None = None  # damping of the handle's load, N s/m; None without a load
    sensed: str = MOTOR  # name of the velocity whose position is a state, and which the firmware reads

    @property
    def bends(self) -> tuple[str, ...]:
        """The names of the bends, each the position behind a spring less the one before it."""
        return tuple("bend" if k == 0 else f"bend {k + 1}" for k in range(len(self.links)))

    @property
    def velocities(self) -> tuple[str, ...]:
        """The names of the velocities of all masses."""
        between = (f"velocity {k + 2}" for k in range(len(self.links) - 1))
        return (MOTOR, *between, HANDLE) if self.links else (MOTOR,)

    @property
    def states(self) -> list[str]:
        """The names of the states: the sensed position and its velocity, then each bend with a velocity."""
        others = (name for name in self.velocities if name != self.sensed)
        return [POSITION, self.sensed, *(name for pair in zip(self.bends, others, strict=True) for name in pair)]

    @property
    def masses(self) -> dict[str, Number]:
        """The mass of each velocity."""
        return dict(zip(self.velocities, (self.motor, *(link.mass for link in self.links)), strict=True))

    @property
    def place(self) -> Combination:
        """The handle's position."""
        return dict.fromkeys((POSITION, *(self.bends if self.sensed == MOTOR else ())), 1)

    @property
    def give(self) -> Number:
        """The compliance of all springs, m/N; 0 for a rigid device."""
        return reduce(add, (1 / link.stiffness for link in self.links), 0)

    def in_units(self, mass: Number, time: Number) -> Chain:
        """Return the chain in other units of time and of mass, which for a rigid device is its own."""
        damping, stiffness, square = time / mass, time * time / mass, time * time
        links = tuple(
            Link(m / mass, k * stiffness, c * damping, swing2 * square, decay * time)
            for m, k, c, swing2, decay in self.links
        )
        held = None if self.held is None else self.held * damping
        return Chain(self.motor / mass if links else 1, self.damping * damping, links, held, self.sensed)


def chain(device: Device, ops: Arithmetic) -> Chain:
    """Return the masses and springs of a device."""
    load = None if device.structure is None else device.structure.load
    of = linked(device.mass, device.damping, device.modes, load, ops)
    return of._replace(sensed=HANDLE) if device.at_handle else of


def linked(
    mass: Number, damping: Number, modes: Sequence[Structure], load: LeastOperator | None, ops: Arithmetic
) -> Chain:
    """Return the chain of some springs; the mass is that of all without the load."""
    motor = reduce(lambda left, mode: left - mode.handle_mass, modes, mass)
    links, ahead = list[Link](), motor
    for k, mode in enumerate(modes):
        behind = reduce(add, (each.handle_mass for each in modes[k:]))
        reduced = ahead * behind / mass
        if mode.stiffness is not None:
            stiffness, swing2 = mode.stiffness, mode.stiffness / reduced
            decay = 2 * mode.damping_ratio * ops.sqrt(swing2)
        else:
            swing = 2 * ops.pi * mode.frequency_hz
            swing2, decay = swing * swing, 2 * mode.damping_ratio * swing
            stiffness = reduced * swing2
        links.append(Link(mode.handle_mass, stiffness, reduced * decay, swing2, decay))
        ahead = ahead + mode.handle_mass
    if load is None or not links:
        return Chain(motor, damping, tuple(links))
    links[-1] = links[-1]._replace(mass=links[-1].mass + load.mass)
    return Chain(motor, damping, tuple(links), load.damping)


def forces(of: Chain) -> Rates:
    """Return the force on each mass that springs and dampers of the chain exert, by the name of its velocity."""
    motor, handle = of.velocities[0], of.velocities[-1]
    found: Rates = {name: {} for name in of.velocities}
    found[motor] = {motor: -of.damping}
    if of.held is not None:
        found[handle] = combined((found[handle], 1), ({handle: of.held}, -1))
    for link, bend, ahead, behind in zip(of.links, of.bends, of.velocities, of.velocities[1:], strict=False):
        pulled: Combination = {bend: link.stiffness, behind: link.viscosity, ahead: -link.viscosity}
        found[ahead] = combined((found[ahead], 1), (pulled, 1))
        found[behind] = combined((found[behind], 1), (pulled, -1))
    return found


def motion(of: Chain, one: Number) -> Rates:
    """Return the rates of positions and bends; `one` is 1 in the arithmetic of the chain."""
    found: Rates = {POSITION: {of.sensed: one}}
    for bend, ahead, behind in zip(of.bends, of.velocities, of.velocities[1:], strict=False):
        found[bend] = {ahead: -one, behind: one}
    return found


def combined(*parts: tuple[Combination, Number]) -> Combination:
    """Return the sum of rows times factors. Those of 1 and -1 round nothing."""
    found: Combination = {}
    for row, factor in parts:
        for name, share in row.items():
            plain = type(factor) is int and abs(factor) == 1
            more = (share if factor == 1 else -share) if plain else times(share, factor)
            found[name] = add(found.get(name, 0), more)
    return found
