"""Record measurements and commands of the simulated controller in every experiment, for replay."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf
from typing import Any

import numpy as np

from vctune.document.reading import ProblemFile
from vctune.firmware.c_source import COMMANDED, rendered_template, started_with, variables
from vctune.firmware.firmware import Firmware, certified, comment
from vctune.firmware.preamble import not_proved, statement
from vctune.model.device import Commanded
from vctune.model.experiment import Environment, Experiment, MovingHand, Sensors, usual_share
from vctune.model.numbers.arithmetic import Floats
from vctune.model.numbers.units import Units
from vctune.model.problem import Problem
from vctune.simulation.controller import (
    FLOATS,
    Measurement,
    at_rest,
    control,
    controller_of,
    encoded,
    rendering,
)
from vctune.simulation.run import run
from vctune.simulation.scene import designed_scene, equilibrium

ALLOWED_ULP = 0  # Permitted difference in double precision, in units in the last place


def replay_files(firmware: Firmware, simulated: list[Replay]) -> dict[str, str]:
    """Return the texts of vectors.csv, replay.c and Makefile."""
    given: dict[str, Any] = {
        **variables(firmware),
        "experiments": [experiment_line(one, started_with(firmware)) for one in simulated],
        "ulp": ALLOWED_ULP,
        "hash_top": commented(statement(firmware)),
    }
    if firmware.precision == "single":
        measured = greatest_difference(firmware, simulated)
        given |= {"measured": f"{measured:.3g}", "allowed": f"{2 * measured:.3g}"}
    written = {name: rendered_template(name, given) for name in ("replay.c", "Makefile")}
    doubt = "" if certified(firmware) else commented([not_proved(firmware)]) + "\n"
    return {"vectors.csv": doubt + vectors_text(simulated, firmware.units, firmware.controller.command), **written}


def commented(texts: list[str]) -> str:
    """Return texts as lines that begin with #."""
    return "\n".join(f"# {line}".rstrip() for text in texts for line in comment(text) or [""])


# Stiffness of the hand in the default experiments, N/m, before `default_experiments` scales it
USUAL_STIFFNESS = 1000.0


@dataclass(frozen=True, slots=True)
class Replay:
    """The measurements and commands of an experiment with n samples, in SI units."""

    experiment: Experiment  # description of the experiment
    position: float  # start position of the motor as the encoder reads it, and start value of x_e, m
    reference: float
    force: float  # force of the hand at the start, N
    measured: Floats  # position [m] as the encoder reads it, velocity [m/s] and force [N] at each sample, shape (n, 3)
    command: Floats  # commands u, N; for a servo m/s or m; shape (n,)


def replays(file: ProblemFile, replays: Firmware, progress: Callable[[str], None] = lambda stage: None) -> list[Replay]:
    """Simulate a design in those experiments of its problem that the C code can render."""
    stated = file.problem.experiments
    experiments = [sample for sample in stated if sample.environment.built_in] or default_experiments(file.problem)
    return [_replay(replays, experiment, progress) for experiment in experiments]


def default_experiments(problem: Problem) -> tuple[Experiment, ...]:
    """Return the default experiments for a problem without experiments: a spring, and a wall that saturates the
    motor."""
    device, stiffest = problem.device, problem.hands.high.stiffness
    share = usual_share(device.mass, device.units) if device.kind.own_loop else stiffest / USUAL_STIFFNESS or 1.0
    hand = MovingHand("reciprocate", 0.0, 0.01, 0.01, 1, 0.0, 2.0 * share, USUAL_STIFFNESS * share)
    limit = 3.0 * share if device.commanded == "force" else None
    spring = Environment(0.0, 0.0, 200.0 * share, 0.0, False, "backward")
    wall = Environment(0.1 * share, 5.0 * share, 20000.0 * share, 0.005, True, "backward")
    ideal_sensors = Sensors(0.0, 0.0, 0)
    return (
        Experiment("spring", spring, hand, None, ideal_sensors, None, None),
        Experiment("wall", wall, replace(hand, mass=0.1 * share), None, ideal_sensors, limit, None),
    )


def _replay(replays: Firmware, experiment: Experiment, progress: Callable[[str], None]) -> Replay:
    """Simulate an experiment with the design before rounding, and return the measurements and the commands."""
    scene = designed_scene(replays.device, replays.gains, replays.coupling, experiment)
    traces = run(scene, lambda share: progress(f"{experiment.name} {share:.0%}"))
    begin = equilibrium(scene)
    on_motor = not replays.device.at_handle
    position = traces.motor_position if on_motor and traces.motor_position is not None else traces.position
    velocity = traces.motor_velocity if on_motor and traces.motor_velocity is not None else traces.velocity
    c = controller_of(scene.law)
    read = [encoded(c, float(sample), FLOATS) for sample in position]
    measured = np.column_stack([read, velocity, traces.sensed])
    position = encoded(c, begin.sensed(replays.device), FLOATS)
    return Replay(experiment, position, begin.reference, begin.hand, measured, traces.motor)


def vectors_text(replays: list[Replay], units: Units, commanded: Commanded) -> str:
    """Return the text of vectors.csv, with every number in its shortest exact decimals."""
    measured = {
        "position": units.position,
        "velocity": units.speed,
        units.force_name: units.force,
        "command": units.of(COMMANDED[commanded]),
    }
    of = [f"{name}_{unit.lower().replace('/', '_per_').replace(' ', '_')}" for name, unit in measured.items()]
    lines = [",".join(["experiment", *of])]
    for number, replay in enumerate(replays):
        rows = np.column_stack([replay.measured, replay.command]).tolist()
        lines += [f"{number},{','.join(map(repr, row))}" for row in rows]
    return "\n".join(lines) + "\n"


def greatest_difference(firmware: Firmware, replays: list[Replay]) -> float:
    """Return the greatest difference between a firmware's commands and the simulated commands, in the command's
    unit."""
    return max(float(np.abs(commands(firmware, replay) - replay.command).max()) for replay in replays)


def commands(firmware: Firmware, replay: Replay) -> Floats:
    """Return the commands that a firmware computes from an experiment's measurements in its own precision, shape
    (n,)."""
    number = float if firmware.precision == "double" else np.float32
    stated, limit = replay.experiment.environment, replay.experiment.limit
    numbers: dict[str, Any] = {name: number(getattr(stated, name)) for name in ("mass", "damping", "stiffness", "zero")}
    T, most = firmware.controller.sample_time, number(inf if limit is None else limit)
    c = replace(firmware.controller, environment=rendering(replace(stated, **numbers), T), limit=most)
    c = replace(c, own_zero=number(replay.position))
    state, given = at_rest(c, *map(number, (replay.position, replay.reference, replay.force))), []
    for row in replay.measured.tolist():
        state, command = control(c, state, Measurement(*map(number, row)), FLOATS)
        given.append(float(command.given))
    return np.array(given)


def experiment_line(replay: Replay, started: list[str]) -> str:
    """Return an experiment as an element of the table in replay.c."""
    rendered = replay.experiment.environment
    numbers = [rendered.mass, rendered.damping, rendered.stiffness, rendered.zero]
    flags = ["true" if flag else "false" for flag in (rendered.wall, rendered.rule == "trapezoid")]
    limit = replay.experiment.limit or 0.0
    begin = [limit if name == "limit" else getattr(replay, name) for name in started]
    fields = [f'"{replay.experiment.name}"', *map(repr, numbers), *flags, *map(repr, begin), str(len(replay.command))]
    return f"{{{', '.join(fields)}}},"
