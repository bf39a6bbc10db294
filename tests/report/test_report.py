"""The report: every verdict renders, the same bytes again, nothing from outside, readable in a real browser."""

from __future__ import annotations

import json
import re
from functools import cache
from html import escape

import numpy as np
import pytest
from command import run
from conftest import DEVICE, FIXED, ROOT, for_passive_hands, mostly_slow
from pages import PARTS, SERVO, made, recorded

from vctune.analysis.demands import transparency_error
from vctune.api.solving import rows_of
from vctune.cli.tables import print_rows
from vctune.design.records.design import design_of, read_design
from vctune.document.reading import parse_problem
from vctune.document.text.errors import InputError
from vctune.document.text.json import sealed
from vctune.model.gains import Coupling, Gains
from vctune.report.page import LITTLE_USE, write_report
from vctune.report.style import html

LAG = 'hold = "lag"\n[stability]\ncriterion = "passive"\nband_hz = [0.0, inf]\n'
HELD = "[coupling]\ndrag = { min = 0.0, max = 50.0 }\n[operator]\ndamping = 0.5\n"
DRAG = "drag = 3.0\n"
CASES = {
    "certified": DEVICE,
    "violated": DEVICE + FIXED.format(50.0),
    "infeasible": DEVICE + "[gains]\nvelocity = { min = 2000.0, max = 3000.0 }\n",
    "one-variable-fixed": DEVICE + "[coupling]\nmass = 0.3\n",
    "weights-zero": DEVICE + "[transparency]\nweights = { admittance = 0.0, coupling = 0.0 }\n",
    "whole-axis": DEVICE + LAG,
    "undamped": DEVICE.replace("2.0", "0.0"),
    "no-loop": DEVICE + "[gains]\nvelocity = 0.0\nposition = 0.0\n[coupling]\ndamping = 1.0\nmass = 1.0\n",
    "every-part": DEVICE + PARTS + HELD,
    "every-part-fixed": DEVICE + PARTS + FIXED.format(160.0).replace("150", "60").replace("6000", "1000") + DRAG,
    "odd-name": 'name = "a b \'c\' \\"d\\" <script>alert(1)</script> Größe 大"\n' + DEVICE,
}
PRICED = ("certified", "infeasible", "every-part")
FEW = ("certified", "infeasible", "every-part-fixed", "no-loop")
"""Cases whose table and page are looked at each time."""


def html_of(record, folder):
    return made(record, folder).read_text()


@pytest.fixture(scope="module")
def records():
    """Return a case's record, made when it is first asked for."""
    return cache(lambda name: recorded(for_passive_hands(CASES[name]), prices=name in PRICED))


@pytest.fixture(scope="module")
def pages(records, tmp_path_factory):
    """Return the text of a case's page, made when it is first asked for."""
    return cache(lambda name: html_of(records(name), tmp_path_factory.mktemp("page") / "report"))


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_report_of_every_verdict(records, tmp_path, name):
    """Renders without a warning (warnings are errors here), below 250 kB, escaped, without a script."""
    record = records(name)
    html = html_of(record, tmp_path / "report")
    assert len(html.encode()) < 250_000
    problem = parse_problem(record["problem"]["text"], "x", "x")
    bare = transparency_error(problem, Gains(0.0, 0.0), Coupling(1e-18, 1e-18, 0.0)).error
    of_use = record["gains"] is not None and not record["idle"] and record["transparency"]["error"] < LITTLE_USE * bare
    kind = {"certified": "good" if of_use else "doubtful", "undecided": "doubtful"}.get(record["status"], "bad")
    assert f'<div class="verdict {kind}">' in html
    assert "<script" not in html
    assert not re.search(r'(src|href)="(?!#|data:)', html)
    drawn = {path.stem for path in (tmp_path / "report").glob("*.svg")}
    assert "llewellyn" in drawn  # also of the nearest miss, without a design
    assert {path.suffix for path in (tmp_path / "report").iterdir()} <= {".html", ".svg"}


@pytest.mark.slow
def test_no_figure_of_an_earlier_design_stays(records, tmp_path):
    (tmp_path / "report").mkdir()
    (tmp_path / "report/mine.png").write_text("not vctune's")
    made(records("certified"), tmp_path / "report")
    made(records("infeasible"), tmp_path / "report")
    assert {path.name for path in (tmp_path / "report").iterdir()} == {"report.html", "mine.png", "llewellyn.svg"}


@pytest.mark.advice
@pytest.mark.slow
def test_the_page_reviews_a_design(pages, tmp_path):
    """Ranges, the bound that is hit with its number, the parts of a latency, the digest and the command of a proof."""
    bounded = recorded(for_passive_hands(DEVICE + "[coupling]\nmass = { min = 1.5, max = 3.0 }\n"), prices=True)
    assert bounded["at_bound"] == ["coupling.mass"]
    page = html_of(bounded, tmp_path / "bounded")
    assert "! on its lower bound, 1.5" in page and "1.5 to 3" in page
    assert bounded["sha256"] in page and "<code>vctune check test.toml gains.toml</code>" in page
    assert "Best change of the device: device." in page
    servo = html_of(recorded(SERVO), tmp_path / "servo")
    assert "<h2>Latency</h2>" in servo and "<code>device.servo.bandwidth_hz</code>" in servo
    proved = pages("infeasible")
    assert "<strong>infeasible, proved</strong>" in proved and "The nearest miss: coupling against" in proved


