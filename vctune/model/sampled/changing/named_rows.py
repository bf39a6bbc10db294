"""Compute weighted sums of named states and inputs in any arithmetic, and the exact motion of a chain of states."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from vctune.model.device import Device
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.matrices import Matrix, Vector, add, nothing, scaled, times
from vctune.model.sampled.state_space import stepped
from vctune.model.sampled.velocity_loop import split_delay

Row = dict[str, Number]  # A weighted sum of states and inputs: coefficients by name
COMMAND = "command"  # Name of the present command in a row


def total(terms: Iterable[tuple[Number, Mapping[str, Number]]]) -> Row:
    """Return a weighted sum of rows. For a weight that is the integer 1, the function omits the product."""
    found: Row = {}
    for weight, row in terms:
        for name, x in row.items():
            share = x if type(weight) is int and weight == 1 else times(weight, x)
            if not nothing(share):
                found[name] = add(found.get(name, 0), share)
    return found


def substituted(row: Row, name: str, by: Row) -> Row:
    """Return a row after replacing one state or input by a sum."""
    rest = {other: x for other, x in row.items() if other != name}
    return total([(1, rest), (row.get(name, 0), by)])


def late(memory: dict[str, Row], name: str, row: Row, samples: int) -> Row:
    """Return a row delayed by some samples, and add the states that store the row to the memory."""
    for ago in range(1, samples + 1):
        memory.setdefault(f"{name}[k-{ago}]", row)
        row = {f"{name}[k-{ago}]": 1}
    return row


def low_passed(memory: dict[str, Row], name: str, row: Row, share: Number, order: int) -> Row:
    """Return a row after the firmware's low-passes y += a (x - y), and add their states to the memory."""
    for number in range(1, order + 1):
        kept = f"{name} low-pass {number}[k-1]"
        row = memory[kept] = total([(share, row), (1 - share, {kept: 1})])
    return row


class Timing(NamedTuple):
    """The times at which commands act and at which the sensor samples the force."""

    whole: int  # whole samples in the delay of the command and in the delay of the sensor alone
    sensed: int
    older: Number | None  # share of a sample in which the previous command acts; None if it does not act
    within: Number | None  # share of a sample after which the sensor samples the force; None for the end of the sample
    carried: bool  # whether the previous command acts at that time; only read if `within` is not None


def timing(plain: Device, device: Device) -> Timing:
    """Return the timing of a device."""
    T = plain.sample_time
    (whole, rest), (sensed, left) = (split_delay(delay, T) for delay in (plain.latency, plain.sensing.delay))
    together, _ = split_delay(plain.sensed_latency, T)
    T = device.sample_time
    return Timing(
        whole,
        sensed,
        (device.latency - whole * T) / T if rest else None,
        1 - (device.sensing.delay - sensed * T) / T if left else None,
        together > whole + sensed,
    )


class Chain(NamedTuple):
    """The states x' = A x + b u, T = 1."""

    names: tuple[str, ...]  # names of the states
    rates: Matrix  # A
    push: Vector  # b

    def over(self, share: Number, older: Number | None, now: Row, before: Row, ops: Arithmetic) -> list[Row]:
        """Return the change of the states over a share of a sample."""
        whole: Matrix = (
            *((*row, push) for row, push in zip(self.rates, self.push, strict=True)),
            (0,) * (len(self.names) + 1),
        )
        if not isinstance(share, int):
            whole, older = scaled(whole, share), None if older is None else older / share
        step, newer, left = stepped(whole, older, ops)
        return [
            total([(1, dict(zip(self.names, step[i], strict=False))), (newer[i], now), (left[i], before)])
            for i in range(len(self.names))
        ]


def sensed(
    memory: dict[str, Row], chain: Chain, at: Timing, inputs: tuple[Row, Row], felt: tuple[Row, Number], ops: Arithmetic
) -> Row:
    """Return the sensor's sample of a sum of a chain's states and of the command that acts on the chain."""
    (now, before), (weights, feed) = inputs, felt
    if at.within is None:
        return late(memory, "sensed", total([(1, weights), (feed, before)]), at.sensed)
    acting = before if at.carried else now
    moved = chain.over(at.within, None if at.carried else at.older, acting, before, ops)
    rows = (total([(1, {name: 1}), (1, row)]) for name, row in zip(chain.names, moved, strict=True))
    terms = [(weights.get(name, 0), row) for name, row in zip(chain.names, rows, strict=True)]
    return late(memory, "sensed", total([*terms, (feed, acting)]), at.sensed + 1)
