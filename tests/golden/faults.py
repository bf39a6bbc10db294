"""Plant one fault after another in a copy of the package, and see the golden answers turn red for each.

`python tests/golden/faults.py [WORD]` takes some minutes and prints which test caught which fault; it exits with 1 if
a fault goes unseen. It is not part of CI: run it after a change of the golden answers or of what a fault names.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

MOVED = "the fault has no place in"
ROOT = Path(__file__).parent.parent.parent
PATIENCE = 1200
"""Seconds after which a fault that keeps an answer from coming has been seen."""
COPIED = ("vctune", "problems", "tests", "pyproject.toml")
OF_PROOF = ("tests/proof", "tests/model/test_matrices.py")
FAULTS = {
    "the hold's half sample is lost": (
        "model/device.py", "return self.sample_time / 2 + self.latency", "return self.latency"),
    "the hold is a constant": (
        "model/loop/device_response.py", "modulus = ops.sinc(omega * half)", "modulus = ops.sinc(0 * omega)"),
    "the fraction of a sample is lost": (
        "model/sampled/circle.py", "return floor(samples), samples - floor(samples)",
        "return floor(samples), 0.0"),
    "a delay just below a whole sample is not looked at": (
        "proof/certificate.py", "    for device in beside_whole_sample(design.device, hands):",
        "    for device in ():"),
    "the force sensor is ideal": (
        "model/loop/device_response.py", "sensor = sensor_response(device, omega, ops)", "sensor = None"),
    "a corner frequency is read in rad/s": (
        "model/loop/filters.py", "time = 1 / (2 * ops.pi * bandwidth_hz)", "time = 1 / (1 * bandwidth_hz)"),
    "a differenced velocity does not lag": (
        "model/loop/filters.py", "T / 2 * (half_sinc * half_sinc)", "0 * T * (half_sinc * half_sinc)"),
    "the firmware's low-pass is twice as fast": (
        "model/loop/filters.py", "x = 2 * ops.pi * known.filter_hz", "x = 4 * ops.pi * known.filter_hz"),
    "an interpolated command is a held one": (
        "model/sampled/servo_plant.py", "interpolated = device.interpolates", "interpolated = False"),
    "undecided is read as proved": (
        "proof/outcome.py", "(Verdict.REFUTED, Verdict.UNDECIDED, Verdict.PROVED)",
        "(Verdict.REFUTED, Verdict.PROVED, Verdict.UNDECIDED)"),
    "the last claim is dropped": (
        "proof/certificate.py", "asked = claims_asked(demands, box)\n", "asked = claims_asked(demands, box)[:-1]\n"),
    "the safety factor is not applied": (
        "model/problem.py", "factor=stability.safety_factor,", "factor=1.0,"),
    "the least operator does not help": (
        "model/loop/llewellyn.py", "return excess if loop.operator_relief is None else excess - loop.operator_relief",
        "return excess"),
    "R of a passive hand is half": (
        "model/loop/llewellyn.py", "(product - P) / loop.scale2", "(product - P) / (2 * loop.scale2)"),
    "R in a hand is half": (
        "model/sampled/hand_loop.py", "return Required(-0.5 * (P.odd", "return Required(-0.25 * (P.odd"),
    "a servo's motion between samples is not seen": (
        "model/sampled/hand_loop.py", "Required(loop.blur - 0.5", "Required(0 * loop.blur - 0.5"),
    "a vertex of the box of hands is skipped": (
        "proof/claims/in_hands.py", "low = high = list(corners)", "low = high = list(corners)[:-1]"),
    "the box of devices is its middle": (
        "proof/claims/in_hands.py", "box.low.number(key), box.high.number(key))",
        "box.nominal.number(key), box.nominal.number(key))"),
    "the drag is counted twice": (
        "model/gains.py", "return Pair(coupling.drag + b_c", "return Pair(2 * coupling.drag + b_c"),
    "the coupling's mass is felt in grams": (
        "model/gains.py", "reactance = m_c * omega\n    if coupling.rigid:\n        return",
        "reactance = 1e-3 * m_c * omega\n    if coupling.rigid:\n        return"),
    "tracking is no part of the error": (
        "analysis/demands.py", "        + weights.tracking**2 * squares.tracking\n", ""),
    "the search sees one hand": (
        "analysis/loops_in_hands.py", "return Hand(*(number.ravel() for number in each))",
        "return Hand(*(number.ravel()[:1] for number in each))"),
    "an unstable loop is taken for a stable one": (
        "proof/claims/poles.py", "return Outcome(Verdict.REFUTED, boxes)\n",
        "return Outcome(Verdict.PROVED, boxes)\n"),
    "a number of [operator] is the least of a range": (
        "document/schema/defaults.py", "    if isinstance(value, float):\n        return Range(value, value)",
        "    if isinstance(value, float):\n        return Range(value, max(value, high))"),
    "the environments' stiffest spring is not seen": (
        "model/sampled/loop_in_worlds.py", "factor * (soft * size)", "0 * (soft * size)"),
    "the environments' lightest mass is the heaviest": (
        "model/sampled/loop_in_worlds.py", "light, soft = low.mass * inertia",
        "light, soft = high.mass * inertia"),
    "an actuator lags a tenth of what it does": (
        "model/loop/filters.py", "actuator.bandwidth_hz * device.sample_time",
        "10 * actuator.bandwidth_hz * device.sample_time"),
    "the limit of |S| is twice as high": (
        "model/problem.py", "max_sensitivity=stability.max_sensitivity,",
        "max_sensitivity=2 * stability.max_sensitivity,"),
    "the disc of devices is half as wide": (
        "proof/claims/sensitivity.py", "- radius * radius * loop.abs2()",
        "- 0.25 * radius * radius * loop.abs2()"),
    "a refuted check exits with 0": (
        "exit_codes.py", "FAILED = 1", "FAILED = 0"),
    "a torn row of a sweep stays": (
        "study/rows.py", "    os.ftruncate(handle, os.fstat(handle).st_size - len(torn))\n", ""),
    "the exported velocity gain is rounded": (
        "firmware/firmware.py", 'repr(number) if precision == "double"', '"%.6g" % number if precision == "double"'),
    "a repair that was not proved is listed": (
        "design/advice/repair.py", "solved.status is Status.CERTIFIED else None", "True else None"),
    "a mistake is told a line late": (
        "document/text/toml.py", "        return without + 1\n", "        return without + 2\n"),
    "every problem without a design is proved infeasible": (
        "design/solve.py", "nearest_miss(prepared, scanned, proved=proved)",
        "nearest_miss(prepared, scanned, proved=True)"),
    "a search that ended early proves that there is no design": (
        "design/search/infeasible.py", "proved=False", "proved=True"),
    "a sum of intervals is not rounded outwards": (
        "proof/enclosures/intervals.py", "(rad + UNIT * np.abs(mid)) * SWELL", "rad * SWELL"),
    "the product of two radii is lost": (
        "proof/enclosures/intervals.py", "self.rad * (np.abs(other.mid) + other.rad)", "self.rad * np.abs(other.mid)"),
    "a root has no rounding": (
        "proof/enclosures/intervals.py", "high = np.sqrt(self.mid + self.rad)", "high = low"),
    "a decimal is the double beside it": (
        "proof/enclosures/intervals.py", "return Enclosure(x, UNIT * np.abs(x))", "return Enclosure(x, 0 * np.abs(x))"),
    "a sum of products has no rounding": (
        "proof/enclosures/intervals.py", "b.rad + len(b.mid) * UNIT * size_b", "b.rad"),
    "half of the width of a sine's argument": (
        "proof/enclosures/intervals.py", "Enclosure(sine, np.abs(cosine) * x.rad", "Enclosure(sine, 0.5 * x.rad"),
    "one of two cases is taken for both": (
        "proof/enclosures/intervals.py", "sure = x.positive()", "sure = x.mid > 0"),
    "a sine is wrong by a hundred units in the last place": (
        "proof/enclosures/elementary.py", "sine, cosine = r + r *", "sine, cosine = (1 + 100 * UNIT) * r + r *"),
    "an exponential's series is too short": (
        "proof/enclosures/elementary.py", "for n in range(1, 14)]", "for n in range(1, 11)]"),
    "a quarter turn ends at its 65th bit": (
        "proof/enclosures/elementary.py", "QUARTER_REST = float", "QUARTER_REST = 0 * float"),
    "a function has no remainder": (
        "proof/enclosures/taylor.py", "remainder = third_derivative / 6 * reach**3", "remainder = 0 * reach**3"),
    "a function's value has no error": (
        "proof/enclosures/taylor.py", "radii[-1] += error + (HIGHER_ERROR", "radii[-1] += (HIGHER_ERROR"),
    "a product's terms of third order are lost": (
        "proof/enclosures/taylor.py", "times(A.linear_by_row, B.half_quadratic) + ", ""),
    "a bound is that at the middle of a slope": (
        "proof/enclosures/taylor.py", "lower = -np.abs(slopes + 2 * moved).sum(axis=0)", "lower = 0"),
    "a bound forgets the remainders": (
        "proof/enclosures/taylor.py", "bound = constant + lower - lost.sum(axis=0) - rest.sum(axis=0)",
        "bound = constant + lower - lost.sum(axis=0)"),
    "a box that stays open is forgotten": (
        "proof/prover.py", "open_[:, boxes.owner[stays]] = found.guide.point[:, stays]", "pass"),
    "a curve that may pass 0 has an angle": (
        "proof/box_tests.py", "return np.where(sided, np.arctan2", "return np.where(True, np.arctan2"),
    "a turn is counted twice": (
        "proof/claims/poles.py", "(goal - found.total) / turn", "2 * (goal - found.total) / turn"),
    "the last whole sample of an uncertain delay is skipped": (
        "proof/claims/covered.py", "floor(self.high[row, 0] / T) + 1)", "floor(self.high[row, 0] / T))"),
    "the band ends an interval early": (
        "proof/boxes.py", "return edges[:-1], edges[1:]", "return edges[:-2], edges[1:-1]"),
    "a half of a halved box is lost": (
        "proof/boxes.py", "return joined(replace(self, high=left), replace(self, low=right))",
        "return joined(replace(self, high=left))"),
    "the hands next to the softest are not looked at": (
        "proof/claims/in_hands.py", "low = high = list(corners)", "low = high = list(corners)[1:]"),
}  # fmt: skip


def planted(name: str, folder: Path) -> str:
    """Return the first failing test with a fault planted; "" if the answers stay."""
    path, old, new = FAULTS[name]
    file = folder / "vctune" / path
    text = file.read_text()
    if old not in text:
        return f"{MOVED} {path} any more"
    try:
        file.write_text(text.replace(old, new))
        return failing(folder, path)
    finally:
        file.write_text(text)


def failing(folder: Path, path: str = "") -> str:
    """Return the first golden answer, claim beside its limit or, for a fault of the proof, enclosure that a copy of the
    package gets wrong; "" for none."""
    nets = (*OF_PROOF * path.startswith("proof/"), "tests/golden", "tests/test_claims.py")
    command = (sys.executable, "-m", "pytest", "-q", "-x", "-n", "2", "-m", "slow or not slow", *nets)
    env = os.environ | {"PYTHONPATH": str(folder)}
    try:
        done = subprocess.run(
            command, cwd=folder, env=env, capture_output=True, text=True, check=False, timeout=PATIENCE
        )
    except subprocess.TimeoutExpired:
        return f"no answer in {PATIENCE} s"
    caught = re.search(r"^(?:FAILED|ERROR) \S*::(\S+)", done.stdout, re.MULTILINE)
    return caught[1] if caught else "" if done.returncode == 0 else done.stdout[-300:]


def main() -> int:
    """Plant each fault whose name has the given word."""
    chosen = [name for name in FAULTS if not sys.argv[1:] or sys.argv[1] in name]
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        for name in COPIED:
            copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
            copy(ROOT / name, folder / name)
        if wrong := failing(folder):
            sys.exit(f"without a fault: {wrong}")
        unseen = 0
        for name in chosen:
            caught = planted(name, folder)
            unseen += not caught or caught.startswith(MOVED)
            print(f"{'red  ' if caught else 'GREEN'} {name}: {caught}", flush=True)  # noqa: T201
    return int(unseen > 0)


if __name__ == "__main__":
    sys.exit(main())
