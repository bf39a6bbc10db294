"""Pictures do not mislead: curves keep their shape, and nothing is told by colour alone."""

from __future__ import annotations

import itertools
import re
from io import BytesIO
from xml.etree import ElementTree

import numpy as np
import pytest
from conftest import DEVICE, for_passive_hands
from hypothesis import given
from hypothesis import strategies as st
from matplotlib import rc_context
from matplotlib.colors import to_rgb

from vctune.analysis.in_hands import least_ratios_in_hands
from vctune.design.solve import solve
from vctune.design.verdict.design_record import record_of
from vctune.document.reading import ProblemFile, parse_problem
from vctune.model.gains import Coupling, Gains
from vctune.model.hands import Hand, Hands
from vctune.report.figures.design_figures import Design, figures
from vctune.report.figures.experiment_figures import simulation_figure
from vctune.report.figures.hands_figure import _regions, hands_figure, shares_required
from vctune.report.figures.region_figure import BAD, GOOD, OPEN
from vctune.report.figures.sweep_figures import sweep_figure
from vctune.report.figures.with_matplotlib import _shortened, svg
from vctune.report.page.contents import IDENTIFICATION_READINGS, READINGS
from vctune.report.page.page import inline_svg
from vctune.report.svg.elements import LETTER, PAPER, SIZE, polyline
from vctune.simulation.mechanics.intended_motion import stroke_time
from vctune.simulation.simulation_record import CURVE_POINTS, simulation_record
from vctune.simulation.two_runs import simulate
from vctune.study.study_table import Table

EXPERIMENTS = """
[[experiment]]
name = "free"
environment = { damping = 0.0 }
operator = { to = 0.02, cycles = 2 }
friction = { coulomb = 0.3 }
baseline = { kp = 30.0, kd = 2.0, mass = 0.3, damping = 5.0 }
"""


