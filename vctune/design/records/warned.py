"""Warnings about a design."""

from __future__ import annotations

from collections.abc import Iterator
from math import degrees, inf, pi
from typing import Any

from vctune.design.judging.judge import Judgement, Status
from vctune.design.records.felt import first_command
from vctune.design.variables import touched
from vctune.document.text.errors import Note
from vctune.model.gains import series_coupling
from vctune.model.problem import Problem
from vctune.model.rest import greatest_at_rest, stiffness_read
from vctune.model.servo import lightest_mass

LOUDEST, LEAST_PHASE = 10.0, 10.0  # Peak of |S| and phase margin, degrees, beyond which a loop hardly holds


def at_greatest_rest(problem: Problem, judgement: Judgement, key: str) -> bool:
    """Return whether the demand of rest limits a design, and not a bound of the file."""
    stiff = key in ("coupling.stiffness", "gains.position")
    greatest = greatest_at_rest(problem.device) if problem.stability.rest and stiff else None
    return greatest is not None and stiffness_read(judgement.gains, judgement.coupling) == greatest


def warnings(problem: Problem, judgement: Judgement) -> list[Note]:
    """Return warnings about a design."""
    return [Note(code, said) for code, said in _warned(problem, judgement)]


def _warned(problem: Problem, judgement: Judgement) -> Iterator[tuple[Any, str]]:
    for key, side in touched(problem, judgement.gains, judgement.coupling):
        of_spring = key == "coupling.damping" and problem.device.kind.inverse and problem.bounds.damping.min == 0
        at_rest = side == "upper" and at_greatest_rest(problem, judgement, key)
        at_rest |= key == "coupling.mass" and side == "lower" and lightest_mass(problem.device, 0.0) > 0
        if not at_rest and not ((key in ("gains.position", "coupling.drag") or of_spring) and side == "lower"):
            yield "warn-bound", f"{key} is on its {side} bound; the bound, not the device, limits the design there"
    band, demand = problem.stability.band, problem.stability.safety_factor
    # only Llewellyn's claim has a band, whose edge does not matter if a claim in hands covers every frequency
    edged = problem.hands_met is None and problem.device.kind.banded
    if edged and demand <= judgement.min_ratio < demand * 1.001:
        for side, edge in (("lower", band.min), ("upper", band.max)):
            if judgement.worst == edge and 0 < edge < problem.nyquist:
                yield (
                    "warn-band-edge",
                    f"the {side} edge of the stability band, {edge / (2 * pi):.4g} Hz, limits the design: "
                    "outside the band a passive hand or environment can make it oscillate",
                )
    servo = problem.device.servo
    if servo is not None and servo.max_acceleration is not None:
        _, acceleration = first_command(problem.device, series_coupling(judgement.coupling))
        if acceleration > servo.max_acceleration:
            units = problem.units
            yield (
                "warn-acceleration",
                f"1 {units.force} from rest commands {acceleration:.3g} {units.acceleration} in its first sample, more "
                f"than device.servo.max_acceleration = {servo.max_acceleration:g}; more coupling.mass commands less",
            )
    yield from _hardly_holds(judgement)
    if judgement.limp:
        yield "warn-limp", "its K_p holds no static force: a steady push moves the handle on, also into a wall"
    if judgement.idle:
        yield (
            "warn-idle",
            f"the design hardly uses its velocity loop: |1 - G_he| is {judgement.transparency.tracking:.3g}, "
            "and 1 means no loop at all; a constraint that can be relaxed, a wider bound or a faster device may help",
        )


def _hardly_holds(judgement: Judgement) -> Iterator[tuple[Any, str]]:
    """Yield that a small change of the device would make the loop that a design closes unstable."""
    if judgement.closed_loop is not None:
        loop, peak, phase = "the loop of the wall", judgement.closed_loop.peak, judgement.closed_loop.phase
    elif judgement.gains.closed and judgement.status is Status.CERTIFIED:
        loop, peak, phase = "the velocity loop", judgement.peak_sensitivity, judgement.loop_margins.phase
    else:
        return
    phase = abs(degrees(phase))
    if peak > LOUDEST or phase < LEAST_PHASE:
        margin = "" if phase == inf else f" and its phase margin is {phase:.3g} degrees"
        yield (
            "warn-margin",
            f"{loop} hardly holds: its peak |S| is {peak:.3g}{margin}; a slightly different device may be unstable",
        )
