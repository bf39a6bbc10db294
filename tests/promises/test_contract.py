"""One contract of output for every command: the same options, and JSON that the published schemas describe."""

from __future__ import annotations

import io
import json
import re
import signal
import sys
from types import SimpleNamespace

import click
import pytest
from command import run, started, strict, wait_until
from conftest import DEVICE, FIXED, PROBLEM_FILES, ROOT, for_passive_hands
from jsonschema import Draft202012Validator

from vctune.api.json_schemas import SCHEMAS
from vctune.cli.commands.schema import KINDS
from vctune.cli.main import COMMANDS, main
from vctune.document.schema.number_units import QUANTITIES, unit_of
from vctune.document.text import toml
from vctune.exit_codes import ExitCode
from vctune.model.numbers.units import LINEAR, ROTARY

GOOD, POOR = (for_passive_hands(DEVICE + FIXED.format(damping)) for damping in (160.0, 80.0))
EXPERIMENT = '[[experiment]]\nname = "spring"\nenvironment = { stiffness = 200.0 }\noperator = { cycles = 1 }\n'
STUDY = 'problem = "good.toml"\n[axes]\n"device.damping" = [2.0, 3.0]\n"gains.velocity" = [150.0]\n'
VALID = {kind: Draft202012Validator(make()) for kind, make in SCHEMAS.items()}
SILENT = {"schema"}
"""Commands whose only output is a document."""


@pytest.fixture
def folder(tmp_path):
    free = for_passive_hands(DEVICE + "[gains]\nposition = 3000.0\n[coupling]\nmass = 0.37\ndrag = 0.0\n")
    texts = {"good": GOOD + EXPERIMENT, "poor": POOR, "bad": "[device]\n", "free": free, "study": STUDY}
    for name, text in texts.items():
        (tmp_path / f"{name}.toml").write_text(text)
    return tmp_path


def commands():
    for name in COMMANDS:
        command = main.get_command(click.Context(main), name)
        if name not in SILENT:
            yield name, command


@pytest.mark.parametrize("command", [pytest.param(command, id=name) for name, command in commands()])
def test_every_command_has_the_same_options(command):
    options = {option: parameter for parameter in command.params for option in parameter.opts}
    assert {"--format", "--json", "--quiet"} <= set(options)
    assert options["--format"].type.choices[:2] == ("text", "json")


def test_every_help_fits_a_screen_and_options_are_few(monkeypatch, tmp_path):
    """Those that every command has, counted once."""
    monkeypatch.setenv("COLUMNS", "80")
    for name in (*COMMANDS, ""):
        assert len(run(*name.split(), "--help", cwd=tmp_path).stdout.splitlines()) <= 32, name
    every = {"style", "as_json", "quiet"}
    found = [each.name for _, command in commands() for each in command.params if isinstance(each, click.Option)]
    assert len([name for name in found if name not in every]) + len(every) <= 48


def test_json_is_short_for_its_format(folder):
    short, long = (run("check", "good.toml", *how, cwd=folder).stdout for how in (["--json"], ["--format", "json"]))
    assert strict(short) == strict(long)
    assert run("check", "good.toml", "--format", "json", "--json", cwd=folder).stdout == long


MACHINES = {
    "design": ("solve good.toml", ExitCode.OK),
    "check": ("check good.toml poor.toml bad.toml", ExitCode.BAD_INPUT),
    "simulation": ("simulate good.toml", ExitCode.OK),
    "sweep": ("sweep study.toml --executor serial", ExitCode.OK),
    "region": ("region free.toml --y coupling.damping --resolution 0.125", ExitCode.OK),
    "export": ("export good.toml", ExitCode.OK),
}
"""A command for each kind of document, and its exit code."""


@pytest.mark.parametrize("kind", MACHINES)
def test_documents_are_as_their_schemas_say(folder, kind):
    words, code = MACHINES[kind]
    done = run(*words.split(), "--json", "--quiet", cwd=folder)
    assert done.returncode == code and done.stderr == ""
    document = strict(done.stdout)
    if kind not in VALID:
        first = document[0] if isinstance(document, list) else document
        assert re.fullmatch(rf"vctune/{'design' if kind == 'check' else kind}/\d", first["schema"])
        return
    assert list(VALID[kind].iter_errors(document)) == []
    for broken in damaged(document):
        assert not VALID[kind].is_valid(broken)


