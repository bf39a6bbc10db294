"""Write results/criteria.md: each problem under each criterion, and how many random hands and environments break it.

Run by hand: `python tests/criteria.py`. Hands are of the problem's box, environments m s + b + k/s by the trapezoidal
rule; a loop grows if it is unstable in the hand alone, or if Z_c + Z_e + Z_seen has a zero outside the unit circle, by
the turns of both around 0 on a grid: an estimate, with formulas of the package. Oracles that share nothing with it are
in `test_proof_in_hands.py`.
"""

from __future__ import annotations

import signal
import sys
import tomllib
from dataclasses import astuple
from pathlib import Path

import numpy as np

from vctune.api.solving import solve
from vctune.document.building import problem as stated
from vctune.model.hands import Hand
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.sampled.hand_loop import loop_in_hand
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand

ROOT = Path(__file__).parents[1]
TRIES, TOGETHER, SECONDS = 10_000, 500, 120
ANGLES = np.append(np.geomspace(1e-4, np.pi / 2, 500), np.pi - np.geomspace(np.pi / 2, 1e-4, 200)[1:])
LEFT_OUT = ("infeasible", "fixed-gains")


def turns(curve):
    """Return whether curves, real and positive at both ends of the axis, turn around 0 between them."""
    phase = np.unwrap(np.angle(curve), axis=-1)
    return np.abs(phase[:, -1] - np.angle(curve[:, -1])) > np.pi


def random_loops(rng, problem, count):
    """Return hands of the box, and masses, dampings and stiffnesses of environments, each of shape (count, 1)."""
    low, high = (np.array(astuple(end)) for end in (problem.hands.low, problem.hands.high))
    share = np.where(rng.random((count, 3)) < 0.3, rng.integers(0, 2, (count, 3)), rng.random((count, 3)) ** 2)
    hands = Hand(*(low + (high - low) * share).T[..., None])
    scale = problem.device.mass * (2 * np.pi * 10) ** np.array([[0], [1], [2]])
    m, b, k = scale * 10 ** rng.uniform(-5, 2, (3, count))
    return hands, m[:, None], np.where(rng.random(count) < 0.5, 0.0, b)[:, None], k[:, None]


def broken(problem, judgement, count=TRIES):
    """Return in how many random hands and environments a design grows."""
    rng, device, found = np.random.default_rng(1), problem.device, 0
    gains, coupling = judgement.gains, judgement.coupling
    half = ANGLES / 2
    s = 2j / device.sample_time * np.tan(half)
    Z_c = coupling.drag + coupling.damping * coupling.mass * s / (coupling.damping + coupling.mass * s)
    for _ in range(0, count, TOGETHER):
        hands, m, b, k = random_loops(rng, problem, TOGETHER)
        plant = plant_in_hand(device, hands, delays_of(device), FLOATS)
        loop, order = loop_in_hand(plant, ANGLES, FLOATS), len(plant.push) + plant.order
        F, P = loop.closed(gains), loop.numerator(gains)
        F, P = (x.even + 1j * np.sin(half) * x.odd for x in (F, P))
        unstable = turns(F * np.exp(-1j * half * order))
        slow = np.sqrt(m / k)  # both ends of the axis count
        total = (Z_c + m * s + b + k / s + P / (2j * np.sin(half) * F)) * s * slow / (1 + s * slow) ** 2
        found += int((unstable | turns(total)).sum())
    return found


def row(path, criterion):
    """Return a line of the table."""
    document = tomllib.loads(path.read_text())
    document.setdefault("stability", {})["criterion"] = criterion
    document.pop("experiment", None)
    file = stated(document)
    signal.alarm(SECONDS)
    try:
        solved = solve(file)
    except TimeoutError:
        return f"| {path.stem} | {criterion} | – | no answer within {SECONDS} s | |"
    finally:
        signal.alarm(0)
    if solved.judgement is None:
        return f"| {path.stem} | {criterion} | – | {solved.status.value} | |"
    grows = broken(solved.problem, solved.judgement)
    return f"| {path.stem} | {criterion} | {solved.judgement.error:.4g} | {solved.status.value} | {grows} |"


def main():
    def stop(*_):
        raise TimeoutError

    signal.signal(signal.SIGALRM, stop)
    head = [
        "# Criteria",
        "",
        f"The table shows each problem under each criterion, and in how many of {TRIES:,} random hands of its box the",
        "design grows with a random environment (a mass, a damper and a spring together, as the firmware runs them).",
        "`python tests/criteria.py` made the table and describes the method.",
        "",
        "| problem | criterion | error | verdict | grows in |",
        "|---|---|---|---|---|",
    ]
    lines = []
    for path in sorted((ROOT / "problems").glob("*.toml")):
        if path.stem not in LEFT_OUT and not stated(path).problem.device.kind.inverse:
            for criterion in ("passive", "hands", "both"):
                lines.append(row(path, criterion))
                sys.stdout.write(lines[-1] + "\n")
    (ROOT / "results/criteria.md").write_text("\n".join([*head, *lines]) + "\n")


if __name__ == "__main__":
    main()
