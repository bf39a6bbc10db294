"""Pages and figures beside those of a design: identification, controller, several axes, benchmarks."""

from __future__ import annotations

import json
import re
from functools import cache

import numpy as np
import pytest
from conftest import DEVICE, FIXED, mostly_slow
from identification_logs import random_case
from matplotlib.collections import PolyCollection
from pages import recorded
from servo_logs import servo_case

from vctune import export, identify
from vctune.document.records.design_file import design_of
from vctune.report.figures.benchmark_figures import Panel, Series, benchmark_figure
from vctune.report.figures.identification_figures import identification_figures
from vctune.report.identification_report import identification_files
from vctune.report.page.axes_page import axes_page
from vctune.report.page.contents import REPORT
from vctune.report.typography import html, quantity, span

OUTSIDE = r"(src|href)=\"(?!#|data:)"
"""An address beyond the page."""


@pytest.fixture(scope="module")
def identified(tmp_path_factory):
    """Return what a log gives, periodic or of a servo, when it is first asked for."""

    def found(kind):
        folder = tmp_path_factory.mktemp(kind)
        if kind == "servo":
            return identify(servo_case(3, n=800).write(folder), servo=True)
        return identify(*random_case(1).log.write(folder))

    return cache(found)


# identification


@pytest.mark.slow
def test_the_grey_band_contains_every_measured_line(identified):
    """What the text above the figure says of the sizes; dry friction turns the phase of slow lines beyond the box."""
    log = identified("periodic")
    size, phase, repeat = identification_figures(log.found, log.record)["response"].axes
    measured = log.found.records[0].periodic.measured.position
    (band,) = (each.get_paths()[0].vertices for each in size.collections if isinstance(each, PolyCollection))
    for omega, ratio in zip(measured.omega, measured.ratio, strict=True):
        at = band[np.isclose(band[:, 0], omega / (2 * np.pi), rtol=1e-9), 1]
        assert at.min() * (1 - 1e-9) <= abs(ratio) <= at.max() * (1 + 1e-9)
    assert len(phase.collections) == 1
    assert repeat.lines[0].get_ydata() == pytest.approx(measured.coherence)


@pytest.mark.parametrize("kind", mostly_slow(("periodic", "servo"), ["servo"]))
def test_the_bars_are_the_box_and_the_dots_what_was_found(identified, kind):
    record = identified(kind).record
    (axes,) = identification_figures(identified(kind).found, record)["numbers"].axes
    assert [label.get_text() for label in axes.get_yticklabels()] == [each.key for each in record.numbers]
    for bar, number in zip(axes.patches, record.numbers, strict=True):
        ends = np.array([bar.get_x(), bar.get_x() + bar.get_width()]) / 100
        assert number.value * (1 + ends) == pytest.approx([number.low, number.high], rel=1e-9)
    dots = [line.get_xdata()[0] for line in axes.lines if line.get_marker() == "o"]
    found = [100 * (one.value / each.value - 1) for each in record.numbers for one in each.estimates]
    assert dots == pytest.approx(found, abs=1e-9)


def test_a_servo_is_shown_closely_where_its_fit_is_furthest_off(identified):
    """And both panels have one residual, whatever the prefixes of their units."""
    log = identified("servo")
    close, whole = identification_figures(log.found, log.record)["following"].axes
    (seen,), (made,) = ([line.get_ydata() for line in close.lines if style in line.get_label()] for style in MADE)
    factor = {"m": 1.0, "mm": 1e-3, "µm": 1e-6, "nm": 1e-9}
    of = {axes: factor[axes.get_ylabel().rpartition(", ")[2]] for axes in (close, whole)}
    assert np.abs(seen - made).max() * of[close] == pytest.approx(
        np.abs(whole.lines[0].get_ydata()).max() * of[whole], rel=1e-6
    )


MADE = "measured", "fit"


@pytest.mark.parametrize("kind", mostly_slow(("periodic", "servo"), ["servo"]))
def test_a_report_of_an_identification_stands_alone_and_names_the_widest_range(identified, kind, tmp_path):
    log = identified(kind)
    files = identification_files(log.found, log.record, tmp_path)
    page = files[tmp_path / REPORT]
    assert not re.search(OUTSIDE, page) and len(page.encode()) < 250_000
    embedded = re.search(r"id=\"identification\">(.*?)</script>", page, re.DOTALL)[1]
    assert json.loads(embedded) == log.record.to_json()
    widest = max(log.record.numbers, key=lambda each: (each.high - each.low) / each.value)
    first = page[: page.index("<table")]
    assert html(f"{widest.key} has the widest range: {span(widest.low, widest.high, widest.unit)}") in first
    assert "<code>vctune solve device.toml</code>" in first
    assert all(str(quantity(each.value, each.unit)) in page for each in log.record.numbers)
    assert len(re.findall(r"<svg role=\"img\" aria-label=\"[^\"]*\d", page)) == len(files) - 1
    assert files == identification_files(log.found, log.record, tmp_path)


# a controller


def test_a_controller_s_page_has_every_equation_and_all_digits(tmp_path):
    (tmp_path / "held.toml").write_text(DEVICE + FIXED.format(160.0) + "drag = 3.0\n")
    made = export(tmp_path / "held.toml", to="json", unproved=True)
    controller, page = (made.files[name] for name in ("controller.json", "controller.html"))
    controller = json.loads(controller)
    codes = re.findall(r"<code>([^<]*)</code>", page)
    for one in controller["equations"]:
        assert one["name"] in codes and one["is"].replace(">", "&gt;") in codes
    for name, one in controller["coefficients"].items():
        assert name in codes and str(one["value"]) in codes
    assert not re.search(OUTSIDE, page)
    assert ('class="verdict bad"' in page) == ("not_proved" in controller)


# several axes


@pytest.fixture(scope="module")
def axes():
    held = design_of(recorded(DEVICE + FIXED.format(160.0) + "drag = 3.0\n[stability]\ncriterion = 'passive'\n"), "x")
    return {"x": held, "<y>": replace_status(held)}


def replace_status(record):
    return record.model_copy(update={"status": "violated", "reason": "it is missed"})


def test_a_page_of_axes_marks_the_axis_that_is_not_for_use(axes):
    page = axes_page("arm", axes, reported=True)
    assert "1 of 2 axes not certified" in page and "&lt;y&gt;: it is missed." in page and "<y>" not in page
    assert page.count("claim proved") == page.count("claim refuted") == 1
    links = re.findall(r"<a href=\"([^\"]*)\">", page)
    assert len(links) == 2 and all(link.endswith(f"/{REPORT}") for link in links)
    alone = axes_page("arm", {"x": axes["x"]}, reported=False)
    assert "every axis certified" in alone and "<a " not in alone and "axes not certified" not in alone


# benchmarks


def test_benchmarks_differ_by_more_than_colour_and_nothing_is_below_the_floor():
    points = [Series(f"{k}", [1.0, 10.0, 100.0], [0.0, 1e-9, 0.1 * (k + 1)]) for k in range(5)]
    empty = Panel("nothing", "s", "error", [Series("none", [], [])])
    (axes,) = benchmark_figure([Panel("some", "time, s", "error, 1", points, floor=1e-6), empty]).axes
    drawn = [line for line in axes.lines if line.get_label().isdigit()]
    assert len({line.get_marker() for line in drawn}) == len(points)
    for line, series in zip(drawn, points, strict=True):
        assert list(line.get_ydata()) == [1e-6, 1e-6, series.y[2]] and list(line.get_xdata()) == series.x
    assert axes.get_xscale() == axes.get_yscale() == "log"
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("time, s", "error, 1")
