"""The study file: every mistake with its line, its key and its remedy; axes, samples, points."""

from __future__ import annotations

from math import inf

import pytest

from vctune.document.reading import on_yardstick, parse_problem
from vctune.document.schema.statement import statement
from vctune.document.study_file import number_keys, read_study
from vctune.document.text import toml
from vctune.study.study_table import points

BARE = "[device]\nmass = 0.4\ndamping = 2.0\nsample_time = 1e-3\n"
PROBLEM = BARE + "[stability]\ncriterion = 'passive'\nband_hz = [0.5, 100.0]\n"


def study(folder, text, problem=PROBLEM):
    (folder / "device.toml").write_text(problem)
    path = folder / "study.toml"
    path.write_text('problem = "device.toml"\n[axes]\n' + text)
    return read_study(path)


def test_keys_are_those_of_the_schema():
    keys = number_keys()
    assert keys["stability.band_hz[1]"] == ("stability", "band_hz", 1)
    assert keys["gains.velocity.max"] == ("gains", "velocity", "max")
    assert "device.hold" not in keys and "name" not in keys and "transparency.norm" not in keys
    assert len(keys) == len(set(keys.values())) >= 62


def test_a_point_is_the_problem_with_its_numbers_written_in(tmp_path):
    plan = study(tmp_path, '"device.damping" = [3.0]\n"stability.band_hz[1]" = [50.0]\n"coupling.mass" = [0.1]')
    here, faults = plan.at((3.0, 50.0, 0.1))
    text = PROBLEM.replace("2.0", "3.0").replace("100.0", "50.0") + "[coupling]\nmass = 0.1\n"
    assert here == parse_problem(text, "x", "study") and not faults


def test_both_ends_may_be_axes_where_the_problem_has_neither(tmp_path):
    text = '"stability.band_hz[0]" = [0.5]\n"stability.band_hz[1]" = [50.0]\n'
    plan = study(tmp_path, text + '"gains.velocity.min" = [1.0]\n"gains.velocity.max" = [9.0]', BARE)
    here, _ = plan.at((0.5, 50.0, 1.0, 9.0))
    there = parse_problem(
        BARE + "[stability]\nband_hz = [0.5, 50.0]\n[gains]\nvelocity = { min = 1.0, max = 9.0 }",
        "x",
        "study",
    )
    assert here == there


@pytest.mark.parametrize(
    ("key", "end"), [("gains.velocity", "max"), ("operator.mass", "max"), ("coupling.mass", "min")]
)
def test_one_end_of_a_range_at_its_default_may_be_an_axis(tmp_path, key, end):
    """The other end is the default of the device at each point, here of another mass."""
    plan = study(tmp_path, f'"device.mass" = [0.2, 0.8]\n"{key}.{end}" = [0.3]', BARE)
    table, name = key.split(".")
    for mass in (0.2, 0.8):
        bare = on_yardstick(
            toml.parse(BARE.replace("mass = 0.4", f"mass = {mass}"), "x"), parse_problem(BARE, "x", "x")
        )
        default = statement(parse_problem(toml.toml_text(bare), "x", "x"))[table][name]
        text = toml.toml_text(bare | {table: {name: default | {end: 0.3}}})
        assert plan.at((mass, 0.3))[0] == parse_problem(text, "x", "study")
    assert plan.at((0.2, 0.3))[0] != plan.at((0.8, 0.3))[0]


@pytest.mark.parametrize("place", [0, 1])
def test_one_edge_of_a_band_at_its_default_may_be_an_axis(tmp_path, place):
    plan = study(tmp_path, f'"device.sample_time" = [1e-3, 5e-4]\n"stability.band_hz[{place}]" = [3.0]', BARE)
    edges = list(parse_problem(BARE, "x", "x").stability.band.hz)
    edges[place] = 3.0
    for T in (1e-3, 5e-4):
        here = plan.at((T, 3.0))[0]
        assert here.stability.band.hz == pytest.approx(edges) and here.transparency == plan.yardstick
    assert "lower edge" in str(plan.at((1e-3, 1e-3 if place else 1e4))[1])


def test_grid_order_and_ends(tmp_path):
    plan = study(
        tmp_path, '"device.mass" = [2, 1]\n"device.damping" = { log = [0.1, 10], n = 3 }\n"device.delay" = '
        "{ linear = [0, 1e-3], n = 2 }",
    )  # fmt: skip
    made = list(points(plan))
    assert plan.count == len(made) == 12
    assert made[:4] == [(2.0, 0.1, 0.0), (2.0, 0.1, 0.001), (2.0, 1.0, 0.0), (2.0, 1.0, 0.001)]
    assert made[-1] == (1.0, 10.0, 0.001)


def test_points_side_by_side(tmp_path):
    plan = study(tmp_path, '"device.mass" = [1, 2]\n"stability.band_hz[1]" = [50, inf]\n[sample]\nkind = "list"')
    assert list(points(plan)) == [(1.0, 50.0), (2.0, inf)] and plan.count == 2


def test_the_digest_is_of_the_problem_and_the_keys_not_of_the_values(tmp_path):
    one = study(tmp_path, '"device.damping" = [1.0]').sha256
    assert study(tmp_path, '"device.damping" = { log = [1, 2], n = 9 }').sha256 == one
    assert study(tmp_path, '"device.damping" = [1.0]', "# a remark\n" + PROBLEM).sha256 == one
    assert study(tmp_path, '"device.mass" = [1.0]').sha256 != one
    assert study(tmp_path, '"device.damping" = [1.0]', PROBLEM.replace("0.4", "0.5")).sha256 != one
