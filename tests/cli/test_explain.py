"""Every refusal, warning, remark and left-out line has a code; each code has a page, whose example gives it."""

from __future__ import annotations

import ast
import html
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections import Counter
from contextlib import nullcontext
from functools import cache
from pathlib import Path
from typing import get_args

import pytest
from command import run, strict
from conftest import DEVICE, ROOT, for_passive_hands, mostly_slow
from readme import NUMBER

from vctune import interrupt, problem, solve
from vctune.api import identifying
from vctune.api.explaining import CODE, entries, explain
from vctune.design.verdict.design_record import record_of
from vctune.design.verdict.repair import CUT_SHORT
from vctune.document.records.design_file import read_design
from vctune.document.records.design_json import DesignRecord
from vctune.document.records.json_schemas import SCHEMAS
from vctune.document.records.part import Part, how_shown
from vctune.document.records.simulation_json import SimulationRecord
from vctune.document.text.codes import ENDING, Code
from vctune.document.text.errors import InputError
from vctune.exit_codes import ExitCode
from vctune.report.figures.experiment_figures import HEADINGS
from vctune.study.region import Kind

GUIDES = {str(path.relative_to(ROOT)): path.read_text() for path in sorted((ROOT / "vctune").rglob("README.md"))}
CODES = get_args(Code)
BLOCK = re.compile(r"```text\n(.*?)```", re.DOTALL)
UNSHOWN = {"limit-handle", "missing-package", "no-compiler", "internal-error", "interrupted", "warn-repairs-cut-short"}
"""Codes whose example is not to be had by a command: each has a test of its own."""


def test_every_code_has_one_page_and_every_page_a_code():
    assert Counter(code for text in GUIDES.values() for code, _ in CODE.findall(text)) == Counter(CODES)
    assert list(CODES) == sorted(CODES)


@pytest.mark.parametrize("code", CODES)
def test_a_page_says_what_why_how_it_looks_and_what_to_do(code):
    (page,) = (page for text in GUIDES.values() for found, page in CODE.findall(text) if found == code)
    what, remedy = BLOCK.split(page)[0::2]
    (example,) = BLOCK.findall(page)
    assert len(what.split()) > 5 and remedy.strip().startswith("What to do: ") and len(remedy.split()) > 3
    assert f"[{code}]" in example


EXPLAINED = [name for name, text in GUIDES.items() if CODE.search(text)]
QUICK = ["vctune/cli/README.md", "vctune/document/README.md"]


@pytest.mark.parametrize("guide", mostly_slow(EXPLAINED, QUICK))
def test_every_example_gives_its_code(guide, tmp_path):
    """The examples of a guide are run in one folder, in their order; a witness may move by a little."""
    text, said = GUIDES[guide], {}
    for block in BLOCK.findall(text[: text.index("\n### `")] + "".join(page for _, page in CODE.findall(text))):
        commands = re.findall(r"^\$ (.*)$", block, re.MULTILINE)
        for command in commands:
            said[command] = said.get(command) or printed(command, tmp_path)
        output = "".join(said[command] for command in commands).splitlines()
        for line in block.splitlines() if commands else ():
            assert line.startswith("$ ") or any(alike(line, each) for each in output), line


def alike(shown, made):
    """Whether two lines have the same words, and numbers to a hundredth."""
    if NUMBER.sub("#", shown).split() != NUMBER.sub("#", made).split():
        return False
    numbers = ([float(x) for x in NUMBER.findall(line)] for line in (shown, made))
    return next(numbers) == pytest.approx(next(numbers), rel=1e-2)


def printed(command, folder):
    """Run a command as a shell would, vctune itself in this process, and return what it prints."""
    before, mark, ours = command.rpartition("vctune ")
    if not mark or ours.endswith("rows.jsonl") or before.startswith("python3"):
        path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        env = {**os.environ, "PATH": path}
        shell = subprocess.run(
            ["bash", "-c", command], cwd=folder, capture_output=True, text=True, env=env, check=False
        )
        return shell.stdout + shell.stderr
    subprocess.run(["bash", "-c", before.rstrip("; ") or ":"], cwd=folder, check=True)
    done = run(*shlex.split(ours), cwd=folder)
    return done.stdout + done.stderr


