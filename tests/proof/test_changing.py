"""A hand whose damping changes at every sample: what is proved, again from design.json alone, and in exact time."""

from __future__ import annotations

import json
import tomllib
from dataclasses import astuple, replace
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import ROOT
from in_time import Environment
from random_devices import ordinary, ordinary_gains
from random_servos import device_of as servo_of
from random_servos import random_servo
from sampled_device_oracle import Hand as Held
from scipy.linalg import expm
from servo_in_time import Mass, Sampled, Servo
from servo_oracle import Follower
from switching_hands import (
    answers,
    energy_of_cycle,
    growth,
    least_energy,
    loops_of,
    matrices,
    most_growth,
    random_with_parts,
    regripped,
    switching,
)

import vctune
from vctune.design.verdict.claim_records import examined_record
from vctune.design.verdict.design_record import design_record
from vctune.document.text.digest import problem_digest
from vctune.model.gains import Coupling, Gains
from vctune.model.hands import Hand, Hands
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.problem import Uncertainty
from vctune.model.sampled.changing.loop_states import Law, loop_states
from vctune.model.sampled.changing.storage_function import Holding, room_of_storage
from vctune.model.sampled.hand_loop import loop_in_hand, offered, required_in_hand
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand
from vctune.proof.claims.margins_of_claims import Design
from vctune.proof.claims.registry import claims_asked
from vctune.proof.device_box import device_box
from vctune.proof.enclosures.array_intervals import decimal
from vctune.proof.engine.interval import Verdict
from vctune.proof.storage.barrier import Family, Sums, well_inside
from vctune.proof.storage.changing import Examined, prove_changing
from vctune.proof.storage.storage_proof import prove_storage, stored

TEXT = (ROOT / "problems/friction-wheel-hands.toml").read_text()
GAINS = tomllib.loads((ROOT / "results/friction-wheel-hands/gains.toml").read_text())
HUMAN = Hands(Hand(0.05, 0.0, 0.0), Hand(0.5, 30.0, 3000.0))
ROUNDING = 1e-9


def stated(**stability):
    """Return the document of friction-wheel-hands with its published gains."""
    document = tomllib.loads(TEXT) | {"gains": GAINS["gains"], "coupling": GAINS["coupling"]}
    return document | {"stability": document["stability"] | stability}


def published():
    problem = vctune.problem(stated()).problem
    return Design(problem.device, *problem.fixed_design)


def supplied(device, gains, coupling, record, hand, sensed):
    """Return the matrix of 2 v_e y - V[k+1] + V[k] over (x, v, u, q, g, v_e): plain NumPy, from the JSON alone.

    Units of the sample time and of the device's mass.
    """
    m, b, T = (device[key] for key in ("mass", "damping", "sample_time"))
    (storage,) = record["storages"]
    (M, B, K), S = hand, sensed
    unit = T / m
    k, k_p, k_v = K * T * unit, gains["position"] * T * unit, gains["velocity"] * unit
    a = T * coupling["damping"] / (2 * coupling["mass"])
    slope, decay = coupling["damping"] / (1 + a) * unit, (1 - a) / (1 + a)
    inertia = 1 + M / m
    flow = expm([[0, 1, 0], [-k / inertia, -(b + B) * unit / inertia, 1 / inertia], [0, 0, 0]])
    x, v, u, q, g, v_e = np.eye(6)
    command = k_v * (v_e - v) + k_p * (q + v_e / 2 - x)
    after_x, after_v = (row[0] * x + row[1] * v + row[2] * command for row in flow[:2])
    force = -(M / m * (u - (b + S) * unit * v - k * x) / inertia + S * unit * v + k * x)
    y = slope * (v_e - (1 - decay) * g) + coupling["drag"] * unit * v_e - force
    after = after_x, after_v, command, q + v_e, decay * g + v_e

    def share(name, value, ends=record["box"]):
        low, high = ends[name]
        return 2 * (value - low) / (high - low) - 1

    def stored(now, damping):
        low, high = record["box"]["mass"]
        mu = share("mass", M)
        weights = [1, mu, (1 - mu**2) * (m + (low + high) / 2) / (m + M), share("stiffness", K)]
        own = [share(key, device[key], storage["device"]) for key in storage.get("device", {})]
        Y = np.tensordot([*weights, share("damping", damping), *own], storage["matrices"], axes=1)
        here_x, here_v, here_u, here_q, here_g = now
        kappa = k_p / (k + k_p)
        zeta = np.array([here_x - kappa * here_q, here_v, here_u - k * kappa * here_q, here_g])
        return k * kappa * np.outer(here_q, here_q) + zeta.T @ Y @ zeta

    return np.outer(v_e, y) + np.outer(y, v_e) - stored(after, B) + stored((x, v, u, q, g), S)


