"""Pictures do not mislead: what is drawn is described and the reverse, and nothing is told by colour alone."""

from __future__ import annotations

import itertools
import re
import tomllib
from dataclasses import astuple, replace
from functools import cache
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from arithmetic import DOUBLES
from conftest import DEVICE, FIXED, for_passive_hands, mostly_slow
from frequency import demanded, mechanism, offered
from loop import Loop, seen, sensitivity
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb, to_rgba
from matplotlib.figure import Figure
from pages import PARTS, SERVO, recorded
from servo_logs import servo_case

import vctune
from vctune.design.records.design import design_of
from vctune.document.reading import ProblemFile, parse_problem
from vctune.model.display import STEPPED
from vctune.model.gains import Coupling, Gains
from vctune.model.problem import Problem
from vctune.report.curves import requirements
from vctune.report.design_figures import design_figures
from vctune.report.experiments import simulation_figure
from vctune.report.identification import draw_numbers
from vctune.report.page import summary
from vctune.report.panels import draw_error, draw_impedance, draw_nyquist, draw_ratio, draw_required
from vctune.report.paths import DESIGN_FIGURES
from vctune.report.region_figure import BAD, GOOD, OPEN, region_figure
from vctune.report.style import GREY, PAPER, picture, svg, text_of_ticks
from vctune.report.sweep_figure import sweep_figure
from vctune.report.tables import asked as stated_in_tables
from vctune.simulation.scene import stroke_time
from vctune.simulation.simulation_record import CURVE_POINTS, simulation_record
from vctune.simulation.two_runs import simulate
from vctune.study.region import Kind
from vctune.study.study_table import Table

HELD = FIXED.format(160.0) + "drag = 3.0\n"
IMPEDANCE = """gains = { velocity = 0.0 }
coupling = { damping = 0.045, stiffness = 150.0 }
[device]
display = "impedance"
mass = 0.045
damping = 0.25
sample_time = 1e-3
delay = 5e-4
velocity = { from = "difference", filter_hz = 100.0 }
"""
KINDS = {
    "hands": DEVICE + HELD + "[stability]\ncriterion = 'hands'\n",
    "violated": DEVICE + FIXED.format(40.0),
    "any passive hand": for_passive_hands(DEVICE + HELD),
    "least operator": for_passive_hands(DEVICE + HELD + "[operator]\ndamping = 0.5\n"),
    "both": DEVICE + HELD,
    "every part": DEVICE + PARTS + HELD.replace("150.0", "60.0"),
    "uncertain": DEVICE + HELD + "[uncertainty]\nmass = 0.1\ndamping = 0.2\n",
    "environment": DEVICE + HELD + "[environment]\nstiffness = { min = 0.0, max = 500.0 }\n",
    "no loop": DEVICE + "[gains]\nvelocity = 0.0\nposition = 0.0\n[coupling]\ndamping = 1.0\nmass = 1.0\n",
    "impedance": IMPEDANCE,
    "impedance in hands": IMPEDANCE + "[stability]\ncriterion = 'hands'\n",
    "servo": SERVO,
    "rotary": """device = { units = "rotary", mass = 0.01, damping = 0.05, sample_time = 1e-3 }
stability = { criterion = "passive" }
gains = { velocity = 2.0, position = 50.0 }
coupling = { damping = 3.0, mass = 0.01 }
""",
}
# what the label of a drawn thing looks like, and the words of the page that speak of it
DESCRIBED = {
    r"coupling, Re": "solid, must lie above R",
    r"required, R": "R, dashed",
    r"Re .*/ R|1: the limit|safety factor": "their ratio above the safety factor",
    r"least: ": "The ratio is least",
    r"R (in|without|of) ": "Thin lines show R",
    r"requested band": "on the shaded band",
    r"free$|[\d.e+]+ N": "each line with marks",
    r"rigid": "between free and rigid",
    r"ideal": "the thin line of its ideal",
    r"bare device": "dotted line is the bare device",
    r"proved stable": "Grey shows where stability is proved",
    r"required, not proved": "Hatched is where stability is required",
    r"transparency band": "band",
    r"designed": "All terms should be small",
    r"no coupling|uncontrolled": "Grey lines show the same loop without a coupling",
    r"(force|torque) sensor, ": "sensor alone loses",
    r"L up to Nyquist|-1|−1": "The curve must pass -1",
    r"unit circle": "dashed unit circle",
    r"\|S\| >": "the hatched circle",
    r"gain margin": "gain margin",
    r"phase margin": "phase margin",
}
EXPERIMENTS = """
[[experiment]]
name = "free"
environment = { damping = 0.0 }
operator = { to = 0.02, cycles = 2 }
friction = { coulomb = 0.3 }
baseline = { kp = 30.0, kd = 2.0, mass = 0.3, damping = 5.0 }
"""


