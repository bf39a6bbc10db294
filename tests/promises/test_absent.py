"""What a problem or a scene lacks is not in what is compiled: a build without a part has the size of one that was never
told of it, and is smaller than the one with everything."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from functools import cache

import pytest
from conftest import mostly_slow
from sizes import nlp_size, step_size

from vctune.bench.problems import DOCUMENTS, posed
from vctune.design.nlp.nlp_structure import nlp_structure
from vctune.design.prepared import prepare
from vctune.design.search.working_set import WorkingSet, constraint_points
from vctune.design.variables import coordinates
from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains
from vctune.simulation.mechanics.step import build
from vctune.simulation.scene import designed_scene

WHEEL = DOCUMENTS["friction-wheel"]
WHOLE = {
    **WHEEL,
    "device": {**WHEEL["device"], "delay": 5e-4},
    "coupling": {**WHEEL["coupling"], "drag": {"min": 0.0, "max": 10.0}},
    "operator": {"damping": 0.5},
    "uncertainty": {"mass": 0.1, "damping": 0.5, "delay": 0.2, "objective": "worst"},
}
"""A problem with everything that an NLP can have."""
ANY = Device(1.0, 0.0, 1.0, 0.0, "zoh")
RATIO, PEAK = constraint_points(ANY, (0.003, 0.03, 0.3)), constraint_points(ANY, (1.2,))
FREQUENCIES = WorkingSet(ratio=RATIO, sensitivity=constraint_points(ANY, (0.5, 1.0, 2.0)), tracked_peaks=PEAK)
"""Three demands of each kind, and a peak of |S| that is followed; dimensionless."""


def structure(document, frequencies=FREQUENCIES):
    problem = posed("wheel", document)
    scaled, integrator = prepare(problem).scaled, problem.bounds.position.max > 0
    return nlp_structure(
        scaled, coordinates(scaled.problem, integrator=integrator), frequencies, 4, integrator=integrator
    )


def without(document, table, key=None, value=None):
    """A document without a table or a key of one, or with another value there."""
    document = deepcopy(document)
    if key is None:
        del document[table]
    elif value is None:
        del document[table][key]
    else:
        document.setdefault(table, {})[key] = value
    return document


@cache
def whole_structure():
    return structure(WHOLE)


@cache
def whole_size():
    return nlp_size(whole_structure())


def freed(index):
    return tuple(pair for pair in whole_structure().free if pair[0] != index)


def weightless(term):
    weights = {"weights": {term: 0.0}}
    without_term = replace(whole_structure(), terms=tuple(other for other in whole_structure().terms if other != term))
    return {**WHOLE, "transparency": {**WHOLE["transparency"], **weights}}, without_term


NLPS = {
    "free K_p": lambda: (
        without(WHOLE, "gains", "position", 0.0),
        replace(whole_structure(), free=freed(1), integrator=False),
    ),
    "free b_0": lambda: (without(WHOLE, "coupling", "drag", 0.0), replace(whole_structure(), free=freed(4))),
    "free m_c": lambda: (without(WHOLE, "coupling", "mass", 0.3), replace(whole_structure(), free=freed(3))),
    "uncertain delay": lambda: (without(WHOLE, "device", "delay"), replace(whole_structure(), objective_devices=5)),
    "operator": lambda: (without(WHOLE, "operator"), replace(whole_structure(), operator_damping=False)),
    "uncertainty": lambda: (
        without(WHOLE, "uncertainty"),
        replace(whole_structure(), uncertain=False, objective_devices=1),
    ),
    "worst error": lambda: (
        without(WHOLE, "uncertainty", "objective"),
        replace(whole_structure(), objective_devices=1),
    ),
    "admittance term": lambda: weightless("admittance"),
    "tracking term": lambda: weightless("tracking"),
    "coupling term": lambda: weightless("coupling"),
}


@pytest.mark.parametrize("part", mostly_slow(NLPS, ["operator", "uncertainty", "worst error", "tracking term"]))
def test_what_a_problem_lacks_is_not_in_its_nlp(part):
    document, by_hand = NLPS[part]()
    found = nlp_size(structure(document))
    assert found == nlp_size(by_hand)
    assert found.operations < whole_size().operations


def test_demands_that_do_not_act_are_not_in_the_nlp():
    ratio, _, _, peak, *_ = whole_structure().capacities
    untracked = WorkingSet(ratio=RATIO, sensitivity=FREQUENCIES.sensitivity)
    sizes = [
        nlp_size(structure(WHOLE, frequencies)) for frequencies in (FREQUENCIES, untracked, WorkingSet(ratio=RATIO))
    ]
    assert sizes[1] == nlp_size(replace(whole_structure(), tracked_peaks=0))
    assert sizes[2] == nlp_size(replace(whole_structure(), tracked_peaks=0, capacities=(ratio, 0, 0, peak, 0, 0)))
    assert sizes[2].operations < sizes[1].operations < sizes[0].operations


PARTS = {
    "velocity": {"from": "difference", "filter_hz": 100.0},
    "actuator": {"bandwidth_hz": 300.0},
    "force_sensor": {"bandwidth_hz": 200.0},
    "structure": {"handle_mass": 0.1, "frequency_hz": 120.0, "damping_ratio": 0.02},
}


@pytest.mark.slow
@pytest.mark.parametrize("part", PARTS)
def test_what_a_device_lacks_is_not_in_its_nlp(part):
    """A part adds its constants, and neither variables nor demands; without any, the NLP is the ideal device's."""
    ideal, whole = structure(WHOLE), structure({**WHOLE, "device": {**WHOLE["device"], **PARTS}})
    alone = structure({**WHOLE, "device": {**WHOLE["device"], part: PARTS[part]}})
    assert (ideal.parts, ideal.order, ideal.differenced, ideal.low_passes) == ((), 1, False, 0)
    assert whole.parts == ("estimate", "sensor", "spring")
    sizes = [nlp_size(each) for each in (ideal, alone, whole)]
    assert sizes[0].operations < sizes[1].operations < sizes[2].operations
    assert sizes[0].variables == sizes[1].variables and sizes[0].constraints == sizes[1].constraints


