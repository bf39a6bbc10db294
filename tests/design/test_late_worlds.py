"""Problems with environments that run late or by Euler's rules: what is refused and what is said (model/README.md,
section 20)."""

from __future__ import annotations

import json
import re
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from command import run
from vctune.analysis.worlds.growing_in_time import growing_in_time

from vctune.analysis.in_hands import least_ratios, ratio_in_some_hands
from vctune.api.exporting import export
from vctune.api.solving import solve
from vctune.design.prepared import Posed, prepare
from vctune.design.result import Polished
from vctune.design.search import exchange
from vctune.design.search.scan import scan
from vctune.design.verdict.judge import Status, judge
from vctune.design.verdict.parameter_changes import parameter_changes
from vctune.design.verdict.repair import OF_FIXED, find_repairs
from vctune.document.reading import parse_problem, read_problem
from vctune.document.records.certificate_json import EnvironmentRecord, HandRecord
from vctune.document.text.errors import InputError
from vctune.exit_codes import ExitCode
from vctune.model.problem import Problem
from vctune.proof.engine.interval import Verdict
from vctune.running import OutOfTimeError

DEVICE = """[device]
mass = 0.4
damping = 2.0
sample_time = 1e-3
[operator]
mass = { min = 0.0, max = 0.5 }
damping = { min = 0.0, max = 30.0 }
stiffness = { min = 0.0, max = 3000.0 }
"""
LATE = """[environment]
mass = { max = 0.0 }
damping = { max = 5.0 }
stiffness = { max = 500.0 }
rule = "explicit"
late = 2
"""
FREE = """[gains]
velocity = { min = 1.0, max = 1000.0 }
position = { min = 3000.0, max = 1e5 }
[coupling]
damping = { min = 1e-3, max = 1e5 }
mass = { min = 1e-4, max = 1e4 }
drag = { min = 1e-3, max = 50.0 }
"""
FIXED = """[gains]
velocity = 230.0
position = 1e5
[coupling]
damping = 158.0
mass = 0.058
drag = 2.15
"""
BAND = "[transparency]\nband_hz = [0.5, 30.0]\nreference_impedance = 10.0\n"
STEPPED = "stepped by explicit Euler, 2 samples late"
EXPERIMENT = (
    '[[experiment]]\nname = "one"\noperator = { to = 0.01, speed = 0.05, cycles = 1 }\n[experiment.environment]\n'
)
BASELINE = "[experiment.baseline]\nkp = 1.0\nki = 0.0\nkd = 1.0\nmass = 1.0\ndamping = 1.0\n"
ALL = ["mass = { max = 1.0 }", "damping = { max = 5.0 }", "stiffness = { max = 500.0 }"]


def box(*lines: str) -> str:
    """Return a table of environments."""
    return "\n".join(["[environment]", *lines, ""])