def test_published_gains_are_proved_and_the_file_lets_anyone_check_it():
    file = vctune.problem(stated(changing="damping", changing_mass_min=0.05))
    solved = vctune.solve(file)
    told = json.loads(json.dumps(design_record(file, solved)))
    record = told["certificate"]["changing"]
    assert told["status"] == "certified" and record["verdict"] == "proved"
    assert record["box"] == {"mass": [0.05, 0.5], "damping": [0.0, 30.0], "stiffness": [0.0, 3000.0]}
    checked = vctune.check(file, solved.judgement.gains, solved.judgement.coupling)
    assert "in hands of at least 0.05 kg also while their damping changes" in checked.message
    rng = np.random.default_rng(5)
    inside = rng.uniform((0.05, 0, 0), (0.5, 30, 3000), (100, 3))
    problem = tomllib.loads(told["problem"]["text"])
    for hand in (*product((0.05, 0.5), (0.0, 30.0), (0.0, 3000.0)), *inside):
        for sensed in (0.0, 30.0, rng.uniform(0, 30)):
            found = supplied(problem["device"], told["gains"], told["coupling"], record, hand, sensed)
            least, next_one = np.linalg.eigvalsh(found)[:2]
            assert abs(least) < 1e-12, "at rest anywhere nothing is stored or lost"
            assert next_one > 1e-6


def published_of(name, **uncertain):
    """Return the published gains of a problem, its hands, and a box of devices around its own."""
    document = tomllib.loads((ROOT / f"problems/{name}.toml").read_text())
    law = tomllib.loads((ROOT / f"results/{name}/gains.toml").read_text())
    document |= {key: law[key] for key in ("gains", "coupling") if key in law}
    document.pop("uncertainty", None)
    problem = vctune.problem(document).problem
    box = device_box(problem.device, Uncertainty(tuple(uncertain.items()), "nominal"))
    return Design(problem.device, *problem.fixed_design), problem.hands_met, box


def test_every_device_of_a_box_meets_the_inequality_of_its_file():
    design, _, devices = published_of("friction-wheel-hands", mass=0.02, damping=0.1)
    found = prove_changing(design, HUMAN, devices)
    judged = SimpleNamespace(gains=design.gains, coupling=design.coupling, certificate=None)
    record = examined_record(judged, Examined(HUMAN, found)).model_dump(exclude_unset=True)
    assert found.verdict is Verdict.PROVED
    assert record["storages"][0]["device"] == {"mass": [0.392, 0.408], "damping": [1.8, 2.2]}
    rng, law = np.random.default_rng(6), (GAINS["gains"], GAINS["coupling"])
    for _ in range(50):
        device = {"mass": rng.uniform(0.392, 0.408), "damping": rng.uniform(1.8, 2.2), "sample_time": 1e-3}
        hand, sensed = rng.uniform((0.05, 0, 0), (0.5, 30, 3000)), rng.choice([0.0, 30.0])
        least, next_one = np.linalg.eigvalsh(supplied(device, *law, record, hand, sensed))[:2]
        assert abs(least) < 1e-12 and next_one > 1e-6


def test_uncertain_delays_are_divided_at_whole_samples():
    """4 ms are two samples of the wrist; the sensed force jumps there, and each part has a storage of its own."""
    design, hands, devices = published_of("cobot-wrist", delay=0.1)
    found = prove_changing(design, hands, devices)
    ends = [[(each.low, each.high) for each in storage.box.numbers] for storage in found.storages]
    assert found.verdict is Verdict.PROVED and ends == [[(0.0036, 0.004)], [(0.004, 0.0044)]]
    rng = np.random.default_rng(7)
    for storage in found.storages:
        (late,) = storage.box.numbers
        for _ in range(20):
            device = replace(design.device, delay=rng.uniform(late.low, late.high))
            plain, hand = (device, Law(design.gains, design.series)), Hand(*rng.uniform(0, (0.5, 30, 3000)))
            loop = loop_states(plain, plain, hand, hand.damping, FLOATS)
            Y = stored(storage, device.converted(decimal), hand)
            mids = [[getattr(x, "mid", x) for x in row] for row in Y]
            nothing = [[0.0] * len(mids)] * len(mids)
            room = np.array(room_of_storage(loop, mids, nothing, FLOATS), float)
            assert np.linalg.eigvalsh(room).min() > 0


