"""Benchmarks: their judges against closed forms, their rows, their seeds, and README's table against the CSV."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from math import log, nan, sqrt
from time import process_time

import numpy as np
import pytest
from click.testing import CliRunner
from conftest import ROOT
from oracles import Case, sampled_radius

from vctune.bench import evaluator, files, peers, sampling, scaling, scene, solvers, stress, timing
from vctune.bench import judged as judging
from vctune.bench.benchmark import Size
from vctune.bench.dense import dense
from vctune.bench.devices import device
from vctune.bench.digits import exact, stable
from vctune.bench.parts import charged
from vctune.bench.problems import reference_problems
from vctune.bench.summary import summary
from vctune.bench.timing import paired, slope
from vctune.cli.bench import bench
from vctune.design.judge import Status
from vctune.design.scan import scan
from vctune.design.solve import solve
from vctune.design.units import dimensionless
from vctune.document.errors import InputError
from vctune.document.reading import read_problem
from vctune.model.quantities import Coupling, Device, Gains
from vctune.model.transparency import Terms

LAG, ZOH = Device(0.5, 2.0, 1e-3, 0.0, "lag"), Device(0.5, 2.0, 1e-3, 0.0, "zoh")
WEAK, STRONG = Gains(40.0, 4000.0), Gains(150.0, 6000.0)
QUICK = Size(quick=True, seed=0)


def no_talk(stage):
    """Hear what is being measured and say nothing."""


@pytest.fixture(scope="module")
def wheel():
    return reference_problems(1)["friction-wheel"]


# The independent evaluator


@pytest.mark.parametrize(
    ("hold", "values"), [(LAG, (14.1276, 394.645, 1140.27, 2215.64)), (ZOH, (14.1121, 411.113, 1619.22, 13078.68))]
)
def test_required_resistance_at_the_fixtures(hold, values):
    """DESIGN 1.6."""
    omega = np.array([100.0, 1000.0, 2000.0, 3000.0])
    found = evaluator.required(*evaluator.impedances(hold, WEAK.velocity, WEAK.position, omega))
    assert found == pytest.approx(values, rel=1e-5)


def test_required_resistance_does_not_cancel():
    """DESIGN 1.5: the plain formula returns 0."""
    found = evaluator.required(*evaluator.impedances(Device(0.5, 1.0, 1e-3, 0.0, "lag"), 5000.0, 1e6, np.array([0.01])))
    assert found == pytest.approx(5.5543e-5, rel=1e-4)


@pytest.mark.parametrize("K_v", [10.0, 300.0, 900.0])
def test_spectral_radius_of_the_velocity_loop(K_v):
    """One pole, a - K_v (1-a)/b, without delay; two poles of z^2 - a z + K_v (1-a)/b after a sample."""
    a = np.exp(-ZOH.damping * ZOH.sample_time / ZOH.mass)
    step = K_v * (1 - a) / ZOH.damping
    assert evaluator.spectral_radius(ZOH, Gains(K_v, 0.0)) == pytest.approx(abs(a - step), rel=1e-9)
    late = replace(ZOH, delay=ZOH.sample_time)
    assert evaluator.spectral_radius(late, Gains(K_v, 0.0)) == pytest.approx(
        np.abs(np.roots([1.0, -a, step])).max(), rel=1e-9
    )


def test_spectral_radius_with_any_delay():
    rng = np.random.default_rng(1)
    for _ in range(60):
        T, delay = 1e-3, float(rng.choice([0.0, 0.3, 1.0, 1.5, 3.7])) * 1e-3
        m, b, K_v, K_p = (float(10 ** rng.uniform(*span)) for span in ((-3, 2), (-3, 2), (-2, 3), (-1, 5)))
        found = evaluator.spectral_radius(Device(m, b, T, delay, "zoh"), Gains(K_v, K_p))
        assert found == pytest.approx(sampled_radius(Case(m, b, T, delay, "zoh", K_v, K_p)), rel=1e-6, abs=1e-6)


def test_error_of_the_bare_device(wheel):
    """With Z_0 |G_hh| alone and no loop the mean square is an elementary integral."""
    band, b, m = wheel.transparency.band, wheel.device.damping, wheel.device.mass
    alone = replace(wheel, transparency=replace(wheel.transparency, weights=Terms(1.0, 0.0, 0.0)))
    grown = [log(w * w / (b * b + (m * w) ** 2)) / (2 * b * b) for w in (band.min, band.max)]
    expected = wheel.transparency.reference_impedance * sqrt((grown[1] - grown[0]) / log(band.max / band.min))
    assert evaluator.error(alone, Gains(0.0, 0.0), Coupling(1.0, 1.0, 0.0)) == pytest.approx(expected, rel=1e-9)


def test_violation_is_the_logarithm_of_what_is_missing(wheel):
    """Where Llewellyn's demand binds, asking for a tenth more misses it by log 1.1."""
    found = solve(wheel).judgement
    assert evaluator.violation(wheel, found.gains, found.coupling) == 0
    more = replace(wheel, stability=replace(wheel.stability, safety_factor=1.1 * found.min_ratio))
    assert evaluator.violation(more, found.gains, found.coupling) == pytest.approx(log(1.1), rel=1e-6)


