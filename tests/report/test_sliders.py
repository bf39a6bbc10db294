"""The sliders of a page close the same loop as the rest: the script against the Python, in a real browser."""

from __future__ import annotations

import re
from dataclasses import astuple
from functools import cache
from itertools import product

import numpy as np
import pytest
from conftest import DEVICE, FIXED, mostly_slow
from pages import PARTS, chromium, made, needs_chromium, opened, recorded

from vctune.analysis.demands import sensitivity_maxima, stability_ratio, transparency_error
from vctune.analysis.feel import felt_impedance
from vctune.analysis.in_hands import least_ratios_in_any_hand, least_ratios_in_hands
from vctune.analysis.margins import unstable_poles
from vctune.document.reading import parse_problem
from vctune.model.gains import Coupling, Gains, SpringDamper
from vctune.model.hands import Hand
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.sampled.any_hand import any_hand
from vctune.model.sampled.hand_loop import loop_in_hand, offered, required_in_hand
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand

pytestmark = needs_chromium
DRAG = FIXED.format(160.0) + "drag = 3.0\n"
PASSIVE = "[stability]\ncriterion = 'passive'\n"
CASES = {
    "any hand, peak": DEVICE + 'hold = "lag"\n' + DRAG + PASSIVE + "[transparency]\nnorm = 'peak'\n",
    "every hand, held": DEVICE + DRAG + "[operator]\nmass = 0.1\ndamping = 2.0\n",
    "every part": DEVICE + PARTS + DRAG.replace("150", "60").replace("6000", "1000"),
    "no integrator, long delay": DEVICE + "delay = 2e-2\n" + DRAG.replace("150", "4").replace("6000", "0"),
}
FORCE = """[device]
display = "impedance"
mass = 0.2
damping = 0.8
sample_time = 1e-3
"""
SPRING = "[gains]\nvelocity = {}\n[coupling]\ndamping = 0.1\nstiffness = 300.0\n"
CASES |= {
    "impedance, any hand": FORCE + "delay = 3e-4\n" + SPRING.format(0.2) + "[device.velocity]\nfilter_hz = 100.0\n",
    "impedance, hands": FORCE.replace("0.8", "0.9")
    + "actuator = { bandwidth_hz = 400.0 }\nvelocity = { filter_hz = 200.0, filter_order = 2 }\n"
    + "structure = { handle_mass = 0.05, frequency_hz = 150.0, damping_ratio = 0.05 }\n"
    + SPRING.format(0.3) + "[stability]\ncriterion = 'hands'\n[operator]\ndamping = 0.5\n",
}  # fmt: skip
CASES["servo"] = """[device]
sample_time = 2e-3
servo = { delay = 0.03, bandwidth_hz = 20.0, order = 2, command = "position" }
force_sensor = { bandwidth_hz = 80.0, delay = 1e-3 }
[coupling]
damping = 300.0
mass = 2.5
drag = 50.0
"""
TRIED = 20


@pytest.fixture(scope="module")
def browser():
    with chromium() as opened:
        yield opened


@pytest.fixture(scope="module")
def paths(tmp_path_factory):
    """Return a case's report, made when it is first asked for."""
    return cache(lambda name: made(recorded(CASES[name]), tmp_path_factory.mktemp("report")))


@pytest.fixture(scope="module", params=mostly_slow(CASES, ["impedance, any hand", "servo"]))
def tried(request, browser, paths):
    """The problem, the shipped numbers and tried ones, and what the page makes of them."""
    page = opened(browser, paths(request.param))
    shipped = page.evaluate("vctune.shipped")
    factors = np.random.default_rng(1).uniform(-1, 1, (TRIED, len(shipped)))
    points = [shipped, *(np.array(shipped) * 10.0**factors).tolist()]
    found = page.evaluate("(points) => points.map((each) => vctune.evaluate(each))", points)
    assert page.said == []
    return parse_problem(CASES[request.param], "x", "x"), points, found


def design(problem, point):
    if len(point) == 3 and not problem.device.kind.inverse:
        return Gains(0.0, 0.0), Coupling(*point)
    if len(point) == 3:
        return Gains(point[0], 0.0), SpringDamper(*point[1:])
    return Gains(*point[:2]), Coupling(*point[2:])


