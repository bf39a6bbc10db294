"""Pages of designs in a real browser, where there is one."""

from __future__ import annotations

import shutil
from contextlib import contextmanager

import pytest

from vctune.design.advice.prices import with_prices
from vctune.design.records.design import design_of, design_record
from vctune.design.solve import solve
from vctune.document.reading import ProblemFile, parse_problem
from vctune.report.page import write_report

CHROMIUM = shutil.which("chromium")
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="needs chromium")
SERVO = """[device]
sample_time = 2e-3
servo = { delay = 0.03, bandwidth_hz = 20.0, order = 2 }
[operator]
stiffness = { min = 0.0, max = 1000.0 }
[coupling]
damping = 300.0
mass = 2.5
drag = 50.0
"""
PARTS = """delay = 2e-4
actuator = { bandwidth_hz = 700.0 }
velocity = { from = "difference", filter_hz = 300.0 }
force_sensor = { bandwidth_hz = 400.0, delay = 3e-4 }
structure = { handle_mass = 0.05, frequency_hz = 250.0, damping_ratio = 0.03 }
"""
"""For the table [device]."""


def recorded(text, *, prices=False):
    """Return the object of design.json of a problem."""
    problem = parse_problem(text, "test.toml", "test")
    solved = solve(problem)
    return design_record(ProblemFile(problem, text), with_prices(solved) if prices else solved)


def made(record, folder):
    """Write a report and return its path."""
    folder.mkdir(exist_ok=True)
    write_report(design_of(record, "x"), folder)
    return folder / "report.html"


@contextmanager
def chromium():
    """Start chromium, which asks for nothing of its own."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        options = ["--no-sandbox", "--disable-background-networking"]
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=options)
        yield browser
        browser.close()


def opened(browser, path, **options):
    """Return a page of 1000 by 800, or of other options, with what it `said` and `asked` for."""
    page = browser.new_page(**{"viewport": {"width": 1000, "height": 800}} | options)
    page.said, page.asked = [], []
    page.on("console", lambda message: page.said.append(message.text))
    page.on("pageerror", lambda error: page.said.append(str(error)))
    page.on("request", lambda request: page.asked.append(request.url))
    page.goto(path.as_uri())
    return page
