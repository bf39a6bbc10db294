"""Boxes of devices as wide as may be, delays of many samples: each search ends with a proof, of a design or of none."""

from __future__ import annotations

import sys
from collections import Counter
from itertools import chain, combinations
from time import process_time

import numpy as np
import pytest
from conftest import drawn, for_passive_hands
from random_problems import on_devices, random_devices
from test_uncertainty import failing, numbers

from vctune.bench.evaluator import stability_ratio
from vctune.design.prepared import pose
from vctune.design.search.worst import worst_inside
from vctune.design.solve import solve
from vctune.design.verdict.judge import Status, judge
from vctune.document.reading import parse_problem
from vctune.model.gains import Coupling, Gains
from vctune.proof.device_box import device_box
from vctune.proof.enclosures.array_intervals import Enclosure
from vctune.proof.enclosures.jets import ENCLOSURES
from vctune.proof.engine.boxes import Boxes
from vctune.proof.engine.interval import Verdict

UNCERTAIN = "mass", "damping", "delay"
COMBINATIONS = list(chain.from_iterable(combinations(UNCERTAIN, n) for n in (1, 2, 3)))
LONGEST = 10.0
"""Greatest processor time of a search, s."""
DEVICE = "[device]\nmass = {!r}\ndamping = {!r}\nsample_time = {!r}\ndelay = {!r}\n"
HARD = [
    DEVICE.format(0.21606709427042425, 0.09096134904341963, 0.0003858802197061619, 0.001003288571236021)
    + "[stability]\nband_hz = [0.2, 259.0]\n[uncertainty]\nmass = 0.3\ndamping = 0.9\ndelay = 0.9\n",
    DEVICE.format(1.0, 1.0, 1e-3, 0.05) + "[stability]\nband_hz = [0.00495, 100.0]\n[uncertainty]\ndelay = 0.5\n",
]
"""Devices whose worst is far from every vertex: at some delay that turns the phase at some frequency just so."""


def random_texts(seed):
    """Random devices over ten decades, each combination of uncertainties in turn; bands by default, or to 0.1/T."""
    rng, turn = np.random.default_rng(seed), 0
    while True:
        uncertain, turn = COMBINATIONS[turn % len(COMBINATIONS)], turn + 1
        mass, T, kind = 10 ** rng.uniform(-5, 5), 10 ** rng.uniform(-5, -2), rng.integers(3)
        delay = T * (rng.uniform(0, 3) if kind < 2 else 10 ** rng.uniform(-2, 2))
        delay = 0.0 if kind == 0 and "delay" not in uncertain else delay
        damping = mass / (T / 2 + delay) * 10 ** rng.uniform(-8, 2)
        damping = 0.0 if rng.random() < 0.1 and "damping" not in uncertain else damping
        widths = {name: 0.9 if rng.random() < 0.3 else rng.uniform(0.0, 0.9) for name in uncertain}
        band = f"[stability]\nband_hz = [{0.00025 / (T / 2 + delay)!r}, {0.1 / T!r}]\n" if rng.random() < 0.5 else ""
        objective = 'objective = "worst"\n' if rng.random() < 0.3 else ""
        box = "".join(f"{name} = {width!r}\n" for name, width in widths.items())
        yield DEVICE.format(mass, damping, T, delay) + band + "[uncertainty]\n" + box + objective


def settled(text, devices=40):
    """Return the status and the processor time of a search that must end; a proved design holds on random devices."""
    given, began = parse_problem(for_passive_hands(text), "x", "x"), process_time()
    found = solve(given)
    seconds = process_time() - began
    assert found.status in (Status.CERTIFIED, Status.INFEASIBLE), text
    if found.status is Status.INFEASIBLE:
        assert found.infeasibility.proved, text
    else:
        some = random_devices(given, devices, np.random.default_rng(1))
        assert not failing(given, numbers(found.judgement), some).any(), text
    return found.status, seconds


@pytest.mark.parametrize("text", HARD, ids=["three", "delay"])
def test_a_worst_device_far_from_every_vertex_is_met(text):
    status, seconds = settled(text)
    assert status is Status.CERTIFIED and seconds < LONGEST


def test_a_design_of_a_wider_box_means_one_of_a_narrower():
    wide, narrow = HARD[1].replace("delay = 0.5", "delay = 0.9"), HARD[1]
    errors = [solve(parse_problem(for_passive_hands(text), "x", "x")).judgement.error for text in (narrow, wide)]
    assert errors[0] <= errors[1]


@pytest.mark.parametrize("count", [2, pytest.param(4, marks=pytest.mark.slow)])
def test_a_few_random_boxes_end(count):
    for text, _ in zip(random_texts(2), range(count), strict=False):
        assert settled(text)[1] < LONGEST, text


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 3])
def test_three_hundred_random_boxes_end(seed, capsys):
    found = [settled(text) for text, _ in zip(random_texts(seed), range(drawn(300)), strict=False)]
    met, slowest = Counter(status.value for status, _ in found), max(seconds for _, seconds in found)
    with capsys.disabled():
        sys.stdout.write(f"\n{dict(met)}, the slowest in {slowest:.1f} s\n")
    assert slowest < LONGEST