@pytest.fixture(scope="module")
def drawn():
    """Return the figures of a kind of problem, made when they are first asked for."""

    def made(kind):
        problem, record = parse_problem(KINDS[kind], "x", "x"), design_of(recorded(KINDS[kind]), "x")
        required = requirements(problem, *record.design)
        return design_figures(problem, record, required, summary(record, problem).doubt)

    return cache(made)


def labels(figure):
    """Return the label of everything that a figure draws, and of its legend."""
    found = [each for axes in figure.axes for each in axes.get_legend_handles_labels()[1]]
    return [label for label in found if not label.startswith("_")]


@pytest.mark.parametrize("kind", mostly_slow(KINDS, ("hands", "least operator", "impedance", "servo", "violated")))
def test_what_is_drawn_is_described_and_the_reverse(drawn, kind):
    shown = drawn(kind)
    assert {each.name for each in shown} <= set(DESIGN_FIGURES) and len(shown) >= 3
    for each in shown:
        words, found = f"{each.title}. {each.finding} {each.reading}", labels(each.figure)
        for label in found:
            assert any(re.match(look, label) and said in words for look, said in DESCRIBED.items()), (label, words)
        for look, said in DESCRIBED.items():
            assert said not in words or any(re.match(look, label) for label in found) or said == "band", (said, found)


@pytest.mark.parametrize("kind", mostly_slow(KINDS, ("hands", "impedance")))
def test_lines_are_told_apart_without_colour(drawn, kind):
    """Lines of one pair of axes differ in dashes, mark or width, or are the two of one environment."""
    for each in drawn(kind):
        for axes in each.figure.axes:
            lines = [line for line in axes.lines if not line.get_label().startswith("_")]
            styles = [(line.get_linestyle(), line.get_marker(), line.get_linewidth()) for line in lines]
            same = [pair for pair in itertools.combinations(styles, 2) if pair[0] == pair[1]]
            assert not same, (each.name, styles)


@pytest.mark.parametrize("kind", mostly_slow(KINDS, ("violated", "hands")))
def test_a_design_that_is_not_for_use_says_so_on_each_panel(drawn, kind):
    for each in drawn(kind):
        for axes in each.figure.axes:
            stamped = [text.get_text() for text in axes.texts]
            assert stamped == (["violated: not for use"] if kind == "violated" else stamped)


@pytest.mark.parametrize("kind", mostly_slow(KINDS, ("hands", "servo")))
def test_no_two_legends_or_labels_overlap_or_leave_the_figure(drawn, kind):
    """By the boxes of Matplotlib's own layout: each legend stands inside the figure and above its own axes."""
    for each in drawn(kind):
        each.figure.draw_without_rendering()
        renderer, whole = FigureCanvasAgg(each.figure).get_renderer(), each.figure.bbox
        for axes in each.figure.axes:
            legend = axes.get_legend()
            boxes = [axes.get_tightbbox(renderer)]
            if legend is not None:
                assert legend.get_window_extent(renderer).y0 >= axes.get_window_extent(renderer).y1 - 1, each.name
            assert all(box.y1 <= whole.y1 + 1 and box.x0 >= -1 and box.y0 >= -1 for box in boxes), (each.name, boxes)
            assert all(box.x1 <= whole.x1 + 1 for box in boxes), (each.name, boxes)


def test_the_limit_the_safety_factor_and_the_least_ratio_are_apart(drawn):
    for kind in ("any passive hand", "least operator"):
        low, high = drawn(kind)[0].figure.axes[1].get_ylim()
        assert 0.05 / (high - low) > 0.07 and low < 1.0


