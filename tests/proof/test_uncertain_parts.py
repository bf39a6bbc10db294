"""Any number of a device may be uncertain: the proof holds for every device of the box, as an oracle has them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from device_arithmetic import DOUBLES
from device_oracle import Coupling as CouplingNumbers
from device_oracle import Gains as LawNumbers
from device_oracle import LowPass, Real, Velocity, coupling_impedance, response_at
from device_oracle import Structure as Spring
from firmware import spectral_radius
from sampled_device_oracle import sensitivity

from vctune.design.solve import solve
from vctune.design.verdict.judge import Status, judge
from vctune.document.reading import parse_problem
from vctune.document.schema.device_schema import UncertaintyTable
from vctune.model.parts import UNCERTAIN
from vctune.proof.engine.interval import Verdict

FACTOR, LIMIT = 1.05, 2.0
DEMANDS = (
    "[gains]\nvelocity = {{ min = 1.0, max = 1000.0 }}\nposition = {{ min = {}, max = 1e5 }}\n"
    "[coupling]\ndrag = {{ min = 0.0, max = 50.0 }}\n"
    "[transparency]\nband_hz = [0.5, 30.0]\nreference_impedance = 10.0\n"
    "[stability]\ncriterion = 'passive'\nband_hz = [0.5, 100.0]\n[uncertainty]\n"
)
CASES = {
    "late": (
        "[device]\nmass = 0.4\ndamping = 2.0\nsample_time = 2.5e-4\ndelay = 1e-4\n[device.actuator]\n"
        'bandwidth_hz = 800.0\n[device.velocity]\nfrom = "difference"\nfilter_hz = 300.0\n'
        "[device.force_sensor]\nbandwidth_hz = 500.0\norder = 2\n"
        + DEMANDS.format(3000.0)
        + '"actuator.bandwidth_hz" = 0.2\n"force_sensor.bandwidth_hz" = 0.2\n"velocity.filter_hz" = 0.05\n',
        {"actuator": 0.2, "sensor": 0.2, "filter": 0.05},
    ),
    "flexible": (
        "[device]\nmass = 0.4\ndamping = 2.0\nsample_time = 1e-3\n[device.structure]\nhandle_mass = 0.1\n"
        "frequency_hz = 120.0\ndamping_ratio = 0.02\n"
        + DEMANDS.format(0.0)
        + 'mass = 0.05\n"structure.frequency_hz" = 0.1\n',
        {"mass": 0.05, "resonance": 0.1},
    ),
}
DEVICES = 60


@cache
def designed(name):
    given = parse_problem(CASES[name][0], "x", "x")
    return given, solve(given).judgement


def device(name, shares):
    """A device of the box, each number off by a share of its half-width."""

    def off(number, of):
        return number * (1 + CASES[name][1].get(of, 0.0) * shares.get(of, 0.0))

    if name == "late":
        return Real(
            0.4,
            2.0,
            2.5e-4,
            delay=1e-4,
            velocity=Velocity("difference", off(300.0, "filter"), 1),
            actuator=LowPass(off(800.0, "actuator")),
            force_sensor=LowPass(off(500.0, "sensor"), 2),
        )
    return Real(off(0.4, "mass"), 2.0, 1e-3, structure=Spring(0.1, off(120.0, "resonance"), 0.02))


def random_devices(name):
    rng = np.random.default_rng(1)
    for k in range(DEVICES):
        shares = {of: rng.uniform(-1, 1) for of in CASES[name][1]}
        yield device(name, {of: np.sign(share) if k % 2 else share for of, share in shares.items()})


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_every_device_of_the_box_meets_its_demands(name):
    _, judgement = designed(name)
    assert judgement.status is Status.CERTIFIED
    law, coupling = judgement.gains, judgement.coupling
    gains = LawNumbers(law.velocity, law.position)
    virtual = CouplingNumbers(coupling.damping, coupling.mass, coupling.drag)
    s = 2j * np.pi * np.geomspace(0.5, 100.0, 400)
    offered = coupling_impedance(virtual, s, DOUBLES).real
    least = min((offered / response_at(one, gains, s, DOUBLES).required).min() for one in random_devices(name))
    assert least >= FACTOR * (1 - 1e-9)
    for one in list(random_devices(name))[:10]:
        peak = max(
            abs(complex(sensitivity(one, gains, f, DOUBLES))) for f in np.linspace(5.0, 0.5 / one.sample_time, 120)
        )
        assert peak <= LIMIT
        assert spectral_radius(one, gains, num=DOUBLES) < 1


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_a_design_for_the_nominal_device_is_refuted_by_one_of_the_box(name):
    given, robust = designed(name)
    alone = solve(replace(given, uncertainty=None)).judgement
    assert alone.status is Status.CERTIFIED and alone.error < robust.error
    outcomes = judge(given, alone.gains, alone.coupling).certificate.outcomes.values()
    refuted = next(outcome for outcome in outcomes if outcome.verdict is Verdict.REFUTED)
    for key, width in given.uncertainty.half_widths:
        assert abs(refuted.device.number(key) / given.device.number(key) - 1) <= width * (1 + 1e-12)


def test_the_uncertain_numbers_of_a_file_are_those_of_the_model():
    fields = UncertaintyTable.model_fields
    keys = {field.alias or name for name, field in fields.items()} - {"unmodelled", "objective"}
    assert keys == set(UNCERTAIN)


@pytest.mark.slow
def test_what_is_not_there_cannot_be_uncertain_but_what_is_may_be_all_of_it():
    everything = "".join(
        f'"{key}" = 0.01\n' if "." in key else f"{key} = 0.01\n"
        for key in (
            *("mass", "damping", "delay", "velocity.filter_hz", "actuator.bandwidth_hz", "force_sensor.bandwidth_hz"),
            *("force_sensor.delay", "structure.handle_mass", "structure.frequency_hz", "structure.damping_ratio"),
        )
    )
    head = CASES["late"][0].split("[gains]")[0].replace("order = 2\n", "order = 2\ndelay = 1e-4\n")
    structure = "[device.structure]\nhandle_mass = 0.1\nfrequency_hz = 400.0\ndamping_ratio = 0.05\n"
    given = parse_problem(head + structure + DEMANDS.format(0.0) + everything, "x", "x")
    assert len(given.uncertainty.half_widths) == 10
    assert judge(given, *fixed()).certificate.outcomes  # ends, in whatever verdict


def fixed():
    judgement = designed("late")[1]
    return judgement.gains, judgement.coupling
