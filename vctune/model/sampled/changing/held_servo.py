"""Sample a servo in a hand as rows of named states, for hands whose damping changes between samples."""

from __future__ import annotations

from vctune.model.device import Device
from vctune.model.hands import Hand
from vctune.model.loop.drive import Rows
from vctune.model.loop.filters import low_pass_rates
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.sampled.changing.held_plant import FELT, HeldPlant
from vctune.model.sampled.changing.named_rows import (
    COMMAND,
    Chain,
    Row,
    Timing,
    late,
    low_passed,
    sensed,
    substituted,
    timing,
    total,
)

MOVED = ("moved", "moving")


def held_servo(plain: Device, device: Device, hand: Hand, before: Number, ops: Arithmetic) -> HeldPlant:
    """Return a servo in a hand. The servo's command is v_e."""
    servo, memory, times_of = device.servo, dict[str, Row](), timing(plain, device)
    assert servo is not None
    command: Row = {COMMAND: 1}
    if servo.command == "position":
        held = late(memory, "commanded", {COMMAND: 1}, 1)
        command = total([(0.5, command), (0.5, held)])
    now, older = (late(memory, "sent", command, times_of.whole + ago) for ago in (0, 1))
    chain, weights, feed = _chain(device, hand, before if times_of.within is None else hand.damping, ops)
    change = dict(zip(chain.names, chain.over(1, times_of.older, now, older, ops), strict=True))
    felt = sensed(memory, chain, times_of, (now, older), (weights, feed), ops)
    if (share := device.sensing.filter_coefficient) is not None:
        felt = low_passed(memory, "sensed", felt, share, 1)
    k, own = hand.stiffness * device.sample_time * device.sample_time, servo.stiffness
    spring = k
    if own is not None:
        pull = own * device.sample_time * device.sample_time
        spring, felt = k + pull, total([(1, felt), (pull, {"position": 1})])
    travel = change.pop("position")
    position = total([(-1, _coming(device, times_of, ops))])
    change, memory = (
        {name: substituted(row, "position", position) for name, row in rows.items()} for rows in (change, memory)
    )
    rest = {name: k for name in [*change, *memory] if name in FELT or name.startswith("sensed")}
    return HeldPlant(change, memory, {}, {}, travel, substituted(felt, "position", position), rest, spring)


def _chain(device: Device, hand: Hand, before: Number, ops: Arithmetic) -> tuple[Chain, Row, Number]:
    """Return position, servo and sensor, and the coefficients of states and command in the sensor's output."""
    T, servo, sensor = device.sample_time, device.servo, device.sensing
    assert servo is not None
    moved = MOVED[: servo.order]
    felt = FELT[: sensor.order] if sensor.bandwidth_hz is not None else ()
    names = ("position", *moved, *felt)
    rows: Rows = {name: {} for name in names}
    rows["position"]["moved"] = 0 * T + 1
    corner = low_pass_rates(rows, MOVED, servo.bandwidth_hz * T, servo.order, ops)
    rows[moved[-1]][COMMAND] = corner

    def force(damping: Number) -> Row:
        own: Row = {"position": hand.stiffness * (T * T), "moved": damping * T}
        return total([(1, own), (hand.mass, rows["moved"])])

    given = force(before)
    if felt:
        pushing = low_pass_rates(rows, FELT, sensor.bandwidth_hz * T, sensor.order, ops)
        rows[felt[-1]] = total([(1, rows[felt[-1]]), (pushing, force(hand.damping))])
        given = {"felt": 1}
    rates = tuple(tuple(row.get(name, 0) for name in names) for row in rows.values())
    chain = Chain(names, rates, tuple(row.get(COMMAND, 0) for row in rows.values()))
    return chain, {name: x for name, x in given.items() if name != COMMAND}, given.get(COMMAND, 0)


def _coming(device: Device, at: Timing, ops: Arithmetic) -> Row:
    """Return q - x, the motion that the states and the delayed commands will still cause."""
    servo = device.servo
    assert servo is not None
    corner = 2 * ops.pi * (servo.bandwidth_hz * device.sample_time)
    if servo.order == 1:
        found: Row = {"moved": 1 / corner}
    else:
        found = dict.fromkeys(MOVED, 1 / (ops.sqrt(2 + 0 * corner) * corner))
    if servo.command == "position":
        found["commanded[k-1]"] = 0.5
    for ago in range(1, at.whole + 1):
        found[f"sent[k-{ago}]"] = 1
    if at.older is not None:
        found[f"sent[k-{at.whole + 1}]"] = at.older
    return found