def test_a_missing_package_says_so(tmp_path, monkeypatch):
    (tmp_path / "log.csv").write_text("time_s,position_m,command_N\n0.0,0.0,0.0\n0.001,0.0,0.0\n")
    monkeypatch.setattr(identifying, "find_spec", lambda name: None)
    done = run("identify", "log.csv", cwd=tmp_path)
    assert done.returncode == ExitCode.BAD_INPUT and done.stderr.strip() in example("missing-package")
    assert "no such file" in run("identify", "nothere.csv", cwd=tmp_path).stderr.lower()


def test_no_compiler_says_so(tmp_path, monkeypatch):
    (tmp_path / "fixed.toml").write_text((ROOT / "problems/fixed-gains.toml").read_text())
    monkeypatch.setattr(shutil, "which", lambda name: None)
    done = run("export", "fixed.toml", "--to", "fmu", "--unproved", cwd=tmp_path)
    assert done.returncode == ExitCode.BAD_INPUT and done.stderr.strip() in example("no-compiler")


def test_a_fault_of_our_own_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr("vctune.document.text.toml.read_text", lambda path: 1 / 0)
    done = run("check", "x.toml", cwd=tmp_path)
    assert done.returncode == ExitCode.INTERNAL and ENDING.search(done.stderr.strip())[1] == "internal-error"


def test_what_is_interrupted_says_so(tmp_path, monkeypatch):
    (tmp_path / "wheel.toml").write_text(for_passive_hands(DEVICE))
    earlier = tmp_path / "results/wheel/region.json"
    earlier.parent.mkdir(parents=True)
    earlier.write_text("of an earlier run")
    monkeypatch.setattr(interrupt, "interrupt_noted", lambda: nullcontext(lambda: True))
    done = run("region", "wheel.toml", "--resolution", "0.125", cwd=tmp_path)
    assert done.returncode == ExitCode.UNDECIDED and done.stderr.strip() in example("interrupted")
    assert earlier.with_name("region.previous.json").read_text() == "of an earlier run"


def test_what_is_cut_short_says_so():
    assert CUT_SHORT.line in example("warn-repairs-cut-short")


def example(code):
    assert code in UNSHOWN
    return explain(code).entries[0].text


@cache
def trees():
    return {path: ast.parse(path.read_text()) for path in sorted((ROOT / "vctune").rglob("*.py"))}


@cache
def calls():
    """Return the name, the place and the node of every call."""
    return [
        (ast.unparse(node.func).removeprefix("cls."), f"{path}:{node.lineno}", node)
        for path, tree in trees().items()
        for node in ast.walk(tree)
        if isinstance(node, ast.Call)
    ]


@pytest.mark.parametrize(
    ("maker", "place"),
    [("Mistake", 0), ("InputError.of", 1), ("Note", 0), ("Check", 0), ("Fault", 2), ("warn", 0), ("coded", 1)],
)
def test_nothing_is_refused_or_warned_of_without_a_code(maker, place):
    """Whatever makes such a line is given a code that is known, or one that it was given itself."""
    for name, where, call in calls():
        if name == maker:
            given = call.args[place]
            passed_on = ast.unparse(given) in ("code", "mistake.code", "self.code", "doubt.code", "check.code")
            assert passed_on or ast.literal_eval(given) in CODES, where


def test_every_code_is_given_somewhere():
    texts = {node.value for tree in trees().values() for node in ast.walk(tree) if isinstance(node, ast.Constant)}
    source = (ROOT / "vctune/document/text/codes.py").read_text()
    others = "".join(path.read_text() for path in trees() if path.name != "codes.py")
    for code in CODES:
        assert code in texts and f'"{code}"' in source and f'"{code}"' in others, code


def test_every_key_of_a_file_is_explained():
    from vctune.document.study_axes import number_keys

    for key in number_keys():
        name = re.sub(r"\[\d\]$|\.(?:min|max)$", "", key)
        assert any(entry.name == name.replace('"', "") for entry in explain(name).entries), key
    everything = explain("stability").entries[0].text
    assert all(f"stability.{name}" in everything for name in ("band_hz", "safety_factor", "max_sensitivity"))