def test_two_uncertain_delays_are_refused():
    tables = {"device": {"delay": 5e-4, "force_sensor": {"delay": 3e-4}}, "stability": {"changing": "damping"}}
    tables["uncertainty"] = {"delay": 0.1, "force_sensor.delay": 0.1}
    document = {key: (tomllib.loads(TEXT).get(key) or {}) | table for key, table in tables.items()}
    with pytest.raises(vctune.InputError, match="together with delay"):
        vctune.problem(tomllib.loads(TEXT) | document)
    servo = servo_of(Follower(0.002, 0.0035, 20.0, 1, False, None, 1, 0.003))
    both = device_box(servo, Uncertainty((("servo.delay", 0.1), ("force_sensor.delay", 0.1)), "nominal"))
    design = Design(servo, Gains(0.0, 0.0), Coupling(np.inf, 2.0, 4000.0))
    assert prove_changing(design, HUMAN, both).verdict is Verdict.UNDECIDED


def test_the_states_are_the_loop_of_every_other_proof():
    design = published()
    for delay in (0.0, 3e-4, 1e-3, 2.3e-3):
        device, hand = replace(design.device, delay=delay), Hand(0.2, 5.0, 800.0)
        delays = delays_of(device)
        plain = device, Law(design.gains, design.series)
        states = loop_states(plain, plain, hand, hand.damping, FLOATS)
        n = len(states.push)
        step = np.array(states.change, float) + np.diag(np.arange(n) < states.staying)
        for theta in (0.01, 0.3, 2.0, 3.0):
            z = np.exp(1j * theta)
            moved = np.linalg.solve(z * np.eye(n) - step, np.array(states.push, float))
            y = np.array(states.seen) @ moved + states.direct + states.spring / (z - 1)
            loop = loop_in_hand(plant_in_hand(device, hand, delays, FLOATS), theta, FLOATS)
            required = required_in_hand(loop, design.gains)
            resistance = offered(design.coupling, device, theta, FLOATS) - required.lost / required.size
            assert y.real * device.mass / device.sample_time == pytest.approx(resistance, rel=1e-9)