@pytest.mark.parametrize("kind", ["design", "check", "sweep", "export"])
def test_quiet_says_only_what_cannot_be_used(folder, kind):
    words, code = MACHINES[kind]
    quiet = run(*words.split(), "--quiet", cwd=folder)
    refused = ["bad.toml"] * (kind == "check")
    assert (quiet.returncode, quiet.stdout) == (code, "")
    assert [line.split()[2].partition(":")[0] for line in quiet.stderr.splitlines() if "bad input" in line] == refused
    assert bool(quiet.stderr) == bool(refused)


def damaged(document):
    """Yield a document with another name, without its first part, and with a text for a number."""
    if isinstance(document, list):
        yield from ([*document[1:], broken] for broken in damaged(document[0]))
        return
    yield document | {"schema": "vctune/none/1"}
    first = list(document)[1]
    yield {key: value for key, value in document.items() if key != first}


def test_files_are_as_their_schemas_say(folder):
    run("sweep", "study.toml", "--executor", "serial", cwd=folder)
    lines = [strict(line) for line in (folder / "results/study/rows.jsonl").read_text().splitlines()]
    assert len(lines) == 3 and all(VALID["rows"].is_valid(line) for line in lines)
    assert not VALID["rows"].is_valid(lines[1] | {"error": "none"})
    run("region", "free.toml", "--y", "coupling.damping", "--resolution", "0.125", cwd=folder)
    baseline = folder / "results/free/region.json"
    assert VALID["region"].is_valid(strict(baseline.read_text()))
    (folder / "free.toml").write_text((folder / "free.toml").read_text().replace("mass = 0.4", "mass = 0.8"))
    done = run("check", "free.toml", "--region", baseline, "--json", cwd=folder)
    assert done.returncode == ExitCode.FAILED and strict(done.stdout)[0]["status"] == "lost"
    run("solve", "good.toml", cwd=folder)
    gains = toml.parse((folder / "results/good/gains.toml").read_text(), "gains")
    assert VALID["gains"].is_valid(gains) and not VALID["gains"].is_valid(gains | {"device": {}})
    assert VALID["design"].is_valid(strict((folder / "results/good/design.json").read_text()))
    done = run("report", "results/good/design.json", "--json", cwd=folder)
    assert (folder / strict(done.stdout)["report"]).exists()


GAINS_FILES = sorted((ROOT / "tests/gains").glob("*.toml"))


@pytest.mark.parametrize("path", GAINS_FILES, ids=lambda path: path.parent.name)
def test_gains_files_of_every_display_are_as_their_schema_says(path):
    gains = toml.parse(path.read_text(), path.name)
    assert VALID["gains"].is_valid(gains)
    assert not VALID["gains"].is_valid(gains | {"coupling": {"damping": 1.0}})


@pytest.mark.parametrize("path", PROBLEM_FILES, ids=lambda path: path.stem)
def test_problem_files_are_as_their_schema_says(path):
    document = toml.parse(path.read_text(), path.name)
    assert list(VALID["problem"].iter_errors(document)) == []
    assert not VALID["problem"].is_valid(document | {"dampin": 1.0})


def test_studies_are_as_their_schema_says():
    for path in (ROOT / "problems/studies").glob("*.toml"):
        assert VALID["study"].is_valid(toml.parse(path.read_text(), path.name))
    assert not VALID["study"].is_valid({"problem": "x.toml"})


def test_every_schema_is_printed(tmp_path):
    assert tuple(SCHEMAS) == KINDS
    for kind in KINDS:
        schema = strict(run("schema", kind, cwd=tmp_path).stdout)
        Draft202012Validator.check_schema(schema)
        assert schema == SCHEMAS[kind]()