REFUSED = {
    "mass without max": (box(*ALL[1:], "late = 2"), 9, "environment.mass", "needs a max with late = 2: such environm"),
    "damping without max": (
        box(ALL[0], "damping = { min = 1.0 }", ALL[2], "late = 2"),
        11,
        "environment.damping",
        "needs a max with late = 2: such environments are not passive, and a great damping makes every loop grow",
    ),
    "stiffness without max": (
        box("mass = { max = 0.0 }", ALL[1], 'rule = "explicit"'),
        9,
        "environment.stiffness",
        'needs a max with rule = "explicit": such environments are not passive',
    ),
    "damping that has no max": (box(*ALL), 11, "environment.damping.max", "passive as they run, of which the claim"),
    "nor has it by implicit Euler": (
        box(*ALL, 'rule = "implicit"'),
        11,
        "environment.damping.max",
        "of which the claim covers every one; leave it out",
    ),
    "a light mass": (box(*ALL, 'rule = "explicit"'), 10, "environment.mass", 'needs a min > 0 with rule = "explicit"'),
    "a mass that is an odd number of samples late": (
        box(*ALL, "late = 3"),
        10,
        "environment.mass.max",
        "must be 0 with late = 3: by the trapezoidal rule, every mass",
    ),
    "late walls": (box(*ALL, "late = 2", "walls = true"), 14, "environment.walls", "not late = 2: the condition"),
    "explicit walls": (
        box("mass = { max = 0.0 }", *ALL[1:], 'rule = "explicit"', "walls = true"),
        14,
        "environment.walls",
        'not rule = "explicit"',
    ),
    "too late": (box(*ALL, "late = 12"), 13, "environment.late", "must be at most 10"),
    "an experiment's late wall": (
        EXPERIMENT + "stiffness = 9.0\nwall = true\nlate = 2\n",
        15,
        "experiment[0].environment.late",
        "a wall is simulated on time alone",
    ),
    "an experiment's explicit wall": (
        EXPERIMENT + 'stiffness = 9.0\nwall = true\nrule = "explicit"\n',
        15,
        "experiment[0].environment.rule",
        "a wall is passive by backward Euler alone",
    ),
    "a late baseline": (
        EXPERIMENT + "stiffness = 9.0\nlate = 2\n" + BASELINE,
        15,
        "experiment[0].baseline",
        "the regular PID renders environments on time alone",
    ),
    "an explicit baseline": (
        EXPERIMENT + 'stiffness = 9.0\nrule = "explicit"\n' + BASELINE,
        15,
        "experiment[0].baseline",
        "the regular PID renders environments on time alone, and not by explicit Euler; leave it out",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_proved_or_simulated_is_refused(name: str) -> None:
    """With line, key and reason."""
    table, line, key, reason = REFUSED[name]
    with pytest.raises(InputError) as refused:
        parse_problem(DEVICE + table, "late.toml", "late")
    (mistake,) = refused.value.mistakes
    assert (mistake.line, mistake.key) == (line, key)
    assert reason in mistake.message


@pytest.mark.parametrize(
    "table",
    [
        box(*ALL, "late = 2"),
        box("mass = { min = 0.5, max = 1.0 }", *ALL[1:], 'rule = "explicit"'),
        box(*ALL, 'rule = "explicit"', "late = 1"),
        box(*ALL, 'rule = "implicit"', "late = 1"),
        box(ALL[0], ALL[2], 'rule = "implicit"'),
        EXPERIMENT + 'mass = 1.0\nrule = "explicit"\nlate = 10\n',
    ],
)
def test_their_neighbours_are_allowed(table: str) -> None:
    """Every number with its limits; by implicit Euler on time none of damping."""
    assert parse_problem(DEVICE + table, "late.toml", "late").name == "late"


def test_a_late_mass_behind_a_coupling_that_is_a_mass_is_allowed() -> None:
    """The pole at -1 of the coupling's mass may outweigh that of the environment's mass."""
    text = Path("problems/arm-contact.toml").read_text() + box(*ALL, "late = 1")
    assert parse_problem(text, "rigid.toml", "rigid").worlds is not None
    with pytest.raises(InputError, match="an odd number of samples late"):
        parse_problem(text.replace("damping = inf", "damping = 100.0"), "soft.toml", "soft")


@pytest.mark.slow
def test_a_late_world_is_solved(tmp_path: Path) -> None:
    """The search finds a design that the prover passes."""
    path = tmp_path / "late.toml"
    path.write_text(DEVICE + LATE + FREE + BAND)
    found = solve(path)
    assert found.status is Status.CERTIFIED
    assert found.judgement is not None
    assert found.judgement.certificate.outcomes["worlds"].verdict is Verdict.PROVED


def written(folder: Path, drag: str = "2.15") -> Path:
    """Write a problem with fixed gains."""
    path = folder / "late.toml"
    path.write_text(DEVICE + LATE + FIXED.replace("2.15", drag) + BAND)
    return path


def test_given_gains_are_checked(tmp_path: Path) -> None:
    """With rule and lateness in the message."""
    passed = run("check", str(written(tmp_path)), cwd=tmp_path)
    assert passed.returncode == ExitCode.OK
    assert f"every environment of 0 kg, up to 5 N s/m, up to 500 N/m, {STEPPED} up to Nyquist" in passed.stdout


def test_less_drag_than_the_spring_takes_is_refuted(tmp_path: Path) -> None:
    """A spring of the box makes it grow, and is not called lossless."""
    posed = read_problem(written(tmp_path, "0.2")).problem
    judgement = judge(posed, *posed.fixed_design)
    outcome, held = judgement.certificate.outcomes["worlds"], judgement.in_hand
    assert outcome.verdict is Verdict.REFUTED
    assert posed.worlds is not None
    found = growing_in_time(posed.device, *posed.fixed_design, held.hand, held.omega, posed.worlds)
    assert found is not None and found.growth > 0
    made = EnvironmentRecord(
        hand=HandRecord(mass=0.0, damping=0.0, stiffness=0.0),
        kind=found.kind,
        value=found.value,
        unit="N/m",
        damping=found.damping,
        hz=1.0,
        growth_per_s=found.growth,
        rule="explicit",
        late=found.late,
    )
    assert f"with a spring of 500 N/m, {STEPPED}, e-fold" in made.in_words(posed.units)


def test_the_page_says_what_is_proved(tmp_path: Path) -> None:
    """The sentence has rule and lateness; there is no map of environments on time, and nothing is called passive."""
    done = run("solve", str(written(tmp_path)), "--out", str(tmp_path), cwd=tmp_path, report=True)
    assert done.returncode == ExitCode.OK and "rendered" not in done.stdout
    folder = tmp_path / "late"
    assert not (folder / "z-width.svg").exists()
    page = re.sub(r"(?s)<(script|style)\b.*?</\1>|<[^>]+>", "", (folder / "report.html").read_text())
    assert f"{STEPPED}, at every frequency" in page
    assert "What may be rendered" not in page
    assert "trapezoidal" not in page
    assert "are not passive as they run" in page
    assert "for any passive environment, which is more" not in page
    record = json.loads((folder / "design.json").read_text())
    assert record["certificate"]["hands"]["worlds_late"] == 2


def test_the_exported_files_say_how_the_environments_are_stepped(tmp_path: Path) -> None:
    """And that the built-in environment is another one."""
    (assumed,) = json.loads(export(written(tmp_path), to="json").files["controller.json"])["assumed"]
    assert f"those of the box, {STEPPED}; the built-in environment is neither" in assumed
    assert "trapezoidal" not in assumed


def test_a_relaxation_that_does_not_suffice_is_tried_once() -> None:
    """No hands and no environments are easy enough for a velocity loop that is unstable by itself."""
    text = DEVICE + LATE + FIXED.replace("drag = 2.15", "drag = 1e-9") + BAND
    text = text.replace("velocity = 230.0", "velocity = 1000.0")
    changes = parameter_changes(tomllib.loads(text), parse_problem(text, "x", "x"))
    tried = [0]

    def estimate(problem: Problem) -> bool:
        tried[0] += 1
        return OF_FIXED.estimate(problem)

    worlds = [change for change in changes if change.path[0] in ("environment", "operator")]
    assert all(change.eases for change in worlds) and len(worlds) > 5
    assert not find_repairs(tomllib.loads(text), worlds, replace(OF_FIXED, estimate=estimate))
    assert tried[0] <= len(worlds)


def test_most_relaxations_are_excluded_without_a_refinement(monkeypatch: pytest.MonkeyPatch) -> None:
    """The ratio on a grid is not below the refined one, so a grid excludes most changes of a refused design."""
    text = DEVICE + LATE + FIXED.replace("damping = 158.0", "damping = 80.0") + BAND
    problem = parse_problem(text, "x", "x")
    gains, coupling = problem.fixed_design
    for share in (0.3, 1.0, 3.0):
        scaled = coupling.times(share)
        least = min(each.ratio for each in least_ratios(problem, gains, scaled))
        assert least <= ratio_in_some_hands(problem, gains, scaled) <= 1.3 * least
    refined = list[Problem]()

    def counted(posed: Problem, *design: Any) -> Any:
        refined.append(posed)
        return least_ratios(posed, *design)

    monkeypatch.setattr("vctune.design.verdict.repair.least_ratios", counted)
    changes = parameter_changes(tomllib.loads(text), problem)
    find_repairs(tomllib.loads(text), changes, replace(OF_FIXED, verify=lambda _: None))
    assert 0 < len(refined) < 50  # of some 130 trials


def test_a_time_limit_between_the_two_exchanges_leaves_the_answer_of_the_first(monkeypatch):
    scaled = prepare(parse_problem(DEVICE + LATE, "x", "x")).scaled
    scanned, exchanged, errors = scan(scaled), exchange._exchanged, []

    def cut(posed: Posed, *given: Any, **also: Any) -> Polished | None:
        if errors:
            raise OutOfTimeError
        found = exchanged(posed, *given, **also)
        errors.append(found.error)
        return found

    monkeypatch.setattr(exchange, "_exchanged", cut)
    found = exchange.polish(scaled, scanned.starts[0], scanned)
    assert found is not None and [found.error] == errors