EXPERIMENT = {
    "name": "everything",
    "environment": {"stiffness": 200.0, "damping": 1.0, "mass": 0.1, "zero": 0.025, "wall": True},
    "operator": {
        "motion": "reciprocate", "from": 0.0, "to": 0.05, "speed": 0.02, "cycles": 1,
        "mass": 0.1, "damping": 2.0, "stiffness": 1000.0,
    },
    "friction": {"coulomb": 0.3, "stiction": 0.4, "stribeck_velocity": 0.005, "stiffness": 1e5},
    "sensors": {"position_resolution": 1e-6, "force_noise": 0.01},
    "actuator": {"limit": 50.0},
}  # fmt: skip
REAL = {
    **WHEEL["device"],
    "delay": 5e-4,
    "velocity": {"from": "difference", "filter_hz": 100.0, "filter_order": 2},
    "actuator": {"bandwidth_hz": 400.0, "order": 2},
    "force_sensor": {"bandwidth_hz": 300.0, "order": 2, "delay": 2.3e-3},
    "structure": {"handle_mass": 0.1, "frequency_hz": 200.0, "damping_ratio": 0.02},
}
"""A device with all parts, and each as large as it can be."""


def scene(experiment, device=REAL):
    problem = posed("scene", {**WHEEL, "device": device, "experiment": [experiment]})
    return designed_scene(problem.device, Gains(150.0, 6000.0), Coupling(160.0, 0.4, 0.5), problem.experiments[0])


def law(**changes):
    return lambda whole: replace(whole, law=replace(whole.law, **changes))


def environment(**changes):
    return lambda whole: law(environment=replace(whole.law.environment, **changes))(whole)


NOTHING = {"stiffness": 0.0, "damping": 0.0, "mass": 0.0, "zero": 0.0, "wall": False}
STEPS = {
    "friction": (without(EXPERIMENT, "friction"), lambda whole: replace(whole, friction=None)),
    "quantised position": (without(EXPERIMENT, "sensors", "position_resolution"), law(position_resolution=0.0)),
    "noise": (without(EXPERIMENT, "sensors", "force_noise"), lambda whole: replace(whole, force_noise=0.0)),
    "saturation": (without(EXPERIMENT, "actuator"), law(limit=None)),
    "wall": (without(EXPERIMENT, "environment", "wall"), environment(wall=False)),
    "environment": (without(EXPERIMENT, "environment"), environment(**NOTHING)),
}