# values of what is drawn, by the oracles

BOX = DEVICE + HELD + "[uncertainty]\nmass = 0.1\ndamping = 0.2\n"
VALUED = {
    "any passive hand": KINDS["any passive hand"],
    "least operator": KINDS["least operator"],
    "every part": for_passive_hands(KINDS["every part"]),
}


def stated(text: str) -> tuple[dict[str, Any], Problem, Gains, Coupling]:
    """Return the tables of a problem that fixes a design, as the oracles read them, the problem and the design."""
    problem = parse_problem(text, "x", "x")
    gains, coupling = problem.fixed_design
    assert isinstance(coupling, Coupling)
    return tomllib.loads(text), problem, gains, coupling


def line(axes: Axes, label: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the data of the line whose label begins so."""
    (found,) = (each for each in axes.lines if str(each.get_label()).startswith(label))
    return np.asarray(found.get_xdata(), float), np.asarray(found.get_ydata(), float)


def panel() -> Axes:
    return Figure().subplots()


@pytest.mark.parametrize("kind", VALUED)
def test_the_drawn_requirement_and_coupling_are_those_of_the_formulas(kind: str) -> None:
    tables, problem, gains, coupling = stated(VALUED[kind])
    axes = draw_required(panel(), problem, gains, coupling)
    hz, required = line(axes, "required, R")
    expected = demanded(tables, astuple(gains), 2j * np.pi * hz, DOUBLES).required
    there = np.isfinite(required) & (required > 1e-6 * np.nanmax(required))
    assert there.sum() > 50 and required[there] == pytest.approx(expected[there], rel=1e-6)
    hz, shown = line(axes, "coupling, Re")
    assert shown == pytest.approx(offered(astuple(coupling), 2j * np.pi * hz, DOUBLES).real, rel=1e-9)
    if kind == "least operator":
        bare = demanded({"device": tables["device"]}, astuple(gains), 2j * np.pi * hz, DOUBLES).required
        assert line(axes, "R without operator")[1][there] == pytest.approx(bare[there], rel=1e-6)


def test_the_drawn_requirement_of_a_box_is_that_of_its_worst_device() -> None:
    """Of the four corners; the stated device alone asks for less, and has a line of its own."""
    tables, problem, gains, coupling = stated(for_passive_hands(BOX))
    axes = draw_required(panel(), problem, gains, coupling)
    hz, required = line(axes, "required, R")
    each = [
        demanded({"device": tables["device"] | {"mass": m, "damping": b}}, astuple(gains), 2j * np.pi * hz, DOUBLES)
        for m, b in [(0.4, 2.0), *itertools.product((0.36, 0.44), (1.6, 2.4))]
    ]
    own, most = each[0].required, np.max([one.required for one in each], axis=0)
    assert required == pytest.approx(most, rel=1e-6) and np.nanmax(most / own) > 1.05
    assert line(axes, "R of the stated device")[1] == pytest.approx(own, rel=1e-6)
    ratio = draw_ratio(panel(), problem, gains, coupling)
    hz, shown = line(ratio, "Re Z_c / R")
    assert shown == pytest.approx(offered(astuple(coupling), 2j * np.pi * hz, DOUBLES).real / most, rel=1e-6)
    band = (hz >= problem.stability.band.min / (2 * np.pi)) & (hz <= problem.stability.band.max / (2 * np.pi))
    (at,), (least,) = line(ratio, "least: ")
    assert least == pytest.approx(shown[band].min(), rel=2e-2) and least <= shown[band].min() * (1 + 1e-9)
    assert least == pytest.approx(np.interp(at, hz, shown), rel=1e-3)
    assert line(ratio, "1: the limit")[1] == pytest.approx(1.0)
    assert line(ratio, "safety factor")[1] == pytest.approx(problem.stability.safety_factor)


def test_no_hand_and_no_device_of_a_box_asks_for_more_than_is_drawn() -> None:
    """And one of the vertices of hands on one of the corners of devices asks for nearly as much."""
    tables, problem, gains, coupling = stated(BOX + "[stability]\ncriterion = 'hands'\n")
    hz, required = line(draw_required(panel(), problem, gains, coupling), "required, R")
    chosen = np.flatnonzero(np.isfinite(required) & (hz > 1.0))[::5]
    z, most = np.exp(2e-3j * np.pi * hz[chosen]), np.full(chosen.size, -np.inf)
    box = [
        (getattr(problem.hands.low, name), getattr(problem.hands.high, name))
        for name in ("mass", "damping", "stiffness")
    ]
    for m, b in itertools.product((0.36, 0.44), (1.6, 2.4)):
        for hand in itertools.product(*box):
            loop = Loop(tables["device"] | {"mass": m, "damping": b}, astuple(gains), hand=hand)
            most = np.maximum(most, -seen(loop, z).real)
    assert (most <= required[chosen] * (1 + 1e-3)).all()
    assert np.median(most / required[chosen]) > 0.9


@pytest.mark.parametrize("kind", ["any passive hand", "every part"])
def test_margins_are_marked_on_the_curve(kind: str) -> None:
    """Of L = 1/S - 1 by the oracle: the phase margin's mark on the unit circle, the gain margin's on the real axis."""
    tables, problem, gains, _ = stated(VALUED[kind])
    axes, theta = draw_nyquist(panel(), problem, gains), np.geomspace(3e-2, np.pi, 6000)
    L = 1 / sensitivity(Loop(tables["device"], astuple(gains)), np.exp(1j * theta)) - 1

    def off(label: str) -> float:
        """Return the greatest distance of a line near -1 from the curve."""
        x, y = line(axes, label)
        place = (x + 1j * y)[np.hypot(x, y) < 2, None]
        return float(np.abs(place - L).min(axis=1).max())

    assert off("L up to Nyquist") < 3e-3
    (x,), (y,) = line(axes, "phase margin")
    assert off("phase margin") < 3e-3 and np.hypot(x, y) == pytest.approx(1.0) and y != 0
    drawn_x, drawn_y = line(axes, "L up to Nyquist")
    assert np.hypot(drawn_x - x, drawn_y - y).min() < 0.1
    (x,), (y,) = line(axes, "gain margin")
    assert off("gain margin") < 3e-3 and y == 0 and -1 < x < 0
    crossing = np.flatnonzero(np.diff(np.abs(L) > 1))
    margin = min(180 - np.degrees(np.abs(np.angle(L[crossing]))))
    labels = [str(each.get_label()) for each in axes.lines]
    said = dict(found for each in labels for found in re.findall(r"(\w+) margin \D*([\d.]+)", each))
    assert float(said["phase"]) == pytest.approx(margin, rel=1e-2)
    assert float(said["gain"]) == pytest.approx(-20 * np.log10(-x), rel=1e-2)
    (circle,) = axes.patches
    x, y = np.asarray(circle.get_path().vertices).T
    assert np.hypot(x + 1, y) == pytest.approx(1 / problem.stability.max_sensitivity)
    assert np.hypot(*line(axes, "unit circle")) == pytest.approx(1.0) and line(axes, "-1") == ([-1], [0])


@pytest.mark.parametrize("kind", VALUED)
def test_the_drawn_error_and_its_terms_are_those_of_the_formulas(kind: str) -> None:
    weights = (
        "[transparency]\nweights = { admittance = 2.0, tracking = 3.0, coupling = 0.5 }\nreference_impedance = 7.0\n"
    )
    tables, problem, gains, coupling = stated(VALUED[kind] + weights)
    hz, total = line(draw_error(panel(), problem, gains, coupling), "designed")
    s = 2j * np.pi * hz
    at, without = (demanded({"device": tables["device"]}, law, s, DOUBLES) for law in (astuple(gains), (0.0, 0.0)))
    terms = {
        "admittance": 7.0 * np.abs(at.G_hh), "tracking": np.abs(at.tracking),
        "coupling": np.abs(offered(astuple(coupling), s, DOUBLES)) / 7.0,
    }  # fmt: skip
    for part, expected in terms.items():
        axes = draw_error(panel(), problem, gains, coupling, part)
        assert line(axes, "designed")[1] == pytest.approx(expected, rel=1e-6)
        if part == "admittance":
            assert line(axes, "uncontrolled")[1] == pytest.approx(7.0 * np.abs(without.G_hh), rel=1e-6)
    weighted = [w * terms[part] for part, w in {"admittance": 2.0, "tracking": 3.0, "coupling": 0.5}.items()]
    assert total == pytest.approx(np.hypot.reduce(weighted), rel=1e-6)


@pytest.mark.parametrize("kind", ["any passive hand", "every part"])
def test_what_the_hand_feels_is_drawn_with_its_environments(kind: str) -> None:
    """What `felt_impedance` returns, beside |Z_e| and the device alone."""
    tables, problem, gains, coupling = stated(VALUED[kind])
    axes = draw_impedance(panel(), problem, gains, coupling)
    hz, _ = line(axes, "free")
    s, solved = 2j * np.pi * hz, vctune.Solved(problem=problem, judgement=vctune.judge(problem, gains, coupling))
    met = {"free": {}, "14 N s/m": {"damping": 14.0}, "200 N/m": {"stiffness": 200.0}, "rigid": {"stiffness": np.inf}}
    for label, environment in met.items():
        felt = np.abs(vctune.felt_impedance(solved, hz, **environment))
        assert line(axes, label)[1] == pytest.approx(felt, rel=1e-12)
    assert line(axes, "ideal")[1] == pytest.approx(14.0)
    (spring,) = (each for each in axes.lines if each.get_label() == "_" or str(each.get_label()).startswith("_child"))
    assert np.asarray(spring.get_ydata()) == pytest.approx(200.0 / (2 * np.pi * hz))
    assert line(axes, "bare device")[1] == pytest.approx(
        np.abs(1 / mechanism(tables["device"], s, DOUBLES)[0]), rel=1e-6
    )


def test_a_shaded_band_ends_where_it_is_stated_to_end() -> None:
    _, problem, gains, coupling = stated(KINDS["any passive hand"] + "[transparency]\nband_hz = [2.0, 30.0]\n")
    axes = draw_error(panel(), problem, gains, coupling)
    (band,) = (patch for patch in axes.patches if patch.get_label() == "transparency band")
    assert [band.get_x(), band.get_x() + band.get_width()] == pytest.approx([2.0, 30.0])


def test_what_was_found_in_a_log_is_drawn_with_two_standard_deviations(tmp_path) -> None:
    case = servo_case(3, n=800)
    axes, record = panel(), vctune.identify(case.write(tmp_path), servo=True).record
    draw_numbers(axes, record)
    found = [(each.value, one) for each in record.numbers for one in each.estimates]
    assert len(axes.containers) >= len(found) > 0
    bars = [each for each in axes.containers if hasattr(each, "has_xerr")]
    for (middle, one), bar in zip(found, bars, strict=True):
        (low, high) = bar.lines[2][0].get_segments()[0][:, 0]
        assert high - low == pytest.approx(4 * 100 * (one.sigma or 0.0) / middle)
        assert (low + high) / 2 == pytest.approx(100 * (one.value / middle - 1))


def test_the_points_of_a_sweep_are_those_of_their_designs() -> None:
    """The error of each certified design over its axis, on the stated device's yardstick, and marks without one."""
    text = for_passive_hands(DEVICE + FIXED.format(160.0))
    masses = (0.25, 0.3, 0.35, 0.4, 0.5, 0.55)
    file = tomllib.loads(text)
    axes = sweep_figure(vctune.sweep(file, {"device.mass": list(masses)}).table, grid=True).axes[0]
    judged = {mass: vctune.judge(*stated(text.replace("0.4", str(mass)))[1:]) for mass in masses}
    good = [mass for mass, each in judged.items() if each.status.value == "certified"]
    assert 0 < len(good) < len(masses)
    x, y = line(axes, "certified")
    assert x[np.isfinite(y)] == pytest.approx(good)
    errors, yardstick = [], stated(text)[1].transparency
    for mass in good:
        problem = replace(stated(text.replace("0.4", str(mass)))[1], transparency=yardstick)
        errors.append(vctune.judge(problem, *problem.fixed_design).error)
    assert y[np.isfinite(y)] == pytest.approx(errors, rel=1e-9)
    assert list(line(axes, "no certified design")[0]) == [mass for mass in masses if mass not in good]


def test_the_line_of_a_region_is_where_its_loops_lose_their_resistance() -> None:
    """Re G_hh = 0 at low frequencies: tau K_p = b + K_v, with tau = T/2 + delay = 1 ms."""
    device = "[device]\nmass = 0.4\ndamping = 20.0\nsample_time = 1e-3\ndelay = 5e-4\n"
    ranges = "[gains]\nvelocity = { min = 1.0, max = 200.0 }\nposition = { min = 0.0, max = 2e5 }\n"
    text = for_passive_hands(device + ranges + "[coupling]\ndamping = 160.0\nmass = 0.35\n")
    found = vctune.region(tomllib.loads(text), resolution=0.125)
    x, y = line(region_figure(found.file.problem, found.region, found.designs).axes[0], "τ K_p")
    (K_v, K_p), share = found.region.plane.edges, np.linspace(0, 1, found.region.plane.side + 1)
    there = (x > 0) & (y > 0) & np.isfinite(x + y)
    assert there.sum() > 3
    assert 1e-3 * np.interp(y, share, K_p)[there] == pytest.approx(20.0 + np.interp(x, share, K_v)[there], rel=1e-9)


@pytest.mark.slow
def test_the_cells_of_a_region_are_drawn_with_their_areas() -> None:
    """As shares of the plane."""
    found = vctune.region(tomllib.loads(for_passive_hands(DEVICE)), resolution=0.125)
    axes = region_figure(found.file.problem, found.region, found.designs).axes[0]
    names = {Kind.FEASIBLE: "proved feasible", Kind.INFEASIBLE: "proved infeasible", Kind.UNDECIDED: "undecided"}
    patches = {str(patch.get_label()): patch for patch in axes.patches}
    for kind, name in names.items():
        corners = np.asarray(patches[name].get_path().vertices)
        corners = corners[: len(corners) // 5 * 5].reshape(-1, 5, 2)
        low, high = corners.min(axis=1), corners.max(axis=1)
        inside = (low >= 0).all(axis=1)
        assert np.prod(high - low, axis=1)[inside].sum() == pytest.approx(found.region.area(kind), abs=1e-9)


def test_what_an_experiment_asks_for_is_drawn_beside_what_was_felt() -> None:
    """The dashed line is the force of the environment: that of its spring, only in front of a wall, or its damper."""
    for environment, asked in (
        ("stiffness = 200.0, zero = 0.002", lambda x: 200.0 * (x - 0.002)),
        ("stiffness = 200.0, zero = 0.002, wall = true", lambda x: np.maximum(200.0 * (x - 0.002), 0.0)),
        ("damping = 14.0", lambda v: 14.0 * v),
    ):
        text = DEVICE + EXPERIMENTS.replace("damping = 0.0 }", f"{environment} }}", 1).replace(
            "0.02, cycles = 2", "0.01, cycles = 1"
        )
        problem = parse_problem(text, "x", "x")
        design = Gains(150.0, 6000.0), Coupling(160.0, 0.35, 0.0)
        record = simulation_record(
            ProblemFile(problem, text), *design, [simulate(problem, *design, problem.experiments[0])]
        )
        for axes in simulation_figure(record).figure.axes:
            x, force = (np.asarray(values) for values in axes.lines[1].get_data())
            assert x.size > 50 and force == pytest.approx(asked(x), abs=1e-9), environment


@pytest.mark.parametrize("kind", ["hands", "any passive hand", "impedance", "servo"])
def test_the_requirement_is_the_one_that_is_judged(kind):
    """The least drawn ratio is at least the least ratio that a finer search finds, and close to it."""
    problem, record = parse_problem(KINDS[kind], "x", "x"), design_of(recorded(KINDS[kind]), "x")
    (curves,) = requirements(problem, *record.design)
    low, high = (0.0, np.inf) if curves.band is None else np.array([curves.band.min, curves.band.max]) / (2 * np.pi)
    inside = (curves.hz >= low) & (curves.hz <= high)
    shown = np.nanmin((curves.offered / curves.required)[inside])
    assert curves.min_ratio * (1 - 1e-9) <= shown <= 1.05 * curves.min_ratio
    assert low <= curves.worst_hz <= high * (1 + 1e-9)
    assert all(np.nanmax(other / curves.required) <= 1 + 1e-9 for other in curves.others.values())


def test_files_are_xml_that_pages_can_join(drawn):
    for each in drawn("hands"):
        text = svg(each.figure, each.name)
        ElementTree.fromstring(text.encode())
        assert PAPER in text and "<metadata>" not in text and len(text) < 60_000
        assert not re.search(r'\bd="[^"]*\d\.\d{3}', text)


def test_grey_lines_are_of_what_is_compared(drawn):
    grey = {line.get_label() for each in drawn("hands") for axes in each.figure.axes for line in axes.lines
            if to_rgba(line.get_color()) == to_rgba(GREY)}  # fmt: skip
    assert {label for label in grey if not label.startswith(("R in", "_"))} <= {
        "no coupling", "uncontrolled", "bare device", "unit circle",
    }  # fmt: skip


@pytest.fixture(scope="module")
def measured():
    text = DEVICE + EXPERIMENTS
    problem = parse_problem(text, "x", "x")
    design = Gains(150.0, 6000.0), Coupling(160.0, 0.35, 0.0)
    made = simulate(problem, *design, problem.experiments[0])
    return made, simulation_record(ProblemFile(problem, text), *design, [made])


def test_the_curves_of_experiments_are_samples_of_the_traces(measured):
    made, record = measured
    (shown,) = record.experiments
    first = 2 * stroke_time(made.experiment.operator)
    panels = simulation_figure(record).figure.axes
    for name, axes in zip(("baseline", "design"), panels, strict=True):
        traces, drawn = getattr(made, name).traces, np.array(getattr(shown, name).curve)
        later = traces.time >= first * (1 - 1e-9)
        step = -(-int(later.sum()) // CURVE_POINTS)
        assert drawn == pytest.approx(np.column_stack([traces.velocity, traces.force])[later][::step], rel=1e-4)
        assert CURVE_POINTS / 2 < len(drawn) <= CURVE_POINTS
        assert np.array_equal(np.column_stack(axes.lines[0].get_data()), drawn)


# colours


def luminance(colour):
    """Return the relative luminance of an sRGB colour, which is what grey paper leaves of it."""
    channels = np.array(to_rgb(colour))
    return [0.2126, 0.7152, 0.0722] @ np.where(
        channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4
    )


def test_regions_are_told_apart_by_everyone_and_in_grey():
    """By their marks, and by more than 12 of 100 steps of lightness."""
    for (one, mark), (other, other_mark) in itertools.combinations((GOOD, BAD, OPEN), 2):
        assert 116 * abs(np.cbrt(luminance(one)) - np.cbrt(luminance(other))) > 12
        assert mark != other_mark


def test_the_page_states_half_widths_in_per_cent() -> None:
    """Of each uncertain number, and of no other."""
    lines = stated_in_tables(stated(for_passive_hands(DEVICE + HELD + "[uncertainty]\nmass = 0.02\n"))[1])["Device"]
    notes = {line.label: line.note for line in lines if "±" in line.note}
    assert notes == {"mass m": "± 2 %"}


def swept(axes: dict[str, list[float]], column: str = "error") -> Figure:
    """The figure of a sweep without its solves: errors that grow with the axes."""
    values = np.array(list(itertools.product(*axes.values())))
    error = 1.0 + 0.1 * np.arange(len(values))
    idle = np.zeros(len(values), bool)
    numbers = {"error": error, "felt_mass_1hz": 100 * error}
    status = ["certified"] * (len(values) - 1) + ["infeasible"]
    table = Table(dict(zip(axes, values.T, strict=True)), status, idle, [""] * len(values), numbers)
    return sweep_figure(table, column, grid=True)


def test_a_sweep_over_two_axes_has_cells_as_its_axes_are_spaced() -> None:
    """Edges of cells lie halfway between values: on a logarithmic axis by ratio, and between categories."""
    few, many = [0.1, 0.2, 0.4, 0.8, 1.6, 3.2], [1e-3, 2e-3, 3e-3, 4e-3, 5e-3, 6e-3]
    axes = swept({"device.mass": few, "device.delay": many}).axes[0]
    (cells,) = (each for each in axes.collections if hasattr(each, "get_coordinates"))
    x, y = cells.get_coordinates()[0, :, 0], cells.get_coordinates()[:, 0, 1]
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "linear")
    assert np.asarray(x) == pytest.approx(0.1 * 2 ** (np.arange(7) - 0.5))
    assert np.asarray(y) == pytest.approx(np.arange(7) + 0.5)  # in ms
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("mass m, kg", "delay, ms")
    assert [each.get_text() for each in axes.get_xticklabels()] == [str(value) for value in few]  # at the points
    uneven = swept({"device.mass": few, "device.delay": [0.0, 1e-3, 1.1e-3, 2e-3, 9e-3, 0.1]}).axes[0]
    assert [each.get_text() for each in uneven.get_yticklabels()] == ["0", "1", "1.1", "2", "9", "100"]


def test_a_sweep_over_few_values_has_a_line_for_each_and_shows_any_column() -> None:
    figure = swept({"operator.stiffness.max": [10.0, 20.0], "device.mass": [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]})
    axes, (legend,) = figure.axes[0], figure.legends
    assert legend.get_title().get_text() == "greatest stiffness of the hand, N/m"
    assert line(axes, "10")[1] == pytest.approx(1.0 + 0.1 * np.arange(6))
    assert list(line(axes, "no certified design")[0]) == [0.6]
    dashes = {each.get_linestyle() for each in axes.lines if each.get_label() in ("10", "20")}
    assert len(dashes) == 2  # also in grey
    other = swept({"device.mass": [1.0, 1.00001, 1.00002]}, "felt_mass_1hz").axes[0]
    assert other.get_ylabel() == "mass felt at 1 Hz, kg"
    assert line(other, "certified")[1][:2] == pytest.approx([100.0, 110.0])
    assert text_of_ticks([1.0, 1.00001, 1.00002]) == ["1", "1.00001", "1.00002"]


def test_a_map_has_labelled_contours_on_which_the_column_is_their_level() -> None:
    """Five points each way suffice."""
    axes = swept({"device.mass": [0.1, 0.2, 0.3, 0.4, 0.5], "device.damping": [1.0, 2.0, 3.0, 4.0, 5.0]}).axes[0]
    (lines,) = (each for each in axes.collections if hasattr(each, "levels"))
    assert len(lines.levels) == 5 and len(lines.labelTexts) >= 3
    for level, (first, *_) in zip(lines.levels, lines.allsegs, strict=True):
        mass, damping = first.T
        assert 1.0 + 5 * (mass - 0.1) + 0.1 * (damping - 1.0) == pytest.approx(level)


def test_a_sweep_is_labelled_in_the_symbols_of_its_law() -> None:
    """D of M a + D v = F, which the general law calls b_0."""
    table = Table(
        {"coupling.drag": np.array([1.0, 2.0, 3.0])},
        ["certified"] * 3,
        np.zeros(3, bool),
        [""] * 3,
        {"error": np.ones(3), "coupling_mass": np.ones(3)},
        kind=STEPPED,
    )
    axes = sweep_figure(table, "coupling_mass", grid=True).axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("D, N s/m", "M, kg")


@pytest.mark.parametrize("kind", ["svg", "pdf", "png"])
def test_a_picture_that_stands_alone_is_a_file_of_its_kind(kind: str) -> None:
    made = picture(swept({"gains.velocity": [1.0, 2.0, 3.0]}), "error", kind)
    assert made[:5] == {"svg": "<?xml", "pdf": b"%PDF-", "png": b"\x89PNG\r"}[kind]
    assert made == picture(swept({"gains.velocity": [1.0, 2.0, 3.0]}), "error", kind)
    if kind == "svg":  # Matplotlib has placed the subscript
        assert "K_v" not in made and ">v<" in made.replace(" ", "")
