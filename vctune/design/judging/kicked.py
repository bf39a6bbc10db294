"""Whether a design rings and buzzes: in double precision and simulated, on the devices and hands of a problem."""

from __future__ import annotations

import numpy as np

from vctune.design.prepared import Posed
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.hands import Hand, Hands
from vctune.model.problem import Problem
from vctune.model.worlds import World
from vctune.simulation.kicks import Buzz, bears_more_kicks, buzz
from vctune.simulation.rings import Ringing, ringing
from vctune.simulation.worlds import worlds_of

MOST_DEVICES = 32  # Greatest number of devices of a box, beside the nominal one and that of the least ratio


def hands_at_rest(problem: Problem) -> Hands:
    """Return the hands in which a device is kicked: those of [operator], or the least operator of a problem that asks
    for no box of hands."""
    if problem.stability.criterion != "passive":
        return problem.hands
    least = problem.device.operator
    alone = Hand(0.0, 0.0, 0.0) if least is None else Hand(least.mass, least.damping, 0.0)
    return Hands(alone, alone)


def ringing_of(posed: Posed, tightest: Device, gains: Gains, coupling: AnyCoupling) -> Ringing | None:
    """Return the least damped oscillation on some devices of a box, among them that of the least ratio."""
    problem, cases = posed.problem, [case.device for case in posed.hand_cases or posed.cases]
    some = [cases[k] for k in sorted({round(k) for k in np.linspace(0, len(cases) - 1, MOST_DEVICES)})]
    devices = tuple(dict.fromkeys(device.undisturbed.bare for device in (problem.device, tightest, *some)))
    worlds = tuple(worlds_of(problem.worlds, rigid=problem.rigid))
    return ringing(devices, hands_at_rest(problem), gains, coupling, worlds)


def buzz_of(problem: Problem, rings: Ringing | None, gains: Gains, coupling: AnyCoupling) -> Buzz | None:
    """Return what kicks do to the device that rings most, or to the nominal one if none rings."""
    return buzz(*_kicked(problem, rings, gains, coupling))


def stays_calm(problem: Problem, rings: Ringing | None, gains: Gains, coupling: AnyCoupling) -> bool:
    """Return whether neither the kicks of `buzz_of` nor many more keep that device moving."""
    kicks = buzz_of(problem, rings, gains, coupling)
    if kicks is None:
        return True
    return kicks.moving == 0 and bears_more_kicks(*_kicked(problem, rings, gains, coupling))


def _kicked(
    problem: Problem, rings: Ringing | None, gains: Gains, coupling: AnyCoupling
) -> tuple[Device, Hands, Gains, AnyCoupling, tuple[World, ...], float]:
    """Return the device, the hands, the law, the environments and the time constant of kicks."""
    device = problem.device.undisturbed.bare if rings is None else rings.device
    time_constant = 0.0 if rings is None else rings.time_constant
    worlds = tuple(worlds_of(problem.worlds, rigid=problem.rigid))
    return device, hands_at_rest(problem), gains, coupling, worlds, time_constant