def off(points, kept):
    """Return how far each point is from the polyline through those that are kept."""
    ends = points[kept]
    start, along = ends[:-1], np.diff(ends)
    share = ((points[:, None] - start) * along.conj()).real / np.maximum(abs(along) ** 2, 1e-300)
    return np.abs(points[:, None] - start - np.clip(share, 0, 1) * along).min(axis=1)


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
    for name in ("baseline", "design"):
        traces, drawn = getattr(made, name).traces, np.array(getattr(shown, name).curve)
        later = traces.time >= first * (1 - 1e-9)
        step = -(-int(later.sum()) // CURVE_POINTS)
        assert drawn == pytest.approx(np.column_stack([traces.velocity, traces.force])[later][::step], rel=1e-4)
        assert CURVE_POINTS / 2 < len(drawn) <= CURVE_POINTS


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


@pytest.fixture(scope="module")
def drawn(measured):
    problem = parse_problem(for_passive_hands(DEVICE), "x", "x")
    solved = solve(problem)
    record = record_of(ProblemFile(problem, DEVICE), solved)
    made = figures(Design(problem, solved.judgement.gains, solved.judgement.coupling, record))
    return made | {"simulation": simulation_figure(measured[1])}


def test_lines_are_told_apart_without_colour(drawn):
    assert set(drawn) == {"llewellyn", "nyquist", "transparency", "impedance", "simulation"}
    for name, drawing in drawn.items():
        for panel in drawing.panels:
            lines = [mark for mark in panel.marks if mark.named and not mark.closed]
            styles = [([line.width * each for each in line.dashes], line.width > 0, line.marker) for line in lines]
            paired = [(a.label, b.label) for a, b in itertools.combinations(lines, 2)]
            same = [pair for pair, (a, b) in zip(paired, itertools.combinations(styles, 2), strict=True) if a == b]
            assert not same, name


def test_the_limit_the_safety_factor_and_the_least_ratio_are_apart(drawn):
    lower = drawn["llewellyn"].panels[1]
    heights = lower.y.shares(np.array([1.0, 1.05]), lower.get_ylim())
    assert heights[1] - heights[0] > 0.1 and heights[0] > 0


def test_the_bands_of_the_promises_are_shaded(drawn):
    for name, bands in {
        "llewellyn": {"requested band"}, "transparency": {"transparency band"},
        "impedance": {"transparency band", "proved stable"},
    }.items():  # fmt: skip
        for panel in drawn[name].panels:
            assert bands <= {mark.label for mark in panel.marks if mark.closed}


def test_files_have_a_ground_of_their_own_and_pages_show_theirs(drawn):
    text = drawn["nyquist"].svg("nyquist")
    assert PAPER in text and PAPER not in inline_svg(text, "in words")
    assert not re.search(r'\bd="[^"]*\d\.\d{3}', text)


@pytest.fixture(scope="module")
def in_hands():
    hands = Hands(Hand(0.0, 0.0, 0.0), Hand(0.55, 30.5, 3000.5))
    return hands_figure(parse_problem(DEVICE, "x", "x"), hands, Gains(150.0, 6000.0), Coupling(160.0, 0.35, 3.0))


SVG = "{http://www.w3.org/2000/svg}"


@pytest.mark.parametrize(
    "high",
    [Hand(0.2, 30.0, 3000.0), Hand(0.55, 30.0, 700.0), Hand(0.55, 30.0, 0.0)],
    ids=["mass", "stiffness", "without-stiffness"],
)
def test_a_figure_of_hands_without_a_plane_has_no_map_and_no_nan(high):
    low = Hand(0.2, 0.0, min(high.stiffness, 700.0))
    problem = parse_problem(DEVICE, "x", "x")
    drawing = hands_figure(problem, Hands(low, high), Gains(150.0, 6000.0), Coupling(160.0, 0.35, 3.0))
    assert len(drawing.panels) == 2
    assert "nan" not in drawing.svg("hands").lower()


def test_the_map_of_hands_is_painted_also_where_they_require_nothing():
    """If no hand requires anything, the area of the lowest level is the whole map."""
    mass, stiffness = np.array([0.0, 0.1, 0.5]), np.array([0.0, 1000.0, 3000.0])
    painted = _regions(mass, stiffness, np.zeros((3, 3)), 0)
    assert sum(np.ptp(x[:-1]) * np.ptp(y[:-1]) for x, y in painted) == pytest.approx(np.ptp(mass) * np.ptp(stiffness))


def test_the_map_shows_the_inverse_of_the_least_ratio():
    problem, gains, coupling = parse_problem(DEVICE, "x", "x"), Gains(150.0, 6000.0), Coupling(160.0, 0.35, 3.0)
    mass, stiffness, needed = shares_required(
        problem.device, Hands(Hand(0.0, 5.0, 0.0), Hand(0.55, 5.0, 3000.0)), gains, coupling
    )
    for row, column in ((4, 8), (8, 4), (16, 16)):
        hand = Hand(mass[column], 5.0, stiffness[row])
        least = least_ratios_in_hands(problem.device, Hands(hand, hand), gains, coupling)[0]
        assert needed[row, column] == pytest.approx(1 / least.ratio, rel=0.02)


def test_drawings_are_xml_with_all_marks_cut_at_their_panels(drawn, in_hands):
    """All marks of a panel that end at its edges are in its clip path, and no two elements share a name."""
    for name, drawing in {**drawn, "hands": in_hands}.items():
        made = ElementTree.fromstring(drawing.svg(name).encode())
        named = [each.get("id") for each in made.iter() if each.get("id")]
        assert len(set(named)) == len(named) and all(each.startswith(f"{name}-") for each in named)
        cut = {each.get("clip-path")[5:-1]: each for each in made.iter(f"{SVG}g") if each.get("clip-path")}
        assert len(cut) == len(drawing.panels)
        for k, panel in enumerate(drawing.panels):
            inside = [mark for mark in panel.marks if mark.clipped]
            assert len([*cut[f"{name}-{k}"].iter(f"{SVG}path")]) >= len(inside) - sum(mark.alone for mark in inside)


def test_nothing_of_a_drawing_is_beyond_its_edge(drawn, in_hands):
    """Tick labels as wide as they come included, and the longest legends."""
    for name, drawing in {**drawn, "hands": in_hands}.items():
        made = ElementTree.fromstring(drawing.svg(name).encode())
        shifts = {id(each): shift(group) for group in made.iter(f"{SVG}g") for each in group.iter(f"{SVG}text")}
        for each in made.iter(f"{SVG}text"):
            words, size = "".join(each.itertext()), float(each.get("font-size", SIZE))
            wide, (left, top) = LETTER * size * len(words), shifts.get(id(each), (0.0, 0.0))
            x, y = left + float(each.get("x")), top + float(each.get("y"))
            if "rotate(-90" in each.get("transform", ""):
                assert x - size * 0.8 >= 0 and x <= drawing.width, (name, words)
                assert y - wide / 2 >= -8 and y + wide / 2 <= drawing.height + 8, (name, words)
            elif not each.get("transform"):
                start = x - wide * {"middle": 0.5, "end": 1.0}.get(each.get("text-anchor"), 0.0)
                assert start >= -2 and start + wide <= drawing.width + 8, (name, words)
                assert y - size * 0.7 >= 0 and y <= drawing.height, (name, words)


def shift(group):
    found = re.match(r"translate\(([-\d.]+) ([-\d.]+)\)", group.get("transform", ""))
    return (float(found[1]), float(found[2])) if found else (0.0, 0.0)


@given(
    st.lists(st.tuples(st.floats(-500, 500), st.floats(-500, 500)), min_size=2, max_size=40),
    st.integers(1, 30),
)
def test_the_steps_of_a_curve_lead_where_its_points_are(points, between):
    """To a quarter of a point, however long the curve is and however closely its points lie."""
    places = np.array(points)
    shares = np.linspace(0, 1, between * (len(places) - 1) + 1) * (len(places) - 1)
    dense = np.stack([np.interp(shares, np.arange(len(places)), places[:, k]) for k in (0, 1)], axis=1)
    numbers = np.array(re.findall(r"-?(?:\d+\.?\d*|\.\d+)", polyline(dense)), float).reshape(-1, 2)
    along = np.cumsum(numbers, axis=0) @ [1, 1j]
    assert len(along) <= len(dense) + 1
    assert off(np.concatenate((along, dense @ [1, 1j])), np.arange(len(along))).max() <= 0.28
    assert abs(along[-1] - places[-1] @ [1, 1j]) <= 0.08


def test_a_curve_is_interrupted_where_it_is_not_finite():
    assert polyline(np.array([(0, 0), (1, 2), (np.nan, 0), (3, 0.04), (4, -1.26)])) == "M0 0l1 2M3 0l1-1.3"


@pytest.fixture(scope="module")
def by_matplotlib():
    points = np.array([1.0, 2.0, 3.0, 4.0])
    table = Table({"device.mass": points}, ["certified"] * 4, points > 2, [""] * 4, {"error": points**2}, "linear")
    return {"error": sweep_figure(table, grid=True)}


def test_files_say_nothing_to_no_end(by_matplotlib):
    """A line that follows a line goes without its letter; one that follows a curve keeps it."""
    for name, figure in by_matplotlib.items():
        text = svg(figure, name)
        assert "<metadata>" not in text and "rotate(-0" not in text
        for path in re.findall(r'\bd="([^"]*)"', text):
            letters = re.findall("[A-Za-z]", path)
            assert ("M", "L") not in itertools.pairwise(letters) and ("L", "L") not in itertools.pairwise(letters)


def test_files_are_xml_with_all_shapes_cut_at_their_axes(by_matplotlib):
    """As many shapes as Matplotlib draws, each in the same clip path."""
    for name, figure in by_matplotlib.items():
        stream = BytesIO()
        with rc_context({"svg.hashsalt": name, "svg.fonttype": "none"}):
            figure.savefig(stream, format="svg", dpi=150)
        raw, made = ElementTree.fromstring(stream.getvalue()), ElementTree.fromstring(svg(figure, name).encode())
        for kind in ("path", "use", "text", "clipPath"):
            there, here = ([*each.iter(f"{SVG}{kind}")] for each in (raw, made))
            assert len(here) == len(there), (name, kind)
            assert [each.get("clip-path") for each in here] == [each.get("clip-path") for each in there]
        cut = {each.get("clip-path")[5:-1] for each in made.iter() if each.get("clip-path")}
        assert cut <= {each.get("id") for each in made.iter(f"{SVG}clipPath")}


def test_letters_of_lines_after_curves_stay():
    path = re.match(".*", 'd="M 1.250 2.0 \nL 3.001 4.0 \nQ 5 6 7 8.00 \nL 9 10.0 \nL 11.0 -0.001 \nz\n"', re.DOTALL)
    assert _shortened(path) == 'd="M 1.2 2\nl 1.8 2\nQ 5 6 7 8\nL 9 10\nL 11 -0\nz\n"'


@given(st.lists(st.tuples(st.floats(-500, 500), st.floats(-500, 500)), min_size=2, max_size=40))
def test_the_steps_of_a_curve_of_matplotlib_lead_where_its_points_are(points):
    """To half a tenth of a point at every place, however long the curve; what is left out does not move."""
    text = "M " + "L ".join(f"{x:.6f} {y:.6f} \n" for x, y in points)
    drawn = _shortened(re.match(".*", f'd="{text}"', re.DOTALL))
    numbers = np.array(re.findall(r"-?(?:\d+\.?\d*|\.\d+)", drawn), float).reshape(-1, 2)
    along = np.cumsum(numbers, axis=0)
    far = [np.abs(along - point).max(axis=1).min() for point in points]
    assert max(far) <= 0.05 + 1e-5
    assert np.abs(along[-1] - points[-1]).max() <= 0.05 + 1e-5


def test_no_two_figures_of_a_page_share_a_class():
    """The names of classes are the ends of the figures' names and a number."""
    for names in (READINGS, IDENTIFICATION_READINGS):
        assert len({name[0] + name[-1] for name in names}) == len(names)
