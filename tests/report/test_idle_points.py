"""Designs whose loop hardly works are marked in the pictures of sweeps, fronts and regions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vctune.analysis.demands import response, transparency_error
from vctune.analysis.tracking import tracking_terms
from vctune.document.reading import parse_problem
from vctune.model.gains import Coupling, Gains
from vctune.report.figures.region_figure import region_figure
from vctune.report.figures.sweep_figures import band_figure, sweep_figure, terms_figure
from vctune.study.plane import plane
from vctune.study.region import Kind, Region
from vctune.study.study_table import Table

PROBLEM = parse_problem(
    "[device]\nmass = 0.4\ndamping = 2.0\nsample_time = 1e-3\n[stability]\ncriterion = 'passive'\n", "x", "x"
)
POINTS = np.array([1.0, 2.0, 3.0, 4.0])
IDLE = np.array([False, True, False, True])


def table_of(*keys):
    axes = {key: POINTS + k for k, key in enumerate(keys)}
    terms = {f"{term}_term": POINTS / (1 + k) for k, term in enumerate(("coupling", "tracking", "admittance"))}
    return Table(axes, ["certified"] * 4, IDLE, [""] * 4, {"error": POINTS**2, **terms}, "linear")


def places(axes, label):
    """Return where the marks of a label are."""
    (line,) = [line for line in axes.lines if str(line.get_label()).startswith(label)]
    return np.column_stack((line.get_xdata(), line.get_ydata())).tolist()


@pytest.mark.parametrize(
    ("figure", "x", "y"),
    [
        (lambda: sweep_figure(table_of("device.mass"), grid=True), POINTS, POINTS**2),
        (lambda: sweep_figure(table_of("device.mass", "device.delay"), grid=False), POINTS, POINTS + 1),
        (lambda: terms_figure(table_of("gains.position")), POINTS, POINTS / 2),
        (lambda: band_figure(table_of("stability.band_hz[1]"), 30.0), POINTS, POINTS**2),
    ],
    ids=["line", "map", "terms", "band"],
)
def test_rings_are_around_idle_points(figure, x, y):
    axes = figure().axes[0]
    assert places(axes, "idle") == np.column_stack((x, y))[IDLE].tolist()
    assert any(text.get_text().startswith("idle") for text in axes.get_legend().get_texts())


def test_a_region_has_the_line_beyond_which_loops_hardly_work():
    across = plane(PROBLEM, "gains.velocity", "gains.position", 4)
    squares = across.coarsest_squares()
    found = Region(across, squares, np.full(squares.shape[1], Kind.UNDECIDED), np.full(squares.shape[1], np.nan))
    works, hardly = (Gains(K_v, 1000.0) for K_v in (200.0, 1.0))
    designs = [(gains, Coupling(100.0, 0.3, 0.0)) for gains in (works, hardly)]
    axes = region_figure(PROBLEM, found, designs).axes[0]
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert {"optimum", "optimum, idle", "idle where |1 - G_he| > 0.5"} <= set(labels)


def test_the_tracking_term_of_many_loops_is_that_of_each():
    K_v, K_p = np.meshgrid([1.0, 30.0, 500.0], [0.0, 100.0])
    found = tracking_terms(PROBLEM, Gains(K_v, K_p))
    for place in np.ndindex(found.shape):
        each = transparency_error(PROBLEM, Gains(K_v[place], K_p[place]), Coupling(100.0, 0.3, 0.0)).tracking
        assert found[place] == pytest.approx(each, rel=1e-6)


def test_beyond_the_line_of_a_region_the_required_resistance_is_unbounded():
    """The lag in the line includes the actuator's, which is greater than T/2 here."""
    slow = parse_problem(
        "[device]\nmass = 0.4\ndamping = 2.0\nsample_time = 1e-3\n[device.actuator]\nbandwidth_hz = 100.0\n"
        "[stability]\ncriterion = 'passive'\n",
        "x",
        "x",
    )
    across = plane(slow, "gains.velocity", "gains.position", 4)
    squares = across.coarsest_squares()
    found = Region(across, squares, np.full(squares.shape[1], Kind.UNDECIDED), np.full(squares.shape[1], np.nan))
    axes = region_figure(slow, found, []).axes[0]
    (line,) = [line for line in axes.lines if str(line.get_label()).startswith("τ")]
    shares = np.linspace(0, 1, len(across.edges[0]))
    inside = np.flatnonzero(np.isfinite(line.get_ydata()))[-1]
    K_v, K_p = (
        np.interp(data[inside], shares, edges)
        for data, edges in zip((line.get_xdata(), line.get_ydata()), across.edges, strict=True)
    )
    resistance = [
        response(slow.device, Gains(K_v, share * K_p), np.array([1e-3])).resistance[0] for share in (0.999, 1.001)
    ]
    assert resistance[0] > 0 > resistance[1]


@pytest.mark.parametrize(("display", "of_tracking"), [("admittance", "|1 - G_he|"), ("impedance", "|1 - A H/N|")])
def test_the_front_names_the_terms_of_its_display(display, of_tracking):
    axes = terms_figure(replace(table_of("gains.velocity"), display=display)).axes[0]
    assert axes.get_ylabel() == of_tracking