def test_the_error_is_that_of_the_design(tried):
    problem, points, found = tried
    for point, seen in zip(points, found, strict=True):
        there = transparency_error(problem, *design(problem, point))
        error = there.error
        assert seen["given_way"] == pytest.approx(
            there.coupling, rel=1e-5 if problem.transparency.norm == "rms" else 1e-2
        )
        if problem.transparency.norm == "rms":
            assert seen["error"] == pytest.approx(error, rel=1e-6 if point is points[0] else 1e-5)
        else:
            assert error * 0.99 < seen["error"] <= error * (1 + 1e-9)


def test_the_ratio_is_that_of_the_frequency_model(tried):
    problem, points, found = tried
    if not problem.passive:
        return
    low, high = problem.stability.band.hz
    for point, seen in zip(points, found, strict=True):
        (hz, ratio), = seen["lines"]["ratio"]  # fmt: skip
        hz = np.array(hz)
        there = stability_ratio(problem.device, *design(problem, point), 2 * np.pi * hz)
        shown = np.array([np.nan if each is None else each for each in ratio])
        some = np.isfinite(shown) & (there > 0)
        assert some.any() and shown[some] == pytest.approx(there[some], rel=1e-6)
        inside = (hz >= low * (1 - 1e-9)) & (hz <= high * (1 + 1e-9))
        if (there[inside] > 0).all():
            assert seen["ratio"] == pytest.approx(there[inside].min(), rel=1e-6)


def test_the_sampled_loop_is_the_exact_one(tried):
    problem, points, found = tried
    if not problem.device.kind.own_loop:
        assert not any(seen["peak"] or seen["unstable"] or "nyquist" in seen["lines"] for seen in found)
        return
    for number, (point, seen) in enumerate(zip(points, found, strict=True)):
        gains = design(problem, point)[0]
        assert seen["unstable"] == unstable_poles(problem.device, gains)
        peak = -float(sensitivity_maxima(problem, gains).value[0])
        assert seen["peak"] <= peak * (1 + 1e-9)
        assert number > 0 or seen["peak"] == pytest.approx(peak, rel=1e-6)


def test_the_hands_are_corners_of_the_box_and_the_worst_of_the_shipped_design(tried):
    """No less is asked for than in the worst corner; for the shipped design as much as in the worst hand."""
    problem, points, found = tried
    if problem.hands_met is None:
        return
    ends = zip(astuple(problem.hands_met.low), astuple(problem.hands_met.high), strict=True)
    corners = Hand(*(each[:, None] for each in np.array(list(product(*ends))).T))
    plant = plant_in_hand(problem.device, corners, delays_of(problem.device), FLOATS)
    worst = least_ratios_in_hands(problem.device, problem.hands_met, *design(problem, points[0]))[0]
    assert found[0]["hand_ratio"] == pytest.approx(worst.ratio, rel=1e-6)
    for point, seen in zip(points, found, strict=True):
        hz, required = (np.array(each, dtype=float)[1:] for each in seen["lines"]["in_hand"][1])
        theta = 2 * np.pi * hz * problem.device.sample_time
        there = loop_in_hand(plant, theta, FLOATS)
        asked = required_in_hand(there, design(problem, point)[0])
        scale = np.sin(theta / 2) ** 2 if problem.device.kind.inverse else 1.0
        in_corners = scale * np.max(asked.lost / asked.size, axis=0)
        rounded = 1e-6 * np.abs(in_corners) + 1e-15 * np.abs(in_corners).max()  # at Nyquist R may vanish
        assert (required >= in_corners - rounded).all()


def test_any_passive_hand_of_an_impedance_display_asks_for_what_the_proof_asks(tried):
    problem, points, found = tried
    if not problem.any_hand:
        return
    device, below = problem.device, 0
    delays = delays_of(device)
    for number, (point, seen) in enumerate(zip(points, found, strict=True)):
        gains, coupling = design(problem, point)
        least = least_ratios_in_any_hand(device, gains, coupling)[0].ratio
        assert least * (1 - 1e-9) <= seen["hand_ratio"] <= least * (1 + 1e-6 if number == 0 else 1.1)
        (hz, given), (_, required) = (np.array(line, dtype=float) for line in seen["lines"]["in_hand"])
        theta = 2 * np.pi * hz * device.sample_time
        asked = any_hand(device, delays.loop, theta, FLOATS, fractional=delays.loop_fractional).required(gains)
        scale, stable = np.sin(theta / 2) ** 2, asked.size > 0
        assert required[stable] == pytest.approx((scale * asked.lost / asked.size)[stable], rel=1e-6, abs=1e-12)
        assert given == pytest.approx(scale * offered(coupling, device, theta, FLOATS), rel=1e-9)
        below += least < 1
    assert 0 < below < len(points)


