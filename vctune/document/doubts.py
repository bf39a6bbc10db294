"""Find values that are valid but probably not intended: numbers in another unit, names that a system reserves."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import inf

from vctune.document.reading import ProblemFile
from vctune.document.schema.validation import dotted
from vctune.document.text.errors import Note
from vctune.document.text.hints import LONGEST_SAMPLE, seconds_meant
from vctune.document.text.output_files import RESERVED, folder_name
from vctune.model.experiment import Environment
from vctune.model.hands import Hand
from vctune.model.problem import Problem

# Stiffness of a hand, N/m or N m/rad, from which vctune asks whether it is in SI units: ten times the stiffness of a
# stiff fixture, and a thousand times the stiffness of a firm grip
STIFFEST = 1e6
GRAMS = 50.0, 5000.0  # Masses of haptic devices, and of hands, in grams, from which vctune asks whether they are in kg
FIRM = 1e3  # Stiffness of a firm grip, N/m


def file_doubts(file: ProblemFile, source: str | None = None) -> Iterator[Note]:
    """Yield notes on values that are probably not intended, with the place of the key if a note is about one key."""
    for note in doubts(file.problem):
        if not note.path:
            yield note
            continue
        place = f"{source or file.source}:{file.line_of(note.path)}: {dotted(note.path)}"
        yield replace(note, text=f"{place}: {note.text}", path=())


def doubts(problem: Problem) -> Iterator[Note]:
    """Yield values that are probably not intended."""
    T, name = problem.device.sample_time, problem.name
    if T >= LONGEST_SAMPLE:
        yield Note("warn-sample-time", f"device.sample_time is {T:g} s; {seconds_meant(T)}")
    if problem.device.divided:
        text = f"the latency of {1e3 * problem.device.stated_delay:g} ms is divided into delay and lag in any way"
        known = "a bandwidth_hz that is known gives a better design"
        yield Note("warn-latency", f"device.servo: {text}, with a lag of half a sample at least: {known}")
    met, nothing = problem.hands_met, Hand(0.0, 0.0, 0.0)
    greatest = nothing if met is None else met.held.high
    tool = nothing if met is None or met.tool is None else met.tool.high
    masses = ("device.mass", problem.device.mass, GRAMS[1]), ("operator.mass.max", greatest.mass, inf)
    for key, mass, most in (*masses, ("tool.mass", tool.mass, inf)):
        if problem.units.mass == "kg" and GRAMS[0] <= mass <= most:
            yield Note("warn-mass", f"{key} is {mass:g} kg; is it in grams? Then write {mass / 1e3:g}")
    if greatest.stiffness >= STIFFEST:
        said = f"{greatest.stiffness:g} {problem.units.stiffness}; is it in {problem.units.stiffness}?"
        yield Note("warn-stiffness", f"operator.stiffness.max is {said} A firm grip has {FIRM:g} N/m")
    if problem.device.servo is not None and problem.worlds is not None:
        rendered, touched = problem.worlds.high.stiffness, greatest.stiffness
        if touched < rendered < inf:
            said = f"{rendered:g} {problem.units.stiffness} is of springs that the arm renders, which are virtual; "
            told = f"write operator.stiffness.max = {rendered:g}, and [environment] as the arm renders it"
            text = f"{said}if it is a real table or fixture that the tool touches, {told}"
            yield Note("warn-table", text, ("environment", "stiffness"))
    for number, experiment in enumerate(problem.experiments):
        for what, key in [*_outside(experiment.environment, problem)][:1]:
            text = f"experiment {experiment.name!r} renders {what}, which is not in [environment]: "
            path = ("experiment", number, "environment", key)
            yield Note("warn-environment", f"{text}no claim covers what it shows", path)
    if RESERVED.match(name.strip().lstrip(".")):
        text = f"name {name!r} is that of a device on Windows; the folder is {folder_name(name)}: better choose another"
        yield Note("warn-name", text)


def _outside(environment: Environment, problem: Problem) -> Iterator[tuple[str, str]]:
    """Yield phrases about what takes an environment out of a problem's box, each with its key."""
    worlds, units, rule = problem.worlds, problem.units, environment.rule
    if worlds is None:
        if problem.rigid and not environment.rigid:
            yield "an environment that moves", "stiffness"
        return
    if environment.wall and not worlds.walls:
        yield "a wall that comes and goes", "wall"
    if environment.wall and worlds.walls and environment.damping > 0:
        yield "a wall with a damper, which acts on one side,", "damping"
    if environment.late:
        yield f"a force {environment.late} samples late", "late"
    # a spring by backward Euler behaves as one by the trapezoidal rule does, and so does a damper alone
    if (environment.mass > 0 and rule != "trapezoid") or (environment.stiffness > 0 and rule == "explicit"):
        yield f"{'a mass' if environment.mass > 0 else 'a spring'} by {_RULES[rule]}", "rule"
    for name, unit in (("mass", units.mass), ("damping", units.damping), ("stiffness", units.stiffness)):
        value = getattr(environment, name)
        if not getattr(worlds.low, name) <= value <= getattr(worlds.high, name):
            yield f"a {name} of {value:g} {unit}", name


_RULES = {"backward": "backward Euler", "explicit": "explicit Euler"}
