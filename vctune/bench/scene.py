"""What leaving out is worth: the size and the time of the NLP and of the simulation's step, part by part."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, replace
from statistics import median
from typing import Any

import numpy as np

from vctune.bench.benchmark import Measured, Size, Tick
from vctune.bench.dense import Dense
from vctune.bench.problems import DOCUMENTS, posed
from vctune.bench.scenes import EXPERIMENT, scene_of
from vctune.bench.sizes import NlpSize, nlp_size, step_size
from vctune.bench.timing import paired
from vctune.design.ipopt import posed as posed_numbers
from vctune.design.scan import scan
from vctune.design.shape import Shape, WorkingSet, places, shape_of
from vctune.design.units import dimensionless
from vctune.design.variables import coordinates, point
from vctune.document.problem import Problem
from vctune.model.quantities import Device
from vctune.report.benchmarks import Panel, Series
from vctune.simulation.run import run
from vctune.simulation.scene import Scene
from vctune.simulation.step import DEFAULT, build

EVERYTHING = "everything on"
NLP, STEP = "NLP", "simulation step"
DELAY = 5e-4
EVALUATIONS = 50


@dataclass(frozen=True, slots=True)
class Row:
    """One build.

    Attributes
    ----------
    build : "NLP" or "simulation step"
    without : the part that is absent, or "everything on"
    variables, constraints : of the NLP; of the step its states, and none
    operations : instructions of CasADi's machine for objective, demands and their derivatives; for one sample
    seconds : median processor time of `EVALUATIONS` evaluations of all that, or of a simulated run
    ratio : median over pairs of this time and that with everything on
    same_as_without : whether it equals, in all three sizes, a build that was never told of the part
    """

    build: str
    without: str
    variables: int
    constraints: int
    operations: int
    seconds: float
    ratio: float
    same_as_without: bool


def measure(size: Size, tick: Tick) -> Measured:
    """Build NLP and step with everything on and with each part absent."""
    pairs = 3 if size.quick else 15
    rows = [*_nlp_rows(pairs, tick), *_step_rows(pairs, tick)]
    return Measured(
        "What leaving out is worth",
        "Operations of the build without a part against those with everything on; both NLP (objective, demands and "
        "their derivatives) and simulation step.",
        {"scene": rows},
        facts(rows),
        panels(rows),
    )


def _document() -> dict[str, Any]:
    document = deepcopy(DOCUMENTS["friction-wheel"])
    document["device"] = {**document["device"], "delay": DELAY}
    document["coupling"] = {**document["coupling"], "drag": {"min": 0.0, "max": 10.0}}
    document["operator"] = {"damping": 0.5}
    document["uncertainty"] = {"mass": 0.1, "damping": 0.5, "delay": 0.2, "objective": "worst"}
    return document


def absent_in_nlp() -> dict[str, dict[str, Any]]:
    """Return problem documents with one part absent, by its name."""
    found = {}
    for name, table, key, value in (
        ("free K_p", "gains", "position", 0.0),
        ("free b_0", "coupling", "drag", 0.0),
        ("free m_c", "coupling", "mass", 0.3),
        ("delay", "device", "delay", 0.0),
    ):
        document = _document()
        document[table] = {**document[table], key: value}
        found[name] = document
    for term in ("admittance", "tracking", "coupling"):
        document = _document()
        document["transparency"] = {**document["transparency"], "weights": {term: 0.0}}
        found[f"{term} term"] = document
    for table in ("operator", "uncertainty"):
        found[table] = {key: value for key, value in _document().items() if key != table}
    document = _document()
    document["uncertainty"].pop("objective")
    found["worst error"] = document
    return found


ANY = Device(1.0, 0.0, 1.0, 0.0, "zoh")
FREQUENCIES = WorkingSet(
    ratio=places(ANY, (0.003, 0.03, 0.3)),
    sensitivity=places(ANY, (0.5, 1.0, 2.0)),
    moving=places(ANY, (1.2,)),
)
"""Dimensionless frequencies of the demands: three of each kind, and a peak of |S| that is followed. The size of an NLP
does not depend on their device."""


def _shape(problem: Problem, frequencies: WorkingSet = FREQUENCIES) -> Shape:
    scaled = dimensionless(problem)
    integrator = problem.bounds.position.max > 0
    return shape_of(scaled, coordinates(scaled, integrator=integrator), frequencies, 4, integrator=integrator)


def shapes_without(whole: Shape) -> dict[str, Shape]:
    """Return the shapes of NLPs that were never told of a part, made by hand."""

    def freed(index: int) -> tuple[tuple[int, bool], ...]:
        return tuple(pair for pair in whole.free if pair[0] != index)

    found = {
        "free K_p": replace(whole, free=freed(1), integrator=False),
        "free b_0": replace(whole, free=freed(4)),
        "free m_c": replace(whole, free=freed(3)),
        "delay": replace(whole, counted=5),
        "operator": replace(whole, held=False),
        "uncertainty": replace(whole, uncertain=False, counted=1),
        "worst error": replace(whole, counted=1),
    }
    for term in whole.terms:
        found[f"{term} term"] = replace(whole, terms=tuple(other for other in whole.terms if other != term))
    ratio, *_, peak = whole.slots
    found["followed peak of |S|"] = replace(whole, moving=0)
    found["demand on |S|"] = replace(whole, moving=0, slots=(ratio, 0, 0, peak))
    return found


def _nlp_rows(pairs: int, tick: Tick) -> list[Row]:
    whole = posed(EVERYTHING, _document())
    shape = _shape(whole)
    by_hand = shapes_without(shape)
    unfollowed = WorkingSet(ratio=FREQUENCIES.ratio, sensitivity=FREQUENCIES.sensitivity)
    builds = {name: (posed(name, document), FREQUENCIES) for name, document in absent_in_nlp().items()}
    builds["followed peak of |S|"] = (whole, unfollowed)
    builds["demand on |S|"] = (whole, WorkingSet(ratio=FREQUENCIES.ratio))
    rows = [_nlp_row(EVERYTHING, nlp_size(shape), paired(_nlp(whole), _nlp(whole), pairs), same=True)]
    for name, (problem, frequencies) in builds.items():
        tick(f"NLP without {name}")
        found = nlp_size(_shape(problem, frequencies))
        pace = paired(_nlp(whole), _nlp(problem, frequencies), pairs)
        rows.append(_nlp_row(name, found, pace, same=found == nlp_size(by_hand[name])))
    return rows


def _nlp(problem: Problem, frequencies: WorkingSet = FREQUENCIES) -> Callable[[], None]:
    """Return the work of evaluating an NLP with its derivatives, at the best start of a scan."""
    scaled, shape = dimensionless(problem), _shape(problem, frequencies)
    start = next(s for s in scan(scaled).starts if (s.gains.position > 0) == shape.integrator)
    free, values = coordinates(scaled, integrator=shape.integrator), point(start.gains, start.coupling)
    box = (np.array([c.low for c in free]), np.array([c.high for c in free]))
    numbers = posed_numbers(scaled, shape, free, values, box, frequencies, 0.0)
    given = Dense(problem, scaled, shape, free, values, numbers)
    return lambda: given.evaluated(EVALUATIONS)


def _nlp_row(name: str, found: NlpSize, pace: Any, *, same: bool) -> Row:
    return Row(NLP, name, found.variables, found.constraints, found.operations, pace.second, pace.ratio, same)


def absent_in_step() -> dict[str, Scene]:
    """Return scenes with one part absent, as a file leaves it out, by its name."""
    sensors, hand, there = EXPERIMENT["sensors"], EXPERIMENT["operator"], EXPERIMENT["environment"]

    def without(key: str, table: dict[str, Any] | None = None, *names: str) -> Scene:
        experiment = {name: value for name, value in EXPERIMENT.items() if name != key}
        if table is not None:
            experiment[key] = {name: value for name, value in table.items() if name not in names}
        return scene_of(experiment, delay=DELAY)

    measured = {**EXPERIMENT, "sensors": {**sensors, "velocity": "measured"}}
    measured["sensors"].pop("filter_hz")
    return {
        "friction": without("friction"),
        "quantised position": without("sensors", sensors, "position_resolution"),
        "filtered difference": scene_of(measured, delay=DELAY),
        "noise": without("sensors", sensors, "force_noise"),
        "saturation": without("actuator"),
        "mass of the hand": without("operator", {**hand, "mass": 0.0}),
        "wall": without("environment", {**there, "wall": False}),
        "environment": without("environment"),
        "delay": scene_of(EXPERIMENT),
    }


def scenes_without(whole: Scene) -> dict[str, Scene]:
    """Return scenes that were never told of a part, made by hand."""
    law, hand = whole.law, whole.operator
    nothing = replace(law.environment, stiffness=0.0, damping=0.0, mass=0.0, zero=0.0, wall=False)
    return {
        "friction": replace(whole, friction=None),
        "quantised position": replace(whole, law=replace(law, position_resolution=0.0)),
        "filtered difference": replace(whole, law=replace(law, smoothing=None)),
        "noise": replace(whole, force_noise=0.0),
        "saturation": replace(whole, law=replace(law, limit=None)),
        "mass of the hand": replace(whole, operator=replace(hand, mass=0.0)),
        "wall": replace(whole, law=replace(law, environment=replace(law.environment, wall=False))),
        "environment": replace(whole, law=replace(law, environment=nothing)),
        "delay": replace(whole, device=replace(whole.device, delay=0.0)),
    }


def _step_rows(pairs: int, tick: Tick) -> list[Row]:
    whole = scene_of(EXPERIMENT, delay=DELAY)
    by_hand = scenes_without(whole)
    rows = []
    for name, scene in {EVERYTHING: whole, **absent_in_step()}.items():
        tick(f"simulation step without {name}")
        states, operations = step_size(build(scene, DEFAULT))
        same = name == EVERYTHING or (states, operations) == step_size(build(by_hand[name], DEFAULT))
        pace = paired(lambda: run(whole), lambda scene=scene: run(scene), pairs)  # type: ignore[misc]
        rows.append(Row(STEP, name, states, 0, operations, pace.second, pace.ratio, same))
    return rows


def facts(rows: list[Row]) -> list[str]:
    """Say what each part costs, and whether what is absent costs nothing."""
    said = []
    for build_name in (NLP, STEP):
        whole, *others = (row for row in rows if row.build == build_name)
        kind = f"{whole.variables} variables, {whole.constraints} constraints, " if build_name == NLP else ""
        said.append(f"{build_name}, {EVERYTHING}: {kind}{whole.operations} operations, {whole.seconds:.4f} s.")
        parts = ", ".join(
            f"{row.without} {row.operations / whole.operations - 1:+.0%} operations and {row.ratio - 1:+.0%} time"
            for row in others
        )
        said.append(f"{build_name} without: {parts}.")
    equal = sum(row.same_as_without for row in rows)
    said.append(f"Equal to a build that was never told of the part: {equal} of {len(rows)}.")
    said.append("Without the hand's mass the bristles swing faster, so that a sample gets more steps.")
    times = median(row.ratio for row in rows if row.without == EVERYTHING)
    return [*said, f"Noise of the pairs: everything on against itself {times:.2f}."]


def panels(rows: list[Row]) -> list[Panel]:
    """Draw the operations without each part against those with everything on."""
    drawn = []
    for build_name in (NLP, STEP):
        whole, *others = (row for row in rows if row.build == build_name)
        series = [
            Series(row.without, [row.operations / whole.operations], [max(row.ratio, 1e-3)]) for row in (whole, *others)
        ]
        drawn.append(Panel(build_name, "operations, share of everything on", "time, share of everything on", series))
    return drawn