def test_what_is_felt_is_the_figures(tried):
    problem, points, found = tried
    environments = {"admittance": (), "impedance": (0j, None), "servo": (0j,)}[problem.device.display]
    for point, seen in zip(points, found, strict=True):
        for line, environment in zip(seen["lines"]["impedance"], environments, strict=bool(environments)):
            hz, felt = np.array(line)
            omega = 2 * np.pi * hz
            there = felt_impedance(
                problem.device, *design(problem, point), omega, None if environment is None else 0j * omega
            )
            assert felt == pytest.approx(np.abs(there), rel=1e-9)


@pytest.mark.slow
def test_a_slider_moves_curves_and_numbers_and_proves_nothing(browser, paths):
    page = opened(browser, paths("every hand, held"))
    mark, error = page.locator(".mark-of"), page.locator("#try table tr").nth(1)
    curves = "[...document.querySelectorAll('.tried path')].map((each) => each.getAttribute('d'))"
    said, shown = mark.inner_text(), error.inner_text()
    assert "shipped design" in said and set(page.evaluate(curves)) == {""}
    slider = page.locator("#try input[type=range]").nth(2)
    slider.press("End")
    assert "tried, not proved" in mark.inner_text() and error.inner_text() != shown
    assert all(page.evaluate(curves)) and "good" not in mark.get_attribute("class")
    slider.press("Home")
    assert "bad" in mark.get_attribute("class") and "ratio is below" in mark.inner_text()
    number, ends = page.locator("#try input[type=text]").nth(2), page.locator(".slider .ends").nth(2).inner_text()
    low, _, top = re.findall(r"[\d.]+|shipped", ends)
    assert float(low) == 16.0 and float(top) == 1600.0 and float(number.input_value()) == 16.0
    number.fill("320")
    assert "damping = 320" in page.locator(".tries pre").text_content()
    assert 500 < float(slider.input_value()) < 1000
    number.fill("much")
    assert number.get_attribute("aria-invalid") == "true"
    assert "damping = 320" in page.locator(".tries pre").text_content()
    page.locator("#try button").click()
    assert mark.inner_text() == said and error.inner_text() == shown and set(page.evaluate(curves)) == {""}
    assert page.said == []


@pytest.mark.slow
def test_tried_curves_lie_where_the_shipped_ones_are_drawn(browser, paths):
    """A thousandth beside the shipped gains the script draws within a point of the drawn curve."""
    page = opened(browser, paths("any hand, peak"))
    page.locator("#try input[type=range]").first.press("ArrowRight")
    found = page.evaluate(
        """() => [...document.querySelectorAll('#figure-transparency .tried path')].map((path) => {
          const middle = path.getPointAtLength(path.getTotalLength() / 2);
          const drawn = [...document.querySelectorAll('#figure-transparency > .figure > svg path:not(.tried path)')];
          return Math.min(...drawn.filter((each) => each.getTotalLength() > 50).map((each) => {
            const places = Array.from({ length: 2 * each.getTotalLength() }, (_, k) => each.getPointAtLength(k / 2));
            return Math.min(...places.map((at) => Math.hypot(at.x - middle.x, at.y - middle.y)));
          }));
        })"""
    )
    assert len(found) == 4 and max(found) < 1.0


@pytest.mark.slow
def test_without_scripts_the_page_is_whole_and_the_sliders_are_not_there(browser, paths):
    page = opened(browser, paths("every hand, held"), java_script_enabled=False)
    assert not page.locator("#try").is_visible()
    assert page.locator(".figure > svg").count() == 6
    assert all(each.is_visible() for each in page.locator(".figure > svg").all())
    for title in ("Requirements", "Claims", "Assumptions", "How it feels"):
        assert page.get_by_role("heading", name=title).is_visible()