# Fifty digits


def test_fifty_digits_at_the_crossings():
    """DESIGN 1.6: the ratio of (25000, 5) is 1 at these frequencies."""
    for omega in (5.3410, 76.1960, 284.483):
        assert float(exact(LAG, WEAK, Coupling(25000.0, 5.0, 0.0), omega).ratio) == pytest.approx(1.0, rel=1e-4)


@pytest.mark.parametrize("samples", [0.0, 1.0])
def test_fifty_digits_at_the_edge_of_stability(samples):
    """Jury's test tells a relative 1e-12 either side of the limit: -1 without delay, a complex pair after a sample."""
    a = np.exp(-2.0 * 1e-3 / 0.5)
    limit = float(((1 + a) if samples == 0 else 1.0) * 2.0 / (1 - a))
    late = replace(ZOH, delay=samples * 1e-3)
    assert stable(late, Gains(limit * (1 - 1e-11), 0.0))
    assert not stable(late, Gains(limit * (1 + 1e-11), 0.0))


def test_fifty_digits_agree_with_eigenvalues():
    rng = np.random.default_rng(2)
    for _ in range(60):
        delay = float(rng.choice([0.0, 0.3, 1.0, 1.5])) * 1e-3
        late, gains = replace(ZOH, delay=delay), Gains(*(float(10 ** rng.uniform(1, top)) for top in (3.2, 5.5)))
        assert stable(late, gains) == (evaluator.spectral_radius(late, gains) < 1)


# Judges


def test_worth_of_designs_good_and_bad(wheel):
    found = solve(wheel).judgement
    good = judging.worth(wheel, found.gains, found.coupling)
    assert (good.verdict, good.violation, good.stable, good.consistent) == (Status.CERTIFIED, 0.0, True, True)
    lighter = replace(found.coupling, mass=0.9 * found.coupling.mass)
    bad = judging.worth(wheel, found.gains, lighter)
    assert bad.verdict is Status.VIOLATED and bad.violation > 0.01 and bad.consistent
    wild = judging.worth(wheel, Gains(5000.0, 3000.0), found.coupling)
    assert not wild.stable and wild.verdict is Status.VIOLATED


def test_worth_notices_a_prover_that_lies(wheel, monkeypatch):
    found = solve(wheel).judgement
    monkeypatch.setattr(judging, "judge", lambda problem, gains, coupling: found)
    lighter = replace(found.coupling, mass=0.9 * found.coupling.mass)
    assert not judging.worth(wheel, found.gains, lighter).consistent


def test_stress_notices_a_wrong_certificate(wheel):
    found = solve(wheel).judgement
    assert stress.contradiction(wheel, found)[0] == ""
    lighter = replace(found, coupling=replace(found.coupling, mass=0.9 * found.coupling.mass))
    assert "Re Z_c/R" in stress.contradiction(wheel, lighter)[0]
    loud = replace(found, gains=Gains(5000.0, 3000.0))
    assert "pole" in stress.contradiction(wheel, loud)[0]
    strict = replace(wheel, stability=replace(wheel.stability, max_sensitivity=1.5))
    assert "|S| is" in stress.contradiction(strict, found)[0]


