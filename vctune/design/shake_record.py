"""Record whether a design shakes: how it rings, and whether kicks make it buzz."""

from __future__ import annotations

from math import inf, pi

import numpy as np

from vctune.design.judging.judge import Judgement
from vctune.design.rest_record import hands_at_rest
from vctune.document.records.shake_json import BuzzRecord, RingingRecord, ShakeColumns
from vctune.document.text.errors import Note
from vctune.model.numbers.units import Units
from vctune.model.problem import Problem
from vctune.model.rest import read_in_steps
from vctune.model.worlds import World
from vctune.running import OutOfTimeError
from vctune.simulation.kicks import Buzz, buzz
from vctune.simulation.rings import Ringing, ringing
from vctune.simulation.worlds import RIGID, worlds_of

SHAKES = "whether it shakes"  # Name of a part that a time limit may leave out
MOST_DEVICES = 32  # Greatest number of devices of a box, beside the nominal one and that of the least ratio


def shaken(problem: Problem, judgement: Judgement) -> tuple[RingingRecord | None, BuzzRecord | None]:
    """Return how a design rings, and whether it buzzes; None where nothing oscillates or grows, and where neither
    friction nor a step of a reading is stated."""
    rings, buzzes = _ringing(problem, judgement), None
    if rings is not None and rings.damping_ratio <= 0:
        return None, None
    if judgement.status.value != "violated":
        buzzes = _buzz(problem, judgement, rings)
    return _ringing_record(rings, problem.units), _buzz_record(buzzes, problem)


def shaken_in_time(problem: Problem, judgement: Judgement) -> tuple[RingingRecord | None, BuzzRecord | None]:
    """Return what `shaken` does, and nothing if the time is over."""
    try:
        return shaken(problem, judgement)
    except OutOfTimeError:
        return None, None


def notes(rings: RingingRecord | None, buzzes: BuzzRecord | None, units: Units) -> list[Note]:
    """Return the warnings about a design that shakes."""
    found = list[Note]()
    if rings is not None and rings.long:
        found.append(Note("warn-rings", f"it rings for more than a second: {rings.told(units)}"))
    if buzzes is not None and buzzes.moving:
        found.append(Note("warn-buzzes", f"it buzzes, as simulated: {buzzes.told(units)}"))
    return found


def in_few_words(rings: RingingRecord | None, buzzes: BuzzRecord | None) -> list[str]:
    """Return how a design rings and buzzes, in a few words each."""
    said = [] if rings is None else [rings.briefly]
    return [*said, *([f"buzzes after {buzzes.moving} of {buzzes.kicks} kicks"] if buzzes and buzzes.moving else [])]


def _ringing(problem: Problem, judgement: Judgement) -> Ringing | None:
    cases = [case.device for case in judgement.posed.hand_cases or judgement.posed.cases]
    some = [cases[k] for k in sorted({round(k) for k in np.linspace(0, len(cases) - 1, MOST_DEVICES)})]
    each = [problem.device, judgement.tightest, *some]
    devices = tuple(dict.fromkeys(device.undisturbed.bare for device in each))
    worlds = tuple(worlds_of(problem.worlds, rigid=problem.rigid))
    return ringing(devices, hands_at_rest(problem), judgement.gains, judgement.coupling, worlds)


def _buzz(problem: Problem, judgement: Judgement, rings: Ringing | None) -> Buzz | None:
    """Return what kicks do to the device that rings most, or to the nominal one if none rings."""
    device, slow = (problem.device.undisturbed.bare, 0.0) if rings is None else (rings.device, rings.time_constant)
    worlds = tuple(worlds_of(problem.worlds, rigid=problem.rigid))
    return buzz(device, hands_at_rest(problem), judgement.gains, judgement.coupling, worlds, slow)


def _ringing_record(found: Ringing | None, units: Units) -> RingingRecord | None:
    if found is None or found.time_constant == inf:
        return None
    return RingingRecord(
        damping_ratio=found.damping_ratio,
        frequency_hz=found.frequency / (2 * pi),
        time_constant_s=found.time_constant,
        hand=found.hand,
        world=_in_words(found.world, units),
    )


def _buzz_record(found: Buzz | None, problem: Problem) -> BuzzRecord | None:
    if found is None or found.hand is None or found.world is None:
        return None if found is None else BuzzRecord(kicks=found.kicks, moving=0)
    step, force = read_in_steps(problem.device), problem.device.commanded == "force"
    friction = problem.device.friction
    return BuzzRecord(
        kicks=found.kicks,
        moving=found.moving,
        amplitude_m=found.amplitude,
        frequency_hz=found.frequency,
        hand=found.hand,
        world=_in_words(found.world, problem.units),
        **({"force_N": found.force} if force else {}),
        **({"step_m": step} if step is not None else {}),
        **({"friction_N": friction} if friction else {}),
    )


def _in_words(world: World, units: Units) -> str:
    return "a rigid world" if world == RIGID else world.in_words(units)


def shake_columns(problem: Problem, judgement: Judgement) -> ShakeColumns:
    """Return what a sweep states of whether a design shakes."""
    rings, buzzes = shaken(problem, judgement)
    found = dict[str, float | None]()
    if rings is not None:
        found |= {"damping_ratio": rings.damping_ratio, "ringing_hz": rings.frequency_hz}
        found["ringing_s"] = rings.time_constant_s
    if buzzes is not None:
        found |= {"kicks_moving": buzzes.moving / buzzes.kicks, "buzz_m": buzzes.amplitude_m or 0.0}
        found |= {"buzz_hz": buzzes.frequency_hz}
        found |= {"buzz_N": buzzes.force_N or 0.0} if problem.device.commanded == "force" else {}
    return ShakeColumns(**found)
