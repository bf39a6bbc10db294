"""Pictures do not mislead: what is drawn is described and the reverse, and nothing is told by colour alone."""

from __future__ import annotations

import itertools
import re
from functools import cache
from xml.etree import ElementTree

import numpy as np
import pytest
from conftest import DEVICE, FIXED, for_passive_hands, mostly_slow
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb, to_rgba
from pages import PARTS, SERVO, recorded

from vctune.document.reading import ProblemFile, parse_problem
from vctune.document.records.design_json import design_of
from vctune.model.gains import Coupling, Gains
from vctune.report.curves import requirements
from vctune.report.design_figures import design_figures
from vctune.report.experiments import simulation_figure
from vctune.report.page import summary
from vctune.report.paths import DESIGN_FIGURES
from vctune.report.study_figures import BAD, GOOD, OPEN
from vctune.report.style import GREY, PAPER, svg
from vctune.simulation.scene import stroke_time
from vctune.simulation.simulation_record import CURVE_POINTS, simulation_record
from vctune.simulation.two_runs import simulate

HELD = FIXED.format(160.0) + "drag = 3.0\n"
IMPEDANCE = """[device]
display = "impedance"
mass = 0.045
damping = 0.25
sample_time = 1e-3
delay = 5e-4
velocity = { from = "difference", filter_hz = 100.0 }
[gains]
velocity = 0.0
[coupling]
damping = 0.045
stiffness = 150.0
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
    "rotary": """[device]
units = "rotary"
mass = 0.01
damping = 0.05
sample_time = 1e-3
[stability]
criterion = "passive"
[gains]
velocity = 2.0
position = 50.0
[coupling]
damping = 3.0
mass = 0.01
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
            assert all(box.x1 <= whole.x1 + 12 for box in boxes), (each.name, boxes)


def test_the_limit_the_safety_factor_and_the_least_ratio_are_apart(drawn):
    for kind in ("any passive hand", "least operator"):
        low, high = drawn(kind)[0].figure.axes[1].get_ylim()
        assert 0.05 / (high - low) > 0.07 and low < 1.0


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


# colours: Machado, Oliveira and Fernandes (2009), severity 1

SIGHTS = {
    "normal": np.eye(3),
    "deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
    "protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
}


def lab(colour, sight):
    """Return CIELAB of an sRGB colour as it is seen."""
    channels = np.array(to_rgb(colour))
    linear = np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)
    seen = np.clip(SIGHTS[sight] @ linear, 0, 1)
    xyz = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]] @ seen
    ratio = xyz / [0.9505, 1.0, 1.089]
    f = np.where(ratio > (6 / 29) ** 3, np.cbrt(ratio), ratio / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("sight", SIGHTS)
def test_regions_are_told_apart_by_everyone_and_in_grey(sight):
    for (one, mark), (other, other_mark) in itertools.combinations((GOOD, BAD, OPEN), 2):
        difference = lab(one, sight) - lab(other, sight)
        assert np.linalg.norm(difference) > 25
        assert abs(difference[0]) > 12
        assert mark != other_mark
