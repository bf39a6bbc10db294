"""Provide what a hand feels of a design as a function."""

from __future__ import annotations

from math import inf, pi
from typing import Any

import numpy as np

from vctune.analysis.felt_impedance import impedance_felt
from vctune.analysis.sampled_loop import Complex
from vctune.design.result import Solved
from vctune.document.text.errors import InputError, Mistake
from vctune.model.worlds import World


def felt_impedance(
    solved: Solved, hertz: Any, *, mass: float = 0.0, damping: float = 0.0, stiffness: float = 0.0
) -> Complex:
    """Return the impedance that a hand feels at the handle, before an environment that the device renders.

    It is the force of the hand over the velocity of the handle at the frequency of the force, exact in the sampled loop
    with all parts of the device, in double precision, not proved. `Loop.Z_seen` is the other view, from the environment
    towards device and hand.

    Parameters
    ----------
    solved : Solved
        A solved problem, with a design.
    hertz : array_like
        Frequencies f > 0, Hz, any shape.
    mass, damping, stiffness : float
        The environment's, SI units, as the trapezoidal rule renders them; without any it is nothing. A stiffness of inf
        is a rigid environment.

    Returns
    -------
    ndarray of complex
        Impedances, N s/m (N m s/rad of a rotary device), with the shape of `hertz`; inf where a servo does not move.

    Raises
    ------
    InputError
        If there is no design, or a number is out of range.
    """
    if solved.judgement is None:
        raise InputError.of("felt_impedance", "bad-option", "there is no design to feel; see solved.reason")
    omega = 2 * pi * np.asarray(hertz, float)
    numbers = {"mass": mass, "damping": damping, "stiffness": stiffness}
    faults = [Mistake("bad-option", key, "must be 0 or more") for key, number in numbers.items() if not number >= 0]
    faults += [Mistake("bad-option", key, "must be finite") for key in ("mass", "damping") if numbers[key] == inf]
    if not (np.isfinite(omega) & (omega > 0)).all():
        faults.append(Mistake("bad-option", "hertz", "must be frequencies above 0"))
    if faults:
        raise InputError("felt_impedance", faults)
    world = None if stiffness == inf else World(mass, damping, stiffness)
    judgement = solved.judgement
    return impedance_felt(solved.problem.device, judgement.gains, judgement.coupling, omega, world)
