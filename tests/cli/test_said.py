"""What a design says beside its verdict: what the hand feels, what K_p holds, what a count of the encoder does."""

from __future__ import annotations

import json
import re
import tomllib
from math import inf, pi

import pytest
from command import run
from conftest import DEVICE, FIXED, for_passive_hands

import vctune
from vctune.design.judging.judge import judge
from vctune.design.records.active import ActiveRecord
from vctune.design.records.design import design_of
from vctune.design.records.felt import in_hand_record
from vctune.document.reading import parse_problem

WALLS = "[environment]\nmass = { min = 0.05, max = 5.0 }\nstiffness = { max = 2000.0 }\nwalls = true\n"
LAW = "[gains]\nvelocity = 115.0\nposition = {}\n[coupling]\ndamping = 40.0\nmass = 0.3\ndrag = 0.1\n"
ENCODER = 'velocity = { from = "difference", resolution = 5e-6 }\n'


pytestmark = pytest.mark.slow  # its designs with a region of walls take seconds


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Designs with walls: one with a spring in its loop and an encoder, one with next to none; and a free one."""
    folder = tmp_path_factory.mktemp("said")
    (folder / "firm.toml").write_text(DEVICE + ENCODER + WALLS + LAW.format(3000.0))
    (folder / "limp.toml").write_text(DEVICE + WALLS + LAW.format(8e-6))
    (folder / "free.toml").write_text(DEVICE)
    done = run("solve", "firm.toml", "limp.toml", "free.toml", cwd=folder, report=True)
    assert done.returncode == 0
    return folder, done.stdout


def page(folder, name):
    return re.sub(r"<[^>]+>|\s", "", (folder / f"results/{name}/report.html").read_text())


def test_a_design_whose_K_p_holds_nothing_says_so_beside_the_verdict(written):
    folder, said = written
    assert "\nlimp: certified, but its K_p holds no static force\n" in said and "firm: certified\n" in said
    assert "holdsnostaticforce" in page(folder, "limp") and "holdsnostaticforce" not in page(folder, "firm")


def test_stable_is_not_rendered(written):
    """A coupling of 40 N s/m in a row with a wall of 2000 N/m is felt as a softer one."""
    folder, said = written
    wall = json.loads((folder / "results/firm/design.json").read_text())["felt"]
    assert wall["wall"] == 2000.0 and 0 < wall["felt_wall_10hz"] < 1500.0
    assert "N/m of the wall of 2000 N/m at 10 Hz: stable, but not rendered to 10 %" in said
    assert said.count("stiffest wall felt") == 2


def test_what_the_hand_feels_is_told(written):
    """With all of its mass in the coupling's, and with the lightest tool behind."""
    assert re.search(
        r"feels like +0.35 +kg and [0-9.]+ N s/m at 1 Hz with 0.05 kg behind; the bare device 0.4 kg", written[1]
    )


def test_the_force_of_a_count_is_resolution_times_K_v_over_T_and_K_p(written):
    folder, said = written
    assert re.search(r"count of the encoder +0\.59 +N", said) and said.count("count of the encoder") == 1
    assert "countoftheencoder" in page(folder, "firm") and "noquantisationoftheencoder" in page(folder, "free")
    digest = vctune.read_problem(folder / "limp.toml").sha256
    assert digest == "ee9d4aaecdd9d8cc6e45957e407dbcfdef6e7fee6c6ca6969b7166eb00ac5042"
    stated = vctune.problem(vctune.read_problem(folder / "firm.toml").problem).problem
    assert stated.device.velocity.resolution == 5e-6


def test_numbers_below_any_meaning_are_0_or_absent(written, tmp_path):
    folder, _ = written
    record = json.loads((folder / "results/free/design.json").read_text())
    record["active"] += [record["active"][0] | {"hz": hz} for hz in (0.0, 1.608e-32)]
    del record["sha256"]
    (tmp_path / "design.json").write_text(json.dumps(record))
    assert run("report", "design.json", cwd=tmp_path).returncode == 0
    text = (tmp_path / "report.html").read_text()
    assert "1.608" not in text and "e-32" not in text and not re.search(r"\b0(, | and )0 Hz", text)