def test_the_scan_finds_a_design_where_there_is_one(wheel):
    assert stress.feasible(wheel) is not None
    assert stress.feasible(read_problem(ROOT / "problems/infeasible.toml").problem) is None


# What the peers get


def test_problems_are_those_of_the_files():
    for name, problem in reference_problems().items():
        places = [ROOT / f"problems/{name}.toml", ROOT / f"tests/reference/{name}.toml"]
        (path,) = [place for place in places if place.exists()]
        theirs = read_problem(path).problem
        assert replace(theirs, name="", description="", experiments=()) == replace(problem, name="", description="")


def test_peers_get_the_problem_with_its_derivatives(wheel):
    """Objective and demands are the evaluator's; slopes are their difference quotients."""
    scaled = dimensionless(wheel)
    given = dense(wheel, scaled, scan(scaled).starts[0], 50, 0.0)
    z = given.numbers.guess
    f, g = given.values(z)
    gains, coupling = given.design(z)
    assert np.exp(f[0]) == pytest.approx(evaluator.error(wheel, gains, coupling), rel=1e-6)
    omega = np.geomspace(wheel.stability.band.min, wheel.stability.band.max, 50)
    R = evaluator.required(*evaluator.impedances(wheel.device, gains.velocity, gains.position, omega))
    ratio = evaluator.coupling_impedance(coupling, omega).real / R / wheel.stability.safety_factor
    assert g[:50] == pytest.approx(np.log(ratio), abs=1e-5)
    df, dg = given.slopes(z)
    for k, step in enumerate(1e-6 * np.eye(z.size)):
        (f_1, g_1), (f_0, g_0) = given.values(z + step), given.values(z - step)
        assert df[k] == pytest.approx((f_1[0] - f_0[0]) / 2e-6, abs=1e-6)
        assert dg[:, k] == pytest.approx((g_1 - g_0) / 2e-6, abs=1e-5)


def test_missing_peers_are_an_input_error(monkeypatch):
    monkeypatch.setattr(peers, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"needs SciPy and NLopt; .*vctune\[bench\]"):
        peers.need("scipy", "nlopt")


# Rows


def test_seeds_reproduce_devices():
    assert device(3, 5) == device(3, 5)
    assert device(3, 5)[0] != device(4, 5)[0] != device(4, 6)[0]


def test_slope_of_a_power():
    assert slope([1.0, 2.0, 5.0], [3.0, 3.0 * 2**1.5, 3.0 * 5**1.5]) == pytest.approx(1.5)


def test_pairs_take_turns():
    calls = []
    paired(lambda: calls.append("a"), lambda: calls.append("b"), 3)
    assert "".join(calls) == "ab" + "ab" + "ba" + "ab"


@dataclass(frozen=True)
class Cell:
    name: str
    good: bool
    value: float


def test_parts_count_their_own_time_once():
    """What one part calls of another is the other's, what it calls of itself counts once."""

    def busy(seconds):
        until = process_time() + seconds
        while process_time() < until:
            pass

    timing.work_a = lambda: (busy(0.02), timing.work_b(), timing.work_c())
    timing.work_b = lambda: busy(0.04)
    timing.work_c = lambda: busy(0.03)
    before = timing.work_b
    try:
        with charged(
            {"a": tuple(f"vctune.bench.timing:work_{x}" for x in "ac"), "b": ("vctune.bench.timing:work_b",)}
        ) as spent:
            timing.work_a()
        assert spent == pytest.approx({"a": 0.05, "b": 0.04}, abs=0.008)
        assert timing.work_b is before
    finally:
        del timing.work_a, timing.work_b, timing.work_c


def test_csv_has_no_nan(tmp_path):
    path = tmp_path / "cells.csv"
    path.write_text(files.csv_of([Cell("a, b", True, 0.1), Cell("c", False, nan), Cell("d", True, float("inf"))]))
    assert files.read_csv(path) == [
        {"name": "a, b", "good": "yes", "value": "0.1"},
        {"name": "c", "good": "no", "value": ""},
        {"name": "d", "good": "yes", "value": "inf"},
    ]