@pytest.mark.parametrize(
    ("asked", "kind", "name"),
    [
        ("device.mass", "key", "device.mass"),
        ("[operator]", "key", "operator"),
        ("columns.hand", "key", "columns.hand"),
        ("Spectral radius", "term", "spectral radius"),
        ("K_p", "term", "velocity gain, position gain"),
        ("S", "term", "sensitivity"),
        ("infeasible", "term", "infeasible"),
        ("refuted", "term", "proved, refuted, undecided"),
        ("[unknown-key]", "code", "unknown-key"),
    ],
)
def test_a_name_is_found_however_it_is_written(asked, kind, name):
    found = explain(asked).entries
    assert (kind, name) in {(entry.kind, entry.name) for entry in found}


def test_words_are_those_of_the_glossary(tmp_path):
    """What is printed of a word is what stands in its row, and nothing that sets it."""
    text = GUIDES["vctune/README.md"].replace("\\|", "|")
    for entry in entries():
        assert entry.kind != "term" or entry.text.partition("\n\n")[0] in text
    said = run("explain", "terms", cwd=tmp_path).stdout
    assert "|Z_0 G_hh|, |1 - G_he|, |Z_c|/Z_0" in said and "$" not in said and "\\" not in said


def test_every_label_of_the_table_of_a_design_is_explained():
    spring = {"device": {"display": "impedance", "mass": 0.06, "damping": 0.1, "sample_time": 1e-3}}
    judged = problem({**spring, "coupling": {"damping": 0.01, "stiffness": 10.0}, "gains": {"velocity": 0.0}})
    records = [record_of(judged, solve(judged)), *map(read_design, (ROOT / "results").glob("*/design.json"))]
    labels = {row.label for record in records for rows in record.groups().values() for row in rows}
    assert {"velocity K_v", "stiffness k_c", "|1 - G_he|", "|1 - A H/N|", "gain margin", "worst error"} <= labels
    for label in labels:
        assert explain(label).entries, label


PLAIN = {
    "asked", "at, Hz", "better", "change", "date", "found", "from", "in the problem file", "instead of", "is", "limit",
    "limited by", "made with", "ms", "now", "number", "parameter", "standard deviation", "stated by", "structure", "to",
    "unit", "value", "casadi", "ipopt", "numpy", "python-flint", "vctune",
}  # fmt: skip
"""Headings that say what they are, and libraries."""


def test_every_label_of_the_pages_and_of_the_table_of_experiments_is_explained():
    """What heads a row or a column on the pages of results/ and in the templates that they are made of."""
    pages = [*(ROOT / "results").rglob("report.html"), *(ROOT / "vctune/report").glob("*.html.j2")]
    heads = {text for page in pages for text in re.findall(r"<th[^>]*>(.*?)</th>", page.read_text(), re.DOTALL)}
    plain = {
        re.sub(r"<sub>(\w+)</sub>", r"_\1", text).replace("−", "-").replace("\u202f", " ")
        for text in heads
        if "{" not in text
    }
    labels = {html.unescape(re.sub(r"<small>.*</small>|<[^>]+>", "", text)).strip() for text in plain}
    assert {"Rollett's K there", "stiffest wall felt, at rest", "active constraint", "felt"} <= labels
    for label in {*labels, *HEADINGS} - PLAIN - {""}:
        assert not label.startswith("sha256 of ") or label == "sha256 of the problem"
        assert explain(label).entries, label


NAMED = {"high", "hz", "low", "new", "old", "phase_deg", "share", "size", "value", "zero", "asked", "change"}
"""Numbers of design.json and simulation.json whose record says what they are of."""


def numbers_of(kind):
    """Return the keys of all numbers in a record and its parts."""
    schema = kind.model_json_schema()
    found = set()
    for part in (schema, *schema.get("$defs", {}).values()):
        for key, entry in part.get("properties", {}).items():
            if {form.get("type") for form in entry.get("anyOf", [entry])} & {"number"}:
                found.add(key)
    return found


@pytest.mark.parametrize("kind", [DesignRecord, SimulationRecord], ids=lambda kind: kind.__name__)
def test_every_number_of_a_document_is_explained(kind):
    keys = numbers_of(kind)
    assert len(keys) > 15
    for key in keys - NAMED:
        assert explain(key).entries, key