@pytest.mark.parametrize("seed", [0, 1, 3, 5, 8, 9])
def test_the_states_follow_a_hand_whose_damping_changes_at_every_sample(seed):
    """Devices with parts from event to event, `firmware.Device`, which knows nothing of the states."""
    rng = np.random.default_rng(seed)
    device = replace(ordinary(rng, held=0.0), unmodelled=None)
    gains, coupling = ordinary_gains(device, rng)
    gains = replace(gains, position=gains.position * (seed % 3 != 0))
    unit = device.mass / device.sample_time
    mass, stiffness = device.mass * rng.uniform(0, 2), unit / device.sample_time * rng.uniform(0, 0.1) * (seed % 4 != 0)
    dampings, desired = unit * rng.uniform(0, 0.2, 40) * rng.integers(2, size=40), rng.normal(size=40)
    design = Design(device, gains, coupling)
    expected = answers(design, [Held(mass, damping, stiffness) for damping in dampings], desired)
    plain, before, found = (device, Law(gains, coupling)), 0.0, []
    state, reached = 0, 0.0
    for damping, v_e in zip(dampings, desired, strict=True):
        loop = loop_states(plain, plain, Hand(mass, damping, stiffness), before, FLOATS)
        state = np.zeros(len(loop.push)) + state
        y = np.dot(np.array(loop.seen, float), state) + loop.spring * reached + loop.direct * v_e
        step = np.array(loop.change, float) + np.diag(np.arange(len(loop.push)) < loop.staying)
        state, reached, before = step @ state + np.array(loop.push, float) * v_e, reached + v_e, damping
        found.append(y * unit)
    assert found == pytest.approx(expected, rel=1e-7, abs=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("seed", range(3))
def test_the_states_of_a_servo_follow_a_hand_whose_damping_changes_at_every_sample(seed):
    """Servos by matrix exponentials of SciPy, `servo_in_time.Sampled`, whose sensor comes after the hand."""
    rng = np.random.default_rng(seed)
    own = replace(random_servo(rng), sensor_delay=0.0)
    T, count = own.sample_time, 60
    mass, stiffness = rng.uniform(0, 5), rng.uniform(0, 3000) * (seed % 3 != 0)
    dampings, desired = rng.uniform(0, 100, count) * rng.integers(2, size=count), rng.normal(size=count)
    design = Design(servo_of(own), Gains(0.0, 0.0), Coupling(np.inf, 2.0, 40.0))
    plain, before, reached, last = (design.device, Law(design.gains, design.series)), 0.0, 0.0, 0.0
    kept, state, found, expected = 0.0, 0.0, [], []
    for damping, v_e in zip(dampings, desired, strict=True):
        sensing, moving = (Sampled(Servo(*astuple(own)), Mass(mass, each, stiffness)) for each in (before, damping))
        kept = np.zeros(sensing.size) + kept
        expected.append(design.series.drag * v_e - sensing.force(kept))
        kept = moving.wait(kept, (v_e + last) / 2 if own.position else v_e)
        loop = loop_states(plain, plain, Hand(mass, damping, stiffness), before, FLOATS)
        state = np.zeros(len(loop.push)) + state
        y = np.dot(np.array(loop.seen, float), state) + loop.spring * reached + loop.direct * v_e
        found.append(y / T)
        step = np.array(loop.change, float) + np.diag(np.arange(len(loop.push)) < loop.staying)
        state, reached = step @ state + np.array(loop.push, float) * v_e, reached + v_e
        before, last = damping, v_e
    assert found == pytest.approx(expected, rel=1e-7, abs=1e-9 * np.abs(expected).max())


def test_a_hand_without_mass_is_left_open_and_named():
    found = prove_changing(published(), replace(HUMAN, low=Hand(0.0, 0.0, 0.0)))
    assert found.verdict is Verdict.UNDECIDED and not found.storages
    assert found.hand is not None and found.hand.mass == 0


def test_a_sequence_grows_in_the_hand_without_mass():
    steps = matrices(published(), 0.0, (0.0, 30.0), 3000.0, Environment(stiffness=8000.0))
    assert growth(steps, np.array([[0, 0, 0, 0, 0, 1]]))[0] == pytest.approx(1.0525, abs=1e-4)
    held = matrices(published(), 0.05, (0.0, 30.0), 3000.0, Environment(stiffness=8000.0))
    assert growth(held, np.array([[0, 0, 0, 0, 0, 1]]))[0] < 1


def test_a_hand_that_grips_again_makes_gains_grow_that_hold_in_every_hand():
    """Model README, sections 11 and 20: 3 kN/m without mass and damping, again every 6 ms, before 10 kN/m."""
    design = published()
    assert regripped(design, 3000.0, 0.0, 1e4, 6) ** 2 == pytest.approx(1.1401, abs=1e-4)
    assert regripped(design, 3000.0, 1.0, 1e4, 6) < 1
    assert max(regripped(design, 3000.0, 0.0, stiffness, 6) for stiffness in (0.0, 1e3)) < 1 + ROUNDING


def test_a_stiffness_that_changes_supplies_energy():
    """Model README, section 21: a slow cycle returns more than it took, whatever the gains."""
    design = published()
    k_1, k_2 = (K * design.gains.position / (K + design.gains.position) for K in (300.0, 3000.0))
    for steps, share in ((300, 0.5), (3000, 0.95)):
        gained = energy_of_cycle(design, 300.0, 3000.0, 0.01, steps)
        assert 0.5 * (k_2 - k_1) * 0.01**2 * share < gained < 0.5 * (k_2 - k_1) * 0.01**2


def test_a_storage_that_is_another_is_not_proved():
    (storage,) = prove_changing(published(), HUMAN).storages
    assert prove_storage(published(), storage, 2000).open is None
    for factor in (0.8, 1.3):
        terms = tuple(tuple(tuple(factor * x for x in row) for row in term) for term in storage.terms)
        other = replace(storage, terms=terms)
        assert prove_storage(published(), other, 2000).fails
    wider = replace(storage, box=Holding(replace(HUMAN, high=Hand(0.5, 30.0, 30000.0))))
    assert prove_storage(published(), wider, 2000).open is not None


def test_it_is_off_unless_asked_for():
    known = vctune.problem(stated()).problem
    assert known.demands.changing is None and claims_asked(known.demands) == ["sensitivity", "stable", "hands"]
    assert problem_digest(vctune.problem(tomllib.loads(TEXT)).problem) == GAINS["design"]["sha256"]


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        ({"stability": {"changing": "damping", "criterion": "passive"}}, "needs a box of hands"),
        ({"stability": {"changing_mass_min": 0.1}}, 'write changing = "damping"'),
        ({"stability": {"changing": "damping", "changing_mass_min": 0.7}}, "above operator.mass.max = 0.5"),
        (
            {"stability": {"changing": "damping"}, "uncertainty": {"unmodelled": [[1.0, 0.1], [10.0, 0.1]]}},
            "proof for hands that change",
        ),
        ({"stability": {"changing": "damping"}, "environment": {}}, r"\[environment\] does not ask for"),
        ({"stability": {"changing": "stiffness"}}, "damping"),
        ({"stability": {"changing": "damping"}, "device": {"display": "impedance"}}, "a steady force has no rest"),
    ],
)
def test_what_is_not_looked_at_is_refused(tables, said):
    document = {key: (tomllib.loads(TEXT).get(key) or {}) | table for key, table in tables.items()}
    with pytest.raises(vctune.InputError, match=said):
        vctune.problem(tomllib.loads(TEXT) | document)