def test_page_keeps_other_sections_in_order():
    def text(name, content):
        return f"<!-- {name} -->\n{content}\n<!-- /{name} -->\n"

    assert files.command_of("<!-- scene -->\n## What\n\n`vctune bench scene --quick` on a machine\n", "scene") == (
        "vctune bench scene --quick"
    )
    page = files.with_section("", "scene", text("scene", "old"))
    page = files.with_section(page, "sampling", text("sampling", "first"))
    page = files.with_section(page, "scene", text("scene", "new"))
    assert page == "\n".join([files.HEAD, text("sampling", "first"), text("scene", "new")])


def run(name, folder):
    """Run a benchmark's command and return the rows of its table."""
    done = CliRunner().invoke(bench, [name, "--quick", "--out", str(folder)], standalone_mode=False)
    assert done.exception is None and done.return_value == 0
    assert (folder / f"{name}.svg").stat().st_size > 1000
    assert f"vctune bench {name} --quick --seed 0" in (folder / files.PAGE).read_text()
    return files.read_csv(folder / f"{name}.csv")


def test_quick_sampling(tmp_path):
    rows = run("sampling", tmp_path)
    assert all(row["consistent"] == "yes" for row in rows)
    (ours,) = [row for row in rows if row["method"] == sampling.EXCHANGE]
    assert ours["verdict"] == "certified" and float(ours["violation"]) == 0
    coarse = min((row for row in rows if row["method"] == sampling.FIXED), key=lambda row: int(row["frequencies"]))
    assert coarse["succeeded"] == "yes" and coarse["verdict"] == "violated" and float(coarse["violation"]) > 0.01


def test_quick_solvers(tmp_path):
    pytest.importorskip("nlopt")
    rows = run("solvers", tmp_path)
    assert {peer.name for peer in solvers.all_peers(quick=True)} | {solvers.OURS} == {row["solver"] for row in rows}
    assert all(row["consistent"] == "yes" for row in rows)
    proved = [float(row["gap"]) for row in rows if row["verdict"] == "certified"]
    assert min(proved) == 0
    by_name = {row["solver"]: row for row in rows}
    assert by_name[solvers.OURS]["verdict"] == by_name[solvers.MULTISTART]["verdict"] == "certified"
    assert float(by_name[solvers.OURS]["gap"]) < 1e-4


def test_quick_stress(tmp_path, monkeypatch):
    monkeypatch.setattr(stress, "QUICK", 12)
    rows = run("stress", tmp_path)
    assert [row["number"] for row in rows] == [str(number) for number in range(12)]
    assert not any(row["wrong"] for row in rows)
    assert stress.FAILED not in {row["status"] for row in rows}
    assert max(float(row["float_error"] or 0) for row in rows) < 1e-12


def test_quick_scaling(tmp_path):
    rows = run("scaling", tmp_path)
    assert {row["axis"] for row in rows} == set(scaling.EXPECTED)
    shares = files.read_csv(tmp_path / "profile.csv")
    for command in ("solve", "check", "sweep", "region", "simulate"):
        own = [row for row in shares if row["command"] == command and row["part"] != "all"]
        assert sum(float(row["share"]) for row in own) == pytest.approx(1, abs=1e-4)


def test_quick_scene(tmp_path):
    rows = run("scene", tmp_path)
    assert all(row["same_as_without"] == "yes" for row in rows)
    for build in (scene.NLP, scene.STEP):
        whole, *others = (row for row in rows if row["build"] == build)
        for row in others:
            if row["without"] != "mass of the hand":  # lighter, it swings faster and gets more steps
                assert int(row["operations"]) < int(whole["operations"]), row["without"]


def test_a_bad_folder_is_said(tmp_path):
    (tmp_path / "file").write_text("")
    done = CliRunner().invoke(bench, ["scene", "--out", str(tmp_path / "file" / "folder")], standalone_mode=False)
    assert isinstance(done.exception, InputError)


# README


def test_readme_shows_the_csv():
    shown = re.search(r"<!-- bench -->\n(.*?)<!-- /bench -->", (ROOT / "results/README.md").read_text(), re.DOTALL)[1]
    assert shown == summary(ROOT / "results/bench")


def test_page_points_at_what_is_there():
    page = (ROOT / "results/bench" / files.PAGE).read_text()
    for name in re.findall(r"\]\((\S+?)\)", page):
        assert (ROOT / "results/bench" / name).exists()
    assert re.findall(r"<!-- (\w+) -->", page) == list(files.NAMES)