def test_multipliers_are_those_of_every_machine(written):
    record = json.loads((written[0] / "results/free/design.json").read_text())
    assert record["active"] and all(float(f"{row['multiplier']:.9g}") == row["multiplier"] for row in record["active"])


@pytest.mark.parametrize("share", [0.3, 0.94, 1.04, 1.06])
def test_an_active_constraint_has_the_frequency_of_its_claim_only_next_to_it(share: float) -> None:
    """Within 5 % of the peak of |S| it is that peak; elsewhere it is another extremum."""
    checked = vctune.check(tomllib.loads(for_passive_hands(DEVICE + FIXED.format(160.0))))
    record = design_of(checked.finding.record(), "x")
    peak = record.inner_loop.peak_sensitivity_hz
    active = ActiveRecord(demand="|S| <= max_sensitivity", hz=share * peak, multiplier=1.0)
    told = peak if 1 / 1.05 < share < 1.05 else share * peak
    assert record.model_copy(update={"active": [active]}).limits == [f"|S| <= max_sensitivity at {told:.4g} Hz"]


@pytest.mark.parametrize("position, limp", [(40.0, False), (25.0, True)])
def test_a_spring_below_that_of_the_reference_at_the_lower_edge_of_the_band_is_limp(
    position: float, limp: bool
) -> None:
    """K_p < Z_0 omega_min = 31.4 N/m."""
    law = FIXED.format(160.0).replace("6000.0", str(position))
    text = DEVICE + law + "[transparency]\nband_hz = [0.5, 20.0]\nreference_impedance = 10.0\n"
    problem = parse_problem(for_passive_hands(text), "x", "x")
    assert in_hand_record(problem, judge(problem, *problem.fixed_design)).limp == limp


@pytest.mark.parametrize("least", [0.0, 1.0, 2.0])
def test_the_felt_wall_is_the_spring_less_the_coupling_whatever_mass_is_always_behind(least: float) -> None:
    """Of a fast loop k - omega^2 m_c at 10 Hz: the inertia of the least mass of the box is no part of the wall."""
    stated = vctune.problem(
        {
            "device": {"mass": 0.4, "damping": 2.0, "sample_time": 1e-4},
            "gains": {"velocity": 1500.0, "position": 2e4},
            "coupling": {"damping": inf, "mass": 0.5, "drag": 20.0},
            "stability": {"criterion": "hands"},
            "environment": {"mass": {"min": least, "max": 5.0}, "stiffness": {"max": 8000.0}, "walls": True},
        }
    ).problem
    felt = in_hand_record(stated, judge(stated, *stated.fixed_design)).felt_wall_10hz
    assert felt == pytest.approx(8000.0 - (2 * pi * 10.0) ** 2 * 0.5, rel=0.06)


def test_a_number_of_operator_is_that_number_and_a_default_is_what_the_schema_says():
    schema = json.loads(run("schema", "problem", cwd=".").stdout)["$defs"]
    hands = vctune.problem({"device": {"mass": 0.4, "damping": 2.0, "sample_time": 1e-3}}).problem.hands
    for name, key in schema["OperatorTable"]["properties"].items():
        low, high = map(float, re.search(r"Default { min = (\S+), max = (\S+) }", key["description"]).groups())
        assert hands.ranges[name] == (low, high)
    fixed = vctune.problem(
        {"device": {"mass": 0.4, "damping": 2.0, "sample_time": 1e-3}, "operator": {"stiffness": 500.0}}
    ).problem.hands
    assert fixed.ranges["stiffness"] == (500.0, 500.0)
    assert schema["Environment"]["properties"]["rule"]["enum"] == ["backward", "trapezoid", "explicit"]
