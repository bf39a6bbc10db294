"""The study file: every mistake with its line, its key and its remedy; axes, samples, points."""

from __future__ import annotations

from math import inf

import pytest

from vctune.document.reading import on_yardstick, parse_problem
from vctune.document.schema.statement import statement
from vctune.document.study_file import number_keys, read_study
from vctune.document.text import toml
from vctune.document.text.errors import InputError
from vctune.study.study_table import points

BARE = "[device]\nmass = 0.4\ndamping = 2.0\nsample_time = 1e-3\n"
PROBLEM = BARE + "[stability]\ncriterion = 'passive'\nband_hz = [0.5, 100.0]\n"


def study(folder, text, problem=PROBLEM):
    (folder / "device.toml").write_text(problem)
    path = folder / "study.toml"
    path.write_text('problem = "device.toml"\n[axes]\n' + text)
    return read_study(path)


BAD = {
    '"device.dampin" = [1.0]': ('3: axes."device.dampin"', 'did you mean "device.damping"?'),
    '"zzz" = [1.0]': ("3: axes.zzz", "no number of a problem file"),
    '"device.damping" = []': ("3:", "is empty"),
    '"device.damping" = [1.0, true]': ("[1]", "true is not a number"),
    '"device.damping" = [nan]': ("[0]", "not a number"),
    '"device.damping" = "much"': ("3:", "not a set of values; write a list"),
    "device.damping = [1.0]": ("axes.device", 'did you mean "device.damping"? Write the whole key in quotes'),
    '"stability.band_hz" = [1.0]': ("3:", 'did you mean "stability.band_hz[1]"?'),
    '"device.damping" = { log = [0.0, 1.0], n = 3 }': ("log[0]: 0.0", "must be at least"),
    '"device.damping" = { log = [2.0, 1.0], n = 3 }': ("log", "is not below"),
    '"device.damping" = { log = [1.0], n = 3 }': ("log[1]", "is missing; write two numbers"),
    '"device.damping" = { log = [1.0, 2.0] }': ("3:", ".n: is missing; it is required: Number of values."),
    '"device.damping" = { log = [1.0, 2.0], n = 2.5 }': ("2.5", "whole number"),
    '"device.damping" = { lg = [1.0, 2.0], n = 3 }': ("lg", "did you mean log?"),
    '"device.damping" = { log = [1.0, 2.0], linear = [1, 2], n = 3 }': ("3:", "must have one of linear and log"),
    '"device.servo.order" = { linear = [1, 2], n = 3 }': ("3:", "1.5 is not a whole number; write a list"),
    '"gains.velocity" = [1.0]\n"gains.velocity.max" = [2.0]': ("4:", "varies the same number as gains.velocity"),
    '"device.mass" = [1.0]\n[sample]\nkind = "lhs"': ("sample.kind", "\"lhs\" is not one of 'grid' or 'list'"),
    '"device.mass" = [1.0]\n[sample]\nn = 3': ("sample.n", "unknown key; known here: kind"),
    '"device.mass" = [1.0, 2.0]\n"device.damping" = [1.0]\n[sample]\nkind = "list"': ("4:", "need as many"),
    '"device.mass" = { log = [1, 2], n = 2 }\n[sample]\nkind = "list"': ("3:", "side by side need lists"),
    "": ("axes", "is empty; it is required: Numbers of the problem"),
}


@pytest.mark.parametrize("text", BAD, ids=range(len(BAD)))
def test_every_mistake_has_its_place_and_its_remedy(tmp_path, text):
    with pytest.raises(InputError) as refused:
        study(tmp_path, text)
    assert all(part in str(refused.value) for part in BAD[text]), str(refused.value)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "= 3",
        "problem = 3\naxes = 3\nsample = 3",
        'problem = "device.toml"\nsample = 3\n[axes]\n"device.mass" = [1.0]',
        'problem = "x\\u0000y"\n[axes]\n"device.mass" = [1.0]',
        'problem = "."\n[axes]\n"device.mass" = [1.0]',
        'problem = "device.toml"\nname = "x"\n[axes]\n"device.mass" = [1.0]',
        'problem = "device.toml"\n[axes]\n"device.mass" = { linear = [0, 1' + 400 * "0" + "], n = 3 }",
    ],
)
def test_odd_files_are_refused(tmp_path, text):
    (tmp_path / "device.toml").write_text(PROBLEM)
    (tmp_path / "study.toml").write_text(text)
    with pytest.raises(InputError):
        read_study(tmp_path / "study.toml")


def test_all_mistakes_at_once(tmp_path):
    with pytest.raises(InputError) as refused:
        study(tmp_path, '"device.mas" = [1.0]\n"device.damping" = []\n[sample]\nkind = "lhs"')
    assert [mistake.line for mistake in refused.value.mistakes] == [3, 4, 6]


def test_mistakes_of_the_problem_are_those_of_its_own_file(tmp_path):
    with pytest.raises(InputError) as refused:
        study(tmp_path, '"device.damping" = [1.0]', PROBLEM.replace("mass", "mas"))
    assert "device.toml:2: device.mas: unknown key; did you mean mass?" in str(refused.value)
    with pytest.raises(InputError, match=r"study.toml:1: problem: .*: no such file"):
        (tmp_path / "study.toml").write_text('problem = "nowhere.toml"\n[axes]\n"device.mass" = [1.0]')
        read_study(tmp_path / "study.toml")
    with pytest.raises(InputError, match=r"study.toml:3: .*device in the problem is not a table"):
        study(tmp_path, '"device.mass" = [1.0]', "device = 3\n")


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
