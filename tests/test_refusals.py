"""What is refused: each mistake has a line with its place, its key, words of the remedy and its code.

An entry of `refusals/*.toml` is a file: a base of bases.toml with edits (old, new, old, new) and with lines added, or a
text. Beside it lie `more` files, each a base or a text. What an entry does not state is under `usual`. `told` has the
line of each mistake in their order; "..." is any words. An empty folder that a command `leaves` is named.
"""

from __future__ import annotations

import os
import re
import shlex
import tomllib
from math import sin
from pathlib import Path

import jsonschema
import pytest
from command import run

import vctune
from vctune.document.schema.problem_schema import json_schema
from vctune.exit_codes import ExitCode

FOLDER = Path(__file__).parent / "refusals"
ROWS = (f"{k / 1000:.3f},{sin(k / 40) / 100:.6f},{sin(k / 9):.4f}\n" for k in range(1000))
LOG = "time_s,position_m,command_N\n" + "".join(ROWS)
BASES = {"log": LOG, "servo log": LOG.replace("command_N", "velocity_command_m_s")}
BASES |= tomllib.loads((FOLDER / "bases.toml").read_text())
OTHER = re.compile(r"Usage: .*|Try .* for help\.||\d+ bad input")
"""Lines beside the mistakes: the usage of a command, and how many files of a check are bad."""


def entries(group):
    """Return the entries of a file by their names."""
    tables = tomllib.loads((FOLDER / f"{group}.toml").read_text())
    usual = tables.pop("usual")
    return {f"{group}: {name}": usual | entry for name, entry in tables.items()}


GROUPS = ("problems", "gains", "ros", "studies", "commands", "logs", "maps")
ENTRIES = dict(each for group in GROUPS for each in entries(group).items())
PROBLEMS = entries("problems")


def text_of(entry):
    text = entry["text"] if "text" in entry else BASES[entry["base"]]
    edits = entry.get("edit", [])
    for old, new in zip(edits[::2], edits[1::2], strict=True):
        assert old in text
        text = text.replace(old, new)
    return f"{text}{entry.get('add', '')}\n"


def write(entry, folder):
    more = {path: BASES.get(text, text) for path, text in entry.get("more", {}).items()}
    for path, text in (more | {entry["file"]: text_of(entry)}).items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text)


def unlike(lines, entry):
    """Return the lines and what they should be where they are not."""
    told = entry["told"].splitlines()
    forms = [".*".join(map(re.escape, re.split(r" ?\.\.\. ?", line))) for line in told]
    alike = len(lines) == len(forms) and all(map(re.fullmatch, forms, lines))
    return [] if alike else [lines, told]


def left(folder):
    return {path: path.is_file() and path.read_bytes() for path in folder.rglob("*")}


@pytest.mark.parametrize("name", ENTRIES)
def test_every_mistake_is_told_in_its_line_and_nothing_is_written(name, tmp_path):
    entry = ENTRIES[name]
    write(entry, tmp_path)
    before = left(tmp_path)
    words = shlex.split(entry["command"])
    done = run(*words, cwd=tmp_path)
    checks = words[0] == "check" and "[usage]" not in entry["told"]
    told, silent = (done.stdout, done.stderr) if checks else (done.stderr, done.stdout)
    assert (done.returncode, silent) == (ExitCode.BAD_INPUT, "")
    lines = [re.sub("^(bad input  |Error: )", "", line) for line in told.splitlines() if not OTHER.fullmatch(line)]
    assert unlike(lines, entry) == []
    if "leaves" in entry:
        os.removedirs(tmp_path / entry["leaves"])
    assert left(tmp_path) == before


@pytest.mark.parametrize("name", PROBLEMS)
def test_a_program_gets_the_same_mistakes(name, tmp_path, monkeypatch):
    entry = PROBLEMS[name]
    write(entry, tmp_path)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(vctune.InputError) as refused:
        vctune.problem(entry["file"])
    lines = str(refused.value).splitlines()
    assert unlike(lines, entry) == []
    mistakes = refused.value.mistakes
    for line, mistake in zip(lines, mistakes, strict=True):
        place = entry["file"] if mistake.line is None else f"{entry['file']}:{mistake.line}"
        assert line.startswith(f"{place}: {mistake.key}") and line.endswith(f" [{mistake.code}]")
    if {mistake.code for mistake in mistakes} & {"not-toml", "other-kind"}:
        return
    with pytest.raises(vctune.InputError) as refused:
        vctune.problem(tomllib.loads(text_of(entry)))
    stated = sorted((mistake.key, mistake.code) for mistake in refused.value.mistakes)
    assert stated == sorted((mistake.key, mistake.code) for mistake in mistakes)


@pytest.mark.parametrize(
    "name", ["misspelt key", "negative mass", "string for number", "range without max", "unknown hold", "empty"]
)
def test_the_schema_of_problem_files_does_not_allow_it(name):
    validator = jsonschema.Draft202012Validator(json_schema())
    assert not validator.is_valid(tomllib.loads(text_of(PROBLEMS[f"problems: {name}"])))