def test_no_sequence_of_dampings_makes_the_published_gains_grow():
    design = published()
    units = design.device.mass, design.device.sample_time
    assert most_growth(np.random.default_rng(0), loops_of(design), HUMAN, units, 5, 100, 10) < 1 + ROUNDING


WITH_PARTS = [(5, 1), (5, 3), pytest.param(5, 6, marks=pytest.mark.slow)]
"""Seeds, and how many designs come before: a low-pass of the velocity, late force sensors, actuators, with and without
K_p."""


def with_parts(seed, skipped):
    rng = np.random.default_rng(seed)
    found = [random_with_parts(rng) for _ in range(skipped + 1)]
    design, box = found[-1]
    return design, replace(box, low=replace(box.low, mass=max(box.low.mass, 0.1 * box.high.mass)))


@pytest.mark.parametrize(("seed", "skipped"), WITH_PARTS)
def test_devices_with_parts_are_proved_and_supply_no_energy(seed, skipped):
    design, hands = with_parts(seed, skipped)
    assert prove_changing(design, hands).verdict is Verdict.PROVED
    assert least_energy(design, switching(np.random.default_rng(0), hands, 20)) > -ROUNDING


@pytest.mark.parametrize(
    "name",
    ["arm-contact", "cobot-wrist", pytest.param("flexible-handle", marks=pytest.mark.slow)],
)
def test_published_gains_of_servos_and_of_a_flexible_handle_are_proved(name):
    design, hands, _ = published_of(name)
    assert hands.low.mass == 0 and prove_changing(design, hands).verdict is Verdict.PROVED


def test_a_servo_whose_states_do_not_depend_on_the_hand_is_proved():
    """Its sensor has no low-pass: the hand is in the sensed force alone."""
    device = servo_of(Follower(0.002, 0.0035, 20.0, 1, False, None, 1, 0.0))
    design = Design(device, Gains(0.0, 0.0), Coupling(np.inf, 2.0, 400.0))
    hands = Hands(Hand(0.0, 0.0, 0.0), Hand(1.0, 20.0, 1000.0))
    assert prove_changing(design, hands).verdict is Verdict.PROVED
    weak = replace(design, coupling=Coupling(np.inf, 2.0, 4.0))
    assert prove_changing(weak, hands).verdict is Verdict.UNDECIDED


def test_a_hand_without_mass_supplies_energy():
    held = [Held(0.0, 30.0 * (sample % 6 == 5), 3000.0) for sample in range(48)]
    heavy = [replace(each, mass=0.05) for each in held]
    assert least_energy(published(), held) < -1e-6 and least_energy(published(), heavy) > -ROUNDING