LISTED = {
    "a",
    "b",
    "name",
    "reason",
    "status",
    "schema",
    "description",
}
"""Keys of any document that say what they are."""


WITHIN = ("design", "simulation", "check")
"""Documents of parts of parts, whose numbers are explained (above)."""
FILES = ("problem", "gains", "study", "log")
"""What vctune reads, whose keys have entries of their own."""


@pytest.mark.parametrize("kind", [kind for kind in SCHEMAS if kind not in (*WITHIN, *FILES)])
def test_every_key_of_a_document_is_explained(kind):
    schema = SCHEMAS[kind]()
    for key in {key for part in (schema, *schema["$defs"].values()) for key in part.get("properties", {})} - LISTED:
        assert explain(key).entries, key


def parts_of(part=Part):
    return [part, *(inner for each in part.__subclasses__() for inner in parts_of(each))]


def test_every_label_of_a_record_is_explained():
    labels = {shown.label for part in parts_of() for shown in how_shown(part).values()} - {""}
    labels = {label for label in labels if "{" not in label}  # names of a display, which the tables above have
    assert {"mass felt at 1 Hz", "lower edge of the transparency band", "peak |S|"} <= labels
    for label in labels:
        assert explain(label).entries, label


def test_every_label_that_a_command_prints_is_explained(tmp_path):
    """What stands before numbers and words in what sweep, compare, region and identify print to people."""
    gains = "[gains]\nvelocity = 150.0\nposition = 6000.0\n[coupling]\ndamping = 160.0\nmass = 0.37\n"
    for name, mass in (("one", "0.4"), ("two", "0.5")):
        (tmp_path / f"{name}.toml").write_text(for_passive_hands(DEVICE.replace("0.4", mass)) + gains)
    axes = '"device.mass" = [0.4, 0.5]\n"device.sample_time" = [1e-3, 2e-3]\n'
    (tmp_path / "study.toml").write_text(f'problem = "one.toml"\n[axes]\n{axes}')
    swept = run("sweep", "study.toml", "--executor", "serial", cwd=tmp_path).stdout.splitlines()[1:]
    labels = {line.split()[0] for line in swept if not line.startswith((" ", "written"))}
    assert {"best", "over"} <= labels
    compared = run("compare", "one.toml", "two.toml", cwd=tmp_path).stdout.splitlines()
    begins = compared[0].index("A") and compared[1].index("file")
    cells = {(line[:begins].strip(), re.split("  +", line[begins:])[0]) for line in compared[1:]}
    labels |= {each for pair in cells for each in pair if "." not in each}
    assert {"differs", "status", "proved band", "delay margin", "velocity loop"} <= labels
    labels |= {kind.name.lower() for kind in Kind} | headings("identification_table")
    for label in labels - PLAIN - {""}:
        assert explain(label).entries, label


def headings(module):
    """Return what a module of the terminal writes above the columns of its tables."""
    tree = ast.parse((ROOT / f"vctune/cli/printing/{module}.py").read_text())
    loops = [
        node.iter for node in ast.walk(tree) if isinstance(node, ast.For) and ast.unparse(node.target) == "heading"
    ]
    return {heading for loop in loops for heading in ast.literal_eval(loop)}


@pytest.mark.parametrize(
    "symbol", ["b_c", "m_c", "k_c", "b_0", "K_v", "K_p", "Z_c", "Z_0", "G_hh", "R", "u", "x_e", "v_e"]
)
def test_every_symbol_of_the_tables_is_explained(symbol):
    assert explain(symbol).entries


def test_a_name_that_there_is_not_is_told_the_nearest(tmp_path):
    with pytest.raises(InputError, match=r"did you mean damping or "):
        explain("dampng")
    assert run("explain", "xyzzy", cwd=tmp_path).returncode == ExitCode.BAD_INPUT


def test_all_that_can_be_explained_is_listed(tmp_path):
    listed = strict(run("explain", "--json", cwd=tmp_path).stdout)["entries"]
    assert {entry["name"] for entry in listed if entry["kind"] == "code"} == set(CODES)
    said = run("explain", cwd=tmp_path).stdout
    assert all(name in said.replace("\n  ", " ") for name in ("unknown-key", "device.mass", "spectral radius"))
