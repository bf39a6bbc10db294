"""What a better device would be worth: exact, the same in every unit, told where it was asked for and nowhere else."""

from __future__ import annotations

import json

import pytest
from command import run
from conftest import DEVICE, FIXED, ROOT, for_passive_hands, mostly_slow

from vctune import solve
from vctune.design import prices as pricing
from vctune.design.prices import BETTER, with_prices
from vctune.design.record import record_of
from vctune.document.prices import PriceRecord
from vctune.document.reading import ProblemFile, parse_problem, read_problem
from vctune.model.device import NUMBERS
from vctune.model.units import LINEAR

REAL = """
[device]
mass = 0.3
damping = 1.5
sample_time = 5e-4
delay = 2e-4
actuator = { bandwidth_hz = 700.0 }
velocity = { from = "difference", filter_hz = 300.0 }
force_sensor = { bandwidth_hz = 400.0, delay = 3e-4 }
structure = { handle_mass = 0.05, frequency_hz = 250.0, damping_ratio = 0.03 }
[operator]
damping = 0.5
[gains]
position = { min = 1000.0, max = 1e5 }
[coupling]
drag = { min = 0.0, max = 50.0 }
[transparency]
band_hz = [0.5, 20.0]
reference_impedance = 10.0
[stability]
criterion = 'passive'
band_hz = [0.5, 80.0]
"""
"""A device that has every number there is."""
WHEEL = (ROOT / "problems/friction-wheel.toml").read_text()


def priced(text):
    return with_prices(solve(parse_problem(for_passive_hands(text), "x", "x")))


@pytest.fixture(scope="module")
def real():
    return priced(REAL)


@pytest.mark.slow
def test_every_number_of_a_device_has_a_price(real):
    assert set(BETTER) == set(NUMBERS)
    assert {price.key for price in real.prices} == {f"device.{key}" for key in NUMBERS}
    errors = [price.error for price in real.prices]
    assert errors == sorted(errors)


@pytest.mark.slow
@pytest.mark.parametrize("text", [WHEEL, REAL, (ROOT / "problems/extremes/feather.toml").read_text()])
def test_prices_are_those_of_solving_again(text, real):
    """From the start, whichever basin the answer then lies in."""
    solved = real if text == REAL else priced(text)
    device = solved.problem.device
    for price in solved.prices:
        key = price.key.removeprefix("device.")
        found = {new: solve(problem).judgement for new, problem in pricing._better(solved.problem, key).items()}
        error, new = min((judgement.error, new) for new, judgement in found.items())
        assert price.old == device.number(key)
        assert (price.new, price.error) == pytest.approx((new, error), rel=1e-6)
        assert price.change == pytest.approx(error / solved.judgement.error - 1, abs=1e-6)


def test_a_change_of_units_changes_nothing():
    here = priced(DEVICE + "actuator = { bandwidth_hz = 400.0 }\n")
    there = with_prices(solve(here.problem.in_units(20.0, 3e-3)))
    assert [price.key for price in there.prices] == [price.key for price in here.prices]
    assert [price.change for price in there.prices] == pytest.approx([p.change for p in here.prices], abs=1e-5)


REFERENCES = sorted(path.stem for path in (ROOT / "tests/reference/real").glob("*.toml"))


@pytest.mark.parametrize("name", mostly_slow(REFERENCES, ["real-actuator", "real-flexible"]))
def test_what_is_late_costs_and_what_is_quick_pays(name):
    late = ("time", "delay", "bandwidth_hz", "frequency_hz")
    text = (ROOT / f"tests/reference/real/{name}.toml").read_text()
    prices = [price for price in priced(text).prices if price.key.endswith(late)]
    assert prices and all(price.change < -1e-3 for price in prices)


def test_no_number_is_asked_for_that_no_file_can_state():
    text = DEVICE + 'velocity = { from = "difference", filter_hz = 490.0 }\n'
    prices = {price.key: price for price in priced(text).prices}
    assert prices["device.velocity.filter_hz"].new == pytest.approx(441.0)
    assert "device.delay" not in prices, "there is none"


def test_parts_without_a_low_pass_have_prices():
    text = DEVICE + 'velocity = { from = "difference" }\nforce_sensor = { delay = 5e-4 }\n[coupling]\ndrag = 1.0\n'
    prices = priced(text).prices
    assert {price.key.removeprefix("device.") for price in prices} == {
        "mass", "damping", "sample_time", "force_sensor.delay",
    }  # fmt: skip


def test_fixed_gains_are_judged_on_the_better_device():
    prices = priced(DEVICE + FIXED.format(160.0)).prices
    assert {price.key for price in prices} == {"device.mass", "device.damping", "device.sample_time"}
    assert priced(DEVICE + FIXED.format(50.0)).prices is None


def test_what_takes_too_long_is_not_tried(monkeypatch):
    monkeypatch.setattr(pricing, "LONGEST", -1.0)
    prices = priced(DEVICE).prices
    assert len(prices) == 3
    assert all((price.new, price.error, price.change) == (None, None, None) for price in prices)


@pytest.mark.parametrize(
    ("new", "error", "change", "said"),
    [
        (0.9, 0.8, -0.2, "-20.0 %"),
        (0.9, 1.1, 0.1, "+10.0 %"),
        (0.9, 1.0, -4e-4, "no difference"),
        (0.9, None, None, "no design found"),
        (None, None, None, "not tried: the others took too long"),
    ],
)
def test_what_it_is_worth_in_words(new, error, change, said):
    record = PriceRecord(key="device.actuator.bandwidth_hz", old=1.0, new=new, error=error, change=change)
    assert record.worth == said
    assert record.cells(LINEAR)[2] == "Hz"


def test_every_number_has_its_unit(real):
    file = ProblemFile(real.problem, REAL)
    units = {row.key: row.cells(LINEAR)[2] for row in record_of(file, real).prices}
    assert units["device.structure.damping_ratio"] == "" and units["device.force_sensor.delay"] == "s"
    assert units["device.sample_time"] == "s" and units["device.structure.handle_mass"] == "kg"


def test_they_are_in_the_file_where_there_is_a_report(tmp_path):
    (tmp_path / "device.toml").write_text(for_passive_hands(DEVICE))
    folder = tmp_path / "results/device"
    assert run("solve", "device.toml", "--quiet", cwd=tmp_path).returncode == 0
    assert "prices" not in json.loads((folder / "design.json").read_text())
    assert run("solve", "device.toml", "--quiet", cwd=tmp_path, report=True).returncode == 0
    record = json.loads((folder / "design.json").read_text())
    assert {price["key"] for price in record["prices"]} == {"device.sample_time", "device.mass", "device.damping"}
    page = (folder / "report.html").read_text()
    assert "What a better device would be worth" in page
    assert run("report", folder / "design.json", "--out", "again", cwd=tmp_path).returncode == 0
    assert (tmp_path / "again/report.html").read_text() == page


def test_the_library_is_asked_for_them():
    path = ROOT / "problems/friction-wheel.toml"
    assert solve(path).prices is None
    assert solve(path, prices=True).prices == with_prices(solve(read_problem(path))).prices