def falls_while_stiffness_changes(environments, rate):
    """Return whether a storage falls in every sample while K, 0.3 to 3 kN/m, changes by `rate`, N/m per s.

    It is affine in K and, for several environments, in their mass, its logarithm and their stiffness.
    """
    T, places = 1e-3, [(K, world) for K in np.linspace(300.0, 3000.0, 7) for world in environments]
    steps = [matrices(published(), 0.2, (0.0,), K, world)[0] for K, world in places]
    middle = len(places) // 2
    n, many = len(steps[0]), steps[middle]
    energy = np.diag([1e5, 0.4, 1e-5, 1e-5, 1e5, 0.05, places[middle][1].mass])
    for _ in range(40):  # Lyapunov's function of the one in the middle, in whose units all states are alike
        energy, many = energy + many.T @ energy @ many, many @ many
    unit = np.linalg.cholesky(energy).T
    steps = [unit @ step @ np.linalg.inv(unit) for step in steps]
    rows, columns = np.triu_indices(n)
    basis = np.zeros((rows.size, n, n))
    basis[np.arange(rows.size), rows, columns] = basis[np.arange(rows.size), columns, rows] = 1.0

    def shares(K, world):
        own = [world.mass, np.log(world.mass), world.stiffness / 1e3 - 1.5] if len(environments) > 1 else []
        return [1.0, (np.clip(K, 300.0, 3000.0) - 1650.0) / 1350.0, *own]

    now, then, kept, after = [], [], [], []
    for (K, world), step in zip(places, steps, strict=True):
        for change in {rate, -rate}:
            now.append(shares(K, world))
            then.append(shares(K + change * T, world))
            after.append(step.T @ basis @ step)
            kept.append(basis - after[-1])
    # the storage itself is positive where it falls and the loop is stable, and less than 1 in the middle
    now, then = (np.array([*each, shares(*places[middle])]) for each in (now, then))
    kept, after, constant = [*kept, -basis], [*after, 0 * basis], np.zeros((len(now), n, n))
    constant[-1] = np.eye(n)
    families = Family(now, np.array(kept)), Family(now - then, np.array(after))
    return well_inside(Sums(constant, families, np.ones((now.shape[1], rows.size), bool))) is not None


SLOWLY = [(2000, 2, 0.5), (200, 0, 0.02), (2000, 0, 0.02), (2000, 0, 0.5), (0, 2, 0.5), (2000, 10, 5)]
"""Stiffness, damping and mass of environments."""


@pytest.mark.parametrize("world", [SLOWLY[0], *(pytest.param(each, marks=pytest.mark.slow) for each in SLOWLY[1:])])
def test_a_stiffness_may_change_slowly_before_a_linear_environment(world):
    stiffness, damping, mass = map(float, world)
    assert falls_while_stiffness_changes([Environment(mass=mass, damping=damping, stiffness=stiffness)], 1e3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mass", "stiffness", "rate", "other"), [(5, 2000, 1, 3), (0.5, 200, 1, 3), (0.02, 2000, 10, 100)]
)
def test_a_stiffness_may_not_change_much_faster(mass, stiffness, rate, other):
    """The table of model/README, section 21."""
    world = [Environment(mass=float(mass), stiffness=float(stiffness))]
    assert falls_while_stiffness_changes(world, 1e3 * rate) and not falls_while_stiffness_changes(world, 1e3 * other)


@pytest.mark.slow
def test_no_affine_storage_serves_a_box_of_environments():
    worlds = [Environment(mass=m, stiffness=k) for m in (0.5, 1.0, 2.0, 5.0) for k in (1000.0, 1500.0, 2000.0)]
    assert not falls_while_stiffness_changes(worlds, 0.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "uncertain"),
    [
        ("friction-wheel-hands", {"mass": 0.02, "damping": 0.1}),
        ("cobot-wrist", {"mass": 0.1, "damping": 0.1}),
        ("cobot-wrist", {"delay": 0.1}),
    ],
)
def test_no_sequence_of_dampings_makes_a_device_of_a_proved_box_grow(name, uncertain):
    rng, (design, _, devices) = np.random.default_rng(3), published_of(name, **uncertain)
    assert prove_changing(design, HUMAN, devices).verdict is Verdict.PROVED
    for _ in range(10):
        numbers = {key: rng.uniform(devices.low.number(key), devices.high.number(key)) for key in devices.uncertain}
        each = replace(design, device=devices.device(numbers))
        units = each.device.mass, each.device.sample_time
        assert most_growth(rng, loops_of(each), HUMAN, units, 5, 200, 50) < 1 + ROUNDING
        assert least_energy(each, switching(rng, HUMAN, 30)) > -ROUNDING
