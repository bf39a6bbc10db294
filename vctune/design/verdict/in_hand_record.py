"""Record what the hand feels of a design: free motion, the stiffest wall, and the encoder's counts."""

from __future__ import annotations

from math import inf, pi

import numpy as np

from vctune.analysis.feel import FREE_HZ, NO_LOOP, WALL_HZ, felt_impedance
from vctune.design.verdict.judge import Judgement
from vctune.document.records.felt_json import InHandRecord
from vctune.model.gains import AnyCoupling, Gains, SpringDamper
from vctune.model.problem import Problem


def in_hand_record(problem: Problem, judgement: Judgement) -> InHandRecord:
    """Return what the hand feels of a design."""
    gains, coupling, device, objective = judgement.gains, judgement.coupling, problem.device, problem.transparency
    found: dict[str, bool | float] = {}
    if device.kind.own_loop and not device.kind.inverse and gains.closed:
        found["limp"] = gains.position < objective.reference_impedance * objective.band.min
    if problem.nyquist > (omega := 2 * pi * FREE_HZ[0]):
        free = _felt(problem, gains, coupling, omega)
        found |= {"mass_1hz": free.imag / omega, "damping_1hz": free.real}
        if device.servo is None:
            found["bare_mass_1hz"] = _felt(problem, *NO_LOOP, omega).imag / omega
    wall = problem.worlds.high.stiffness if problem.worlds is not None and problem.worlds.walls else inf
    if wall < inf and problem.nyquist > (omega := 2 * pi * WALL_HZ):
        found |= {"felt_wall_10hz": -omega * _felt(problem, gains, coupling, omega, wall).imag, "wall": wall}
    if device.velocity is not None and device.velocity.resolution is not None:
        found["count"] = device.velocity.resolution * _stiffness_of_a_count(gains, coupling, device.sample_time)
    return InHandRecord.model_validate(found)


def _felt(problem: Problem, gains: Gains, coupling: AnyCoupling, omega: float, wall: float = 0.0) -> complex:
    """Return the impedance that the hand feels in front of a virtual spring, N s/m."""
    at = np.array([omega])
    return complex(felt_impedance(problem.device.bare, gains, coupling, at, wall / (1j * at))[0])


def _stiffness_of_a_count(gains: Gains, coupling: AnyCoupling, sample_time: float) -> float:
    """Return the force on the motor that a step of the position causes in its sample, without filters, N/m."""
    if isinstance(coupling, SpringDamper):
        return (gains.velocity + coupling.damping) / sample_time + coupling.stiffness
    return gains.velocity / sample_time
