"""Compute the characteristic polynomial of the sampled loop, whose zeros are the loop's poles (model/README.md, section
7)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest
from math import comb

from vctune.model.gains import Gains
from vctune.model.numbers.arithmetic import Number
from vctune.model.sampled.velocity_loop import Polynomial, SampledPlant


def characteristic_polynomial(plant: SampledPlant, gains: Gains) -> list[Number]:
    """Return the coefficients of the sampled loop's characteristic polynomial, highest power of z first."""
    K_v, K_p = gains.velocity, gains.position
    difference, unit = [1, -1], [1]
    low_pass = unit
    for _ in range(plant.order):
        low_pass = _times(low_pass, _in_w((plant.low_pass, 1), 1))
    gain = 1 if plant.low_pass is None else plant.low_pass**plant.order

    def input_path(taps: tuple[Polynomial, Polynomial]) -> list[Number]:
        late = [0] * plant.whole_samples
        path = [*late, *_in_w(taps[0], len(taps[0]))]
        return _plus(path, [*late, 0, *_in_w(taps[1], len(taps[1]))]) if plant.fractional else path

    open_loop = _times(_in_w((*plant.open, 1), len(plant.open)), low_pass)
    velocity = [K_v * gain * c for c in input_path(plant.velocity)]
    if K_p == 0:
        return _plus(open_loop, velocity)
    travel = _times(input_path(plant.position), low_pass)
    return _plus(_times(_plus(open_loop, velocity), difference), [K_p * c for c in travel])


def _in_w(coefficients: Sequence[Number], degree: int) -> list[Number]:
    """Return the sum of c_k d^k w^(degree - k), d = 1 - w, as coefficients of w, lowest power first."""
    total: list[Number] = [0] * (degree + 1)
    for k, c in enumerate(coefficients):
        for i in range(k + 1):
            at = degree - k + i
            total[at] = total[at] + c * ((-1) ** i * comb(k, i))
    return total


def _times(a: Sequence[Number], b: Sequence[Number]) -> list[Number]:
    total: list[Number] = [0] * (len(a) + len(b) - 1)
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            total[i + j] = total[i + j] + x * y
    return total


def _plus(a: Sequence[Number], b: Sequence[Number]) -> list[Number]:
    return [x + y for x, y in zip_longest(a, b, fillvalue=0)]
