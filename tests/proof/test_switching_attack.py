"""Fifty random certified designs against hands whose damping changes, in exact time, with code that is not the
proof's."""

from __future__ import annotations

from dataclasses import astuple, replace

import numpy as np
import pytest
from random_servos import device_of, random_case
from servo_in_time import Servo
from switching_hands import least_energy, loops_of, most_growth, random_certified, servo_loops, switching

from vctune.model.gains import Coupling, Gains
from vctune.model.hands import Hands
from vctune.model.problem import Demands
from vctune.model.sampled.changing.loop_states import Law, states_of
from vctune.proof.certificate import certify
from vctune.proof.claims.margins_of_claims import Design
from vctune.proof.engine.interval import Verdict
from vctune.proof.storage.changing import prove_changing

ROUNDING = 1e-9
BATCHES, LOOPS, SERVOS = 6, 7, 8
"""Batches of velocity loops, loops in each, and servos: fifty designs."""
MOST_STATES = 8
"""Greatest number of states: the proof of a loop with twelve takes half a minute."""
GRASP = 0.1
"""Least mass of a hand, as a share of the greatest: lighter hands do make some designs grow."""


def certified(design: Design, hands: Hands) -> bool:
    """Return whether a design is proved in every hand that does not change."""
    demands = Demands(design.device, (1.0, 10.0), 1.0, 1e6, passive=False, hands=hands)
    return all(outcome.verdict is Verdict.PROVED for outcome in certify(design, demands).outcomes.values())


def heavier(box: Hands) -> Hands:
    return replace(box, low=replace(box.low, mass=max(box.low.mass, GRASP * box.high.mass)))


def velocity_loops(seed: int, count: int) -> list[tuple[Design, Hands]]:
    """Return certified velocity loops: half of them rigid and ideal, the others with parts, some without K_p."""
    rng, found = np.random.default_rng(seed), list[tuple[Design, Hands]]()
    while len(found) < count:
        design, box = random_certified(rng)
        few = len(states_of(design.device, Law(design.gains, design.series))) <= MOST_STATES
        if few and certified(design, box):
            found.append((design, heavier(box)))
    return found


def kinds_of(design: Design) -> set[str]:
    parts = {"velocity", "actuator", "force_sensor", "structure"}
    kinds = {part for part in parts if getattr(design.device, part) is not None}
    kinds |= {"rigid"} if not kinds else set()
    return kinds | ({"delay"} if design.device.delay else set()) | ({"K_p = 0"} if not design.gains.position else set())


def attacked(seed: int, count: int) -> tuple[int, set[str]]:
    """Attack velocity loops; return how many are proved, and their kinds."""
    rng, proved, kinds = np.random.default_rng(seed + 100), 0, set[str]()
    for design, hands in velocity_loops(seed, count):
        found = prove_changing(design, hands).verdict is Verdict.PROVED
        units = design.device.mass, design.device.sample_time
        grows = most_growth(rng, loops_of(design), hands, units) > 1 + ROUNDING
        assert not (found and grows), (design, hands)
        assert not found or least_energy(design, switching(rng, hands, 40)) > -ROUNDING, (design, hands)
        proved, kinds = proved + found, kinds | (kinds_of(design) if found else set())
    return proved, kinds


@pytest.mark.slow
def test_no_sequence_of_dampings_makes_a_proved_velocity_loop_grow():
    """1,000 random and 100 greedy sequences for each design, and periodic ones; then any motion v_e at all."""
    results = [attacked(seed, LOOPS) for seed in range(BATCHES)]
    proved, kinds = sum(count for count, _ in results), set[str]().union(*(own for _, own in results))
    assert proved >= 15, f"{proved} of {BATCHES * LOOPS} designs are proved"
    assert kinds >= {"rigid", "delay", "velocity", "force_sensor", "K_p = 0"}, kinds


def short_servo(rng: np.random.Generator) -> tuple[Servo, Coupling, Hands]:
    """Return a servo with few samples of delay, the coupling that it needs and 5 % more drag, and its hands."""
    while True:
        case = random_case(rng)
        own = case.servo
        if own.sensor_delay or own.delay > 3 * own.sample_time or not np.isfinite(case.virtual.damping):
            continue
        coupling = Coupling(case.virtual.damping, case.virtual.mass, float(f"{1.05 * case.virtual.drag:.9g}"))
        if certified(Design(device_of(own), Gains(0.0, 0.0), coupling), case.hands):
            return Servo(*astuple(own)), coupling, heavier(case.hands)


def attack_servos(seed: int, count: int, cases: int, sequences: int, adversaries: int) -> int:
    """Attack servos; return how many are proved."""
    rng, proved = np.random.default_rng(seed), 0
    for _ in range(count):
        servo, coupling, hands = short_servo(rng)
        design = Design(device_of(servo), Gains(0.0, 0.0), coupling)
        found = prove_changing(design, hands).verdict is Verdict.PROVED
        loops, units = servo_loops(servo, astuple(coupling)), (hands.high.mass, servo.sample_time)
        grows = most_growth(rng, loops, hands, units, cases, sequences, adversaries) > 1 + ROUNDING
        assert not (found and grows), (design, hands)
        proved += found
    return proved


def test_no_sequence_of_dampings_makes_a_proved_servo_grow():
    assert attack_servos(0, 1, 2, 40, 10) == 1


@pytest.mark.slow
def test_no_sequence_of_dampings_makes_one_of_several_proved_servos_grow():
    assert attack_servos(1, SERVOS, 10, 1000, 100) >= SERVOS // 2


@pytest.mark.slow
def test_weak_designs_grow_and_are_not_proved():
    """The attack finds what is there: with a quarter of the drag that a servo needs, a sequence grows."""
    rng, growing = np.random.default_rng(3), 0
    for _ in range(3):
        servo, coupling, hands = short_servo(rng)
        weak = Coupling(coupling.damping, coupling.mass, coupling.drag / 4)
        loops, units = servo_loops(servo, astuple(weak)), (hands.high.mass, servo.sample_time)
        if most_growth(rng, loops, hands, units, 5, 50, 20) > 1 + ROUNDING:
            growing += 1
            proved = prove_changing(Design(device_of(servo), Gains(0.0, 0.0), weak), hands)
            assert proved.verdict is Verdict.UNDECIDED
    assert growing