def test_a_report_promises_nothing_outside_the_band(pages):
    html = pages("certified")
    assert "outside it nothing is claimed of the ratio" in html
    assert "no passive hand and no passive environment can make the handle unstable" in html


def test_undecided_renders_too(records, tmp_path):
    record = json.loads(json.dumps(records("certified")))
    record["status"] = record["certificate"]["verdict"] = record["certificate"]["claims"][0]["verdict"] = "undecided"
    del record["sha256"]
    html = html_of(record, tmp_path / "report")
    assert '<div class="verdict doubtful">' in html
    assert "Nothing is proved on that band." in html


def test_active_demands_have_their_prices(records):
    """d log(error)/d log(demand): compare with solving again for a demand that is eased by 0.1 %."""
    record = records("certified")
    assert [row["demand"] for row in record["active"]] == sorted(
        (row["demand"] for row in record["active"]),
        key=lambda demand: -max(r["multiplier"] for r in record["active"] if r["demand"] == demand),
    )
    eased = recorded(DEVICE + f"[stability]\ncriterion = 'passive'\nsafety_factor = {1.05 * 0.999}\n")
    price = sum(row["multiplier"] for row in record["active"] if row["demand"].startswith("Re Z_c"))
    saved = np.log(record["transparency"]["error"] / eased["transparency"]["error"]) / 1e-3
    assert price == pytest.approx(saved, rel=0.02)


def test_report_command(tmp_path):
    assert run("solve", ROOT / "problems/fixed-gains.toml", "--quiet", cwd=tmp_path, report=True).returncode == 0
    folder = tmp_path / "results/fixed-gains"
    before = (folder / "report.html").read_bytes()
    assert run("report", folder / "design.json", "--out", "again", cwd=tmp_path).returncode == 0
    assert (tmp_path / "again/report.html").read_bytes() == before


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda record: record["gains"].update(velocity="x"), "gains.velocity: "),
        (lambda record: record.update(gains=[]), "gains: "),
        (lambda record: record["coupling"].pop("mass"), "coupling.mass: "),
        (lambda record: record["certificate"].update(min_ratio=float("nan")), "NaN is no finite number"),
        (lambda record: record["certificate"].pop("band_hz"), "certificate.band_hz: "),
        (lambda record: record.update(certificate=None), "must be there, or null, together"),
        (lambda record: record["problem"].update(text="[["), "not valid TOML"),
    ],
)
def test_a_damaged_design_is_refused_with_its_keys(records, tmp_path, damage, said):
    record = json.loads(json.dumps(records("certified")))
    damage(record)
    (tmp_path / "design.json").write_text(json.dumps(record))
    with pytest.raises(InputError, match=re.escape(said)):
        write_report(read_design(tmp_path / "design.json"), tmp_path / "report")


@pytest.mark.parametrize("text", ["[" * 200_000, '{"a": "\xff"}'])
def test_what_is_no_json_is_refused(tmp_path, text):
    (tmp_path / "design.json").write_bytes(text.encode("latin1"))
    with pytest.raises(InputError, match="is not JSON"):
        read_design(tmp_path / "design.json")


@pytest.mark.parametrize("name", mostly_slow(CASES, FEW))
def test_every_design_is_read_back(records, tmp_path, name):
    for mark in ("", "\ufeff"):
        (tmp_path / "design.json").write_text(mark + json.dumps(records(name)))
        assert read_design(tmp_path / "design.json").to_json() == records(name)


def test_keys_of_other_versions_are_kept_and_none_is_added(records, tmp_path):
    record = json.loads(json.dumps(records("certified")))
    record["certificate"]["later"] = record["later"] = {"number": 1.0}
    del record["repairs"], record["idle"], record["sha256"]
    (tmp_path / "design.json").write_text(json.dumps(record))
    again = read_design(tmp_path / "design.json").to_json()
    assert list(again)[-1] == "sha256" and again == record | {"sha256": again["sha256"]}
    for table in ("gains", "coupling"):  # more numbers than are known mean nothing here
        again[table]["later"] = {"number": 1.0}
    (tmp_path / "design.json").write_text(json.dumps(sealed(again)))
    assert read_design(tmp_path / "design.json").design == design_of(records("certified"), "x").design


@pytest.mark.parametrize("name", mostly_slow(CASES, FEW))
def test_the_table_and_the_page_show_the_rows_of_the_record(records, pages, tmp_path, capsys, name):
    record, page = design_of(records(name), "x"), pages(name)
    print_rows(rows_of(record), tmp_path, [], always=True)
    table = [line.split() for line in capsys.readouterr().out.splitlines()]
    for title, rows in record.groups().items():
        for number, row in enumerate(rows):
            cells = "</th><th>".join(("<tr><th>" + (title if number == 0 else ""), set_html(row.label, record)))
            shown = f'{cells}</th><td class="number">{escape(row.value)}</td><td>{set_html(row.unit, record)}</td></tr>'
            assert shown.replace("&#x27;", "&#39;") in page
            words = f"{title if number == 0 else ''} {row.label} {row.value} {row.unit}".split()
            assert words in table


def set_html(text, record):
    """Return a text of a record as a page shows it, keys of the problem replaced by their numbers."""
    stability = parse_problem(record.problem.text, "x", "x").stability
    for key in ("safety_factor", "max_sensitivity"):
        text = re.sub(rf"(?<![.\w]){key}\b", f"{getattr(stability, key):g}", text)
    return html(text)