def test_units_are_those_of_the_key_reference():
    """Of every number that a file may have, the unit is the one that its description has, of a rotary device too."""
    shown, every = set(), {LINEAR.of(quantity) for quantity in QUANTITIES}
    known = "|".join(map(re.escape, sorted(every, key=len, reverse=True)))
    said = re.compile(rf"(?:^|, )({known})(?=[.,;])")
    known = "|".join(re.escape(ROTARY.of(quantity)) for quantity in QUANTITIES)
    turned = re.compile(rf"(?:^|, )({known})(?=[.,;])")
    for path, description in described(SCHEMAS["problem"](), SCHEMAS["problem"](), ()):
        unit = unit_of(path, LINEAR)
        assert re.findall(said, description.partition(" Default")[0]) == ([unit] if unit else []), (path, description)
        of_rotary = [unit_of(path, ROTARY)] if unit else []
        assert re.findall(turned, ROTARY.translated(description).partition(" Default")[0]) == of_rotary, path
        shown |= {unit} if unit else set()
    assert shown == every


def described(schema, table, path):
    for name, entry in table["properties"].items():
        form = entry.get("items", entry)
        union = [form] if "description" in entry else form.get("oneOf", [form])
        forms = [schema["$defs"][one["$ref"].rpartition("/")[2]] for one in union if "$ref" in one]
        if forms and "properties" in forms[0]:
            for inner in forms:
                yield from described(schema, inner, (*path, name))
        elif entry.get("type") not in ("string", "boolean", "integer"):
            yield (*path, name), entry["description"]


def test_standard_input(folder, monkeypatch):
    text = (folder / "good.toml").read_text()
    for words in ("solve -", "check -", "simulate -"):
        monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=io.BytesIO(text.encode())))
        done = run(*words.split(), "--json", cwd=folder)
        assert done.returncode == ExitCode.OK, done.stderr
        found = strict(done.stdout)
        assert (found[0] if isinstance(found, list) else found)["problem"]["name"] == "stdin"
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=io.BytesIO(b"[device]\nmass = -1.0\n")))
    done = run("solve", "-", cwd=folder)
    assert done.returncode == ExitCode.BAD_INPUT and "stdin:2: device.mass: -1.0 is too small" in done.stderr
    for words in ("check -", "solve - -", "export -"):
        monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=io.BytesIO(text.encode())))
        done = run(*words.split(), "--json", cwd=folder)
        assert done.returncode == (ExitCode.BAD_INPUT if "- -" in words else ExitCode.OK), done.stderr
        assert ("stdin: is closed, or has been read already" in done.stderr) == ("- -" in words)
    monkeypatch.setattr(sys, "stdin", None)
    assert "stdin: is closed" in run("check", "-", cwd=folder).stdout
    assert "--watch needs exactly one file" in run("solve", "-", "--watch", cwd=folder).stderr


def test_watch_solves_again_when_the_file_is_saved(folder):
    running = started("solve", "good.toml", "--watch", "--no-report", "--quiet", cwd=folder)
    design = folder / "results/good/design.json"

    def mass():
        try:
            return toml.parse(json.loads(design.read_text())["problem"]["text"], "x")["device"]["mass"]
        except (OSError, ValueError):
            return None

    wait_until(lambda: mass() == 0.4)
    (folder / "good.toml").write_text("[device]\n")
    while "is missing" not in (said := running.stderr.readline()):
        assert said
    (folder / "good.toml").write_text(GOOD.replace("mass = 0.4", "mass = 0.45"))
    wait_until(lambda: mass() == 0.45)
    running.send_signal(signal.SIGINT)
    out, err = running.communicate(timeout=60)
    assert (running.returncode, out) == (ExitCode.INTERRUPTED, "") and err.endswith("interrupted\n")


@pytest.mark.parametrize(
    ("words", "begun", "whole"),
    [
        ("", "expl", "explain"),
        ("schema", "simul", "simulation"),
        ("example", "friction-wheel-h", "friction-wheel-hands"),
        ("explain", "unknown-k", "unknown-key"),
        ("explain", "device.ma", "device.mass"),
        ("check --format", "gi", "github"),
    ],
)
def test_the_shell_completes(words, begun, whole):
    from click.shell_completion import ShellComplete

    found = ShellComplete(main, {}, "vctune", "_VCTUNE_COMPLETE").get_completions(words.split(), begun)
    assert whole in [item.value for item in found] and all(item.value.startswith(begun) for item in found)