@pytest.mark.parametrize("part", STEPS)
def test_what_a_scene_lacks_is_not_in_its_step(part):
    experiment, by_hand = STEPS[part]
    whole = scene(EXPERIMENT)
    size = step_size(build(scene(experiment)))
    assert size == step_size(build(by_hand(whole)))
    assert size[1] < step_size(build(whole))[1]


def device(**changes):
    return lambda whole: replace(whole, device=replace(whole.device, **changes))


def part(name, **changes):
    return lambda whole: device(**{name: replace(getattr(whole.device, name), **changes)})(whole)


def each(*changes):
    def changed(whole):
        for change in changes:
            whole = change(whole)
        return whole

    return changed


def table(name, **changes):
    return {**REAL, name: {**REAL[name], **changes}}


DEVICES = {
    "velocity estimate": (
        without(REAL, "velocity"),
        each(device(velocity=None), law(difference=False, smoothing=None, low_passes=0)),
    ),
    "difference": (table("velocity", **{"from": "measured"}), law(difference=False)),
    "second low-pass": (table("velocity", filter_order=1), law(low_passes=1)),
    "actuator": (without(REAL, "actuator"), device(actuator=None)),
    "its second order": (table("actuator", order=1), part("actuator", order=1)),
    "force sensor": (without(REAL, "force_sensor"), device(force_sensor=None)),
    "second order of its filter": (table("force_sensor", order=1), part("force_sensor", order=1)),
    "its filter": ({**REAL, "force_sensor": {"delay": 2.3e-3}}, part("force_sensor", bandwidth_hz=None)),
    "its delay": (table("force_sensor", delay=0.0), part("force_sensor", delay=0.0)),
    "part of a sample of its delay": (table("force_sensor", delay=2e-3), part("force_sensor", delay=2e-3)),
}
"""The structure is not here: without it other masses swing, and the bristles get other steps."""


@pytest.mark.parametrize("rubbing", [True, False], ids=["friction", "no friction"])
@pytest.mark.parametrize("part", DEVICES)
def test_what_a_device_lacks_is_not_in_its_step(part, rubbing):
    lacking, by_hand = DEVICES[part]
    experiment = EXPERIMENT if rubbing else without(EXPERIMENT, "friction")
    whole, size = scene(experiment), step_size(build(scene(experiment, lacking)))
    assert size == step_size(build(by_hand(whole)))
    assert size < step_size(build(whole))


@pytest.mark.parametrize("experiment", [EXPERIMENT, without(EXPERIMENT, "friction")], ids=["friction", "no friction"])
def test_a_device_that_is_told_of_no_part_is_the_ideal_one(experiment):
    """Empty tables, a force that is late by whole samples apart, have the step of a device without any."""
    bare = {key: REAL[key] for key in (*WHEEL["device"], "delay")}
    told = {**bare, "velocity": {"from": "measured"}, "force_sensor": {"delay": 0.0}}
    ideal, late = step_size(build(scene(experiment, bare))), {**bare, "force_sensor": {"delay": 2e-3}}
    assert step_size(build(scene(experiment, told))) == ideal
    assert step_size(build(scene(experiment, late)))[0] == ideal[0] + 2


def test_a_delay_and_a_mass_in_the_hand_that_are_none_are_not_in_the_step():
    rigid = without(REAL, "structure")
    whole = scene(EXPERIMENT, rigid)
    light = without(EXPERIMENT, "operator", "mass")  # swings faster and gets more steps
    for lacking, by_hand in (
        (scene(EXPERIMENT, {**rigid, "delay": 0.0}), replace(whole, device=replace(whole.device, delay=0.0))),
        (scene(light, rigid), replace(whole, operator=replace(whole.operator, mass=0.0))),
    ):
        assert step_size(build(lacking)) == step_size(build(by_hand))
