"""Record what the hand feels of a design: free motion, the stiffest wall, and the encoder's counts."""

from __future__ import annotations

from math import inf, pi

import numpy as np

from vctune.analysis.feel import FREE_HZ, NO_LOOP, WALL_HZ, felt_impedance
from vctune.design.verdict.judge import Judgement
from vctune.document.records.in_hand_json import FreeRecord, InHandRecord, WallRecord
from vctune.model.gains import AnyCoupling, Gains, SpringDamper
from vctune.model.problem import Problem


def in_hand_record(problem: Problem, judgement: Judgement) -> InHandRecord:
    """Return what the hand feels of a design."""
    gains, coupling, device = judgement.gains, judgement.coupling, problem.device
    looped = device.kind.own_loop and not device.kind.inverse
    soft = gains.position < problem.transparency.reference_impedance * problem.transparency.band.min
    found: dict[str, object] = {"limp": True} if looped and gains.closed and soft else {}
    if problem.nyquist > 2 * pi * FREE_HZ[0]:
        found["free"] = _free(problem, gains, coupling)
    stiffest = problem.worlds.high.stiffness if problem.worlds is not None and problem.worlds.walls else inf
    if stiffest < inf and problem.nyquist > 2 * pi * WALL_HZ:
        felt = -2 * pi * WALL_HZ * _felt(problem, gains, coupling, WALL_HZ, stiffest).imag
        found["wall"] = WallRecord(hz=WALL_HZ, felt=felt, stated=stiffest)
    if device.resolution is not None:
        found["count"] = device.resolution * _stiffness_of_a_count(gains, coupling, device.sample_time)
    return InHandRecord.model_validate(found)


def _felt(problem: Problem, gains: Gains, coupling: AnyCoupling, hz: float, stiffness: float = 0.0) -> complex:
    """Return the impedance that the hand feels before a virtual spring, N s/m."""
    omega = np.array([2 * pi * hz])
    return complex(felt_impedance(problem.device.bare, gains, coupling, omega, stiffness / (1j * omega))[0])


def _free(problem: Problem, gains: Gains, coupling: AnyCoupling) -> FreeRecord:
    hz = FREE_HZ[0]
    felt = _felt(problem, gains, coupling, hz)
    found = {"hz": hz, "mass": felt.imag / (2 * pi * hz), "damping": felt.real}
    if problem.device.servo is None:
        bare = _felt(problem, *NO_LOOP, hz)
        found |= {"bare_mass": bare.imag / (2 * pi * hz), "bare_damping": bare.real}
    return FreeRecord(**found)


def _stiffness_of_a_count(gains: Gains, coupling: AnyCoupling, sample_time: float) -> float:
    """Return the force on the motor that one step of the position causes in its first sample, N/m, without filters."""
    if isinstance(coupling, SpringDamper):
        return (gains.velocity + coupling.damping) / sample_time + coupling.stiffness
    return gains.velocity / sample_time
