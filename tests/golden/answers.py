"""The answers of vctune that the golden file records, through public names alone; this module alone knows where they
stand.

`python tests/golden/answers.py` records them again and prints what changed.
"""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from limits import LIMITS, limit

import vctune
from vctune.model.gains import SpringDamper

HERE = Path(__file__).parent
ROOT = HERE.parent.parent
FILE = HERE / "golden.json"
DESIGNS = [
    path
    for folder in ("problems", "problems/extremes", "tests/reference", "tests/basins")
    for path in sorted(
        (ROOT / folder).rglob("*.toml") if folder.startswith("tests") else (ROOT / folder).glob("*.toml")
    )
]
SCALES = {"coupling": (0.5, 0.95, 0.99, 1.5), "velocity": (0.5, 2.0)}
"""Factors of the coupling and of K_v, on either side of what is admissible."""
KINDS = {False: vctune.Coupling, True: SpringDamper}


def name_of(path: Path) -> str:
    """Return the name of a problem in the golden file."""
    return path.relative_to(ROOT).as_posix()


def answer(path: Path) -> dict[str, Any]:
    """Return what solving a problem says: status, claims, error, margins and gains."""
    solved = vctune.solve(path)
    found: dict[str, Any] = {"status": solved.status.value}
    best = solved.judgement
    if best is None:
        return found | {"proved": solved.infeasibility is not None and solved.infeasibility.proved}
    return found | {
        "claims": {claim: outcome.verdict.value for claim, outcome in sorted(best.certificate.outcomes.items())},
        "error": best.error,
        "least ratio": best.min_ratio,
        "gains": [best.gains.velocity, best.gains.position],
        "coupling": {name: getattr(best.coupling, name) for name in best.coupling.__dataclass_fields__},
    }


def coupling_of(found: dict[str, Any]) -> Any:
    """Return the coupling of a recorded answer."""
    return KINDS["stiffness" in found["coupling"]](**found["coupling"])


def near(path: Path, found: dict[str, Any]) -> dict[str, str]:
    """Return the verdict on recorded gains and on gains near them."""
    problem = vctune.read_problem(path).problem
    gains, coupling = vctune.Gains(*found["gains"]), coupling_of(found)
    verdicts = {}
    if found["status"] == "certified":
        verdicts["its error"] = f"{vctune.judge(problem, gains, coupling).error:.6g}"
    for part, factors in SCALES.items():
        for factor in factors if part == "coupling" or gains.velocity > 0 else ():
            law, rendered = gains, coupling
            if part == "velocity":
                law = replace(gains, velocity=factor * gains.velocity)
            else:
                scaled = {name: factor * value for name, value in found["coupling"].items()}
                rendered = replace(coupling, **scaled)
            verdicts[f"{part} x {factor:g}"] = vctune.judge(problem, law, rendered).status.value
    return verdicts


def bad_files() -> dict[str, list[list[Any]]]:
    """Return the code, the key and the line of each mistake in the invalid problems of tests/bad."""
    found = {}
    for path in sorted((ROOT / "tests/bad").glob("*.toml")):
        try:
            vctune.read_problem(path)
            found[path.name] = []
        except vctune.InputError as error:
            found[path.name] = [[each.code, each.key, each.line] for each in error.mistakes]
    return found


def answers() -> dict[str, Any]:
    """Return every answer, by the name of its problem."""
    found: dict[str, Any] = {
        "bad files": bad_files(), "limits": {name: limit(name) for name in LIMITS},
    }  # fmt: skip
    for path in DESIGNS:
        one = answer(path)
        found[name_of(path)] = one | ({"near": near(path, one)} if "gains" in one else {})
        print(name_of(path), found[name_of(path)]["status"], file=sys.stderr)  # noqa: T201
    return found


if __name__ == "__main__":
    before, now = json.loads(FILE.read_text()) if FILE.exists() else {}, answers()
    for name in sorted(before.keys() | now.keys()):
        if before.get(name) != now.get(name):
            print(f"{name}:\n  before {before.get(name)}\n  now    {now.get(name)}")  # noqa: T201
    FILE.write_text(json.dumps(now, indent=1) + "\n")