@pytest.mark.parametrize(
    ("samples", "damping", "widths"),
    [
        (100, 1.0, {"delay": 0.9}),
        pytest.param(100, 200.0, {"mass": 0.9, "damping": 0.9, "delay": 0.99}, marks=pytest.mark.slow),
        pytest.param(200, 1.0, {"mass": 0.5}, marks=pytest.mark.slow),
        (200, 200.0, {"damping": 0.9}),
    ],
)
def test_long_delays_are_proved(samples, damping, widths):
    box = "".join(f"{name} = {width}\n" for name, width in widths.items())
    text = DEVICE.format(0.4, damping, 1e-3, samples * 1e-3) + "[stability]\nband_hz = [0.0025, 100.0]\n[uncertainty]\n"
    status, seconds = settled(text + box, devices=2)
    assert status is Status.CERTIFIED and seconds < LONGEST


def test_where_every_phase_occurs_a_device_refutes_what_fails():
    """Gains some times too high for one frequency far above the least at which the delays turn the phase fully."""
    text = DEVICE.format(1.0, 1.0, 1e-3, 0.1) + "[stability]\nband_hz = [20.0, 100.0]\n[uncertainty]\ndelay = 0.9\n"
    given = parse_problem(for_passive_hands(text), "x", "x")
    found = solve(given).judgement
    assert found.status is Status.CERTIFIED
    lighter = Coupling(found.coupling.damping * 0.999, found.coupling.mass * 0.999, 0.0)
    outcome = judge(given, found.gains, lighter).certificate.outcomes["passive"]
    box = device_box(given.device, given.uncertainty)
    assert outcome.verdict is Verdict.REFUTED
    assert box.low.delay < outcome.device.delay < box.high.delay


@pytest.mark.parametrize("text", HARD, ids=["three", "delay"])
def test_the_least_ratio_of_a_box_is_found(text):
    """Among many random devices of the box none has a lower one."""
    given = parse_problem(for_passive_hands(text), "x", "x")
    bounds = given.bounds
    gains, coupling = Gains(3 * bounds.velocity.min, 0.0), Coupling(3e4 * bounds.velocity.min, 1.0, 0.0)
    judgement = judge(given, gains, coupling)
    omega = np.geomspace(given.stability.band.min, given.stability.band.max, 400)
    devices = random_devices(given, 3000, np.random.default_rng(5))
    design = np.array([gains.velocity, 0.0, coupling.damping, coupling.mass, 0.0])
    found = stability_ratio(on_devices(given, design, devices), omega)
    assert judgement.min_ratio <= found.min() * (1 + 1e-9)
    inside = worst_inside(pose(given), gains, coupling)[0]
    assert inside.ratio == judgement.min_ratio and inside.device == judgement.tightest


def test_a_mass_of_any_size_is_proved():
    """Nine decades of it, with a design that hardly needs to know."""
    text = DEVICE.format(1.0, 1.0, 1e-3, 0.0) + "[uncertainty]\nmass = 0.999999999\n"
    assert solve(parse_problem(for_passive_hands(text), "x", "x")).status is Status.CERTIFIED


def test_a_wide_mass_is_proved_in_every_hand():
    """The reciprocal of the mass has no useful bound over the whole range; the prover divides the range first."""
    text = DEVICE.format(4.704, 0.1126, 0.003911, 0.00693) + "[uncertainty]\nmass = 0.7094\n"
    found = solve(parse_problem(text, "x", "x"))
    assert found.status is Status.CERTIFIED
    assert found.judgement.certificate.outcomes["hands"].verdict is Verdict.PROVED
    assert found.judgement.certificate.boxes < 20_000


@pytest.mark.parametrize("ratio", [1.1, 1.4, 3.0])
def test_the_parts_of_divided_boxes_meet_and_have_at_most_the_ratio(ratio):
    low, high = np.array([[0.0, 1.0, 1.0], [2.0, 5.0, 0.3]]), np.array([[1.0, 2.0, 2.0], [2.0, 6.0, 300.0]])
    boxes = Boxes(("frequency", "device.mass"), low, high, np.arange(3), np.zeros(3, int))
    parts = boxes.divided("device.mass", ratio)
    assert (parts.high[1] <= ratio * parts.low[1] * (1 + 1e-12)).all()
    for owner in range(3):
        at = np.flatnonzero(parts.owner == owner)
        edges = [*parts.low[1, at], parts.high[1, at[-1]]]
        assert (edges[0], edges[-1]) == (low[1, owner], high[1, owner])
        assert (parts.high[1, at[:-1]] == parts.low[1, at[1:]]).all() and (np.diff(edges) >= 0).all()
        assert (parts.low[0, at] == low[0, owner]).all() and (parts.high[0, at] == high[0, owner]).all()


def test_exp_of_a_wide_interval_is_bounded():
    for mid, rad in ((-1e6, 1e4), (-50.0, 49.0), (3.0, 2.0), (-700.0, 1.0)):
        with np.errstate(all="ignore"):
            value = ENCLOSURES.exp(Enclosure(np.array([mid]), np.array([rad])))
        low, high = value.mid[0] - value.rad[0], value.mid[0] + value.rad[0]
        assert low <= np.exp(mid - rad) and np.exp(mid + rad) <= high <= 2 * np.exp(mid + rad) + 1e-290


def test_sinc_is_sharp_at_great_phases():
    for x, rad in ((50.0, 0.2), (700.0, 1e-3), (1e4, 0.5)):
        assert ENCLOSURES.sinc(Enclosure(np.array([x]), np.array([rad]))).rad[0] < 1.5 * rad / x
