"""The formats of `vctune check`, read as GitHub and other consumers read them."""

from __future__ import annotations

import json
import os
import re
from dataclasses import dataclass
from pathlib import Path

import command
import pytest
from conftest import DEVICE, FIXED, for_passive_hands
from hypothesis import given
from hypothesis import strategies as st

from vctune.api.checking import check_object
from vctune.cli.formats import REST, github, text
from vctune.design.check import Checked, CheckVerdict
from vctune.exit_codes import ExitCode

HOSTILE = [
    "a b.toml",
    "größe 名.toml",
    "a,b:c=d::e%0A%25.toml",
    "::error file=x::y.toml",
    "line\r\nbreak.toml",
    "\x1b[31mred\x07.toml",
    "<script>&\"'.toml",
    "[link](x) {0}.toml",
    "\udcff\ufffe.toml",
    "#?;.toml",
]


def run(*arguments, cwd):
    return command.run("check", *arguments, cwd=cwd)


def workflow_commands(text):
    """Parse workflow commands as GitHub's runner does; return (command, properties, data) of each line."""
    found = []
    for line in text.split("\n"):
        if not line.startswith("::") or "::" not in line[2:]:
            continue
        head, data = line[2:].split("::", 1)
        command, _, rest = head.partition(" ")
        properties = dict(part.strip().split("=", 1) for part in rest.split(",") if "=" in part)
        for escape, character in (("%0D", "\r"), ("%0A", "\n"), ("%3A", ":"), ("%2C", ","), ("%25", "%")):
            properties = {key: value.replace(escape, character) for key, value in properties.items()}
            data = data if escape in ("%3A", "%2C") else data.replace(escape, character)
        found.append((command, properties, data))
    return found


@given(st.sampled_from(HOSTILE), st.text().map(str.strip).filter(bool), st.text())
def test_github_survives_any_text(file, name, message):
    """Every message is one command of one line and 200 characters at most; the whole of a longer one is in the log. The
    names have no blanks around them, which the runner strips."""
    (found,) = workflow_commands(github(Checked(Path(file), name, CheckVerdict.UNDECIDED, message, 7, {}), []))
    assert found[:2] == ("warning", {"file": file, "line": "7", "title": f"vctune: {name}"})
    whole = len(message) <= 200 and "\n" not in message
    assert found[2] == message if whole else found[2].endswith(REST) and len(found[2]) <= 200


@pytest.mark.advice
def test_github_annotates_the_line_of_the_gain_to_change(folder):
    commands = workflow_commands(run(".", "--format", "github", cwd=folder).stdout)
    places = {place["file"]: (command, place["line"], data) for command, place, data in commands}
    assert set(places) == {"bad.toml", "free.toml", "poor.toml", "good.toml"}
    assert places["bad.toml"][:2] == ("error", "5")
    assert places["good.toml"][0] == "notice"
    assert places["good.toml"][2].startswith("proved, least Re Z_c / R 1.1")
    command, line, message = places["poor.toml"]
    key = re.search(r"(\w+) = \S+ instead of", message)[1]
    assert command == "error"
    assert re.match(r"\S+ = \S+ instead of \S+ would pass; ", message)
    assert (folder / "poor.toml").read_text().splitlines()[int(line) - 1].startswith(key)


@dataclass
class Found:
    """What a check found, in the fewest words."""

    warnings: list[str]

    def record(self):
        return {"warnings": self.warnings}


@pytest.mark.parametrize("verdict", [CheckVerdict.PASSED, CheckVerdict.FAILED, CheckVerdict.UNDECIDED])
@pytest.mark.parametrize("strict", [False, True])
def test_warnings_reach_every_format(verdict, strict):
    """Beside the verdict; with --strict as errors, and none of them then passes."""
    found = Checked(Path("x.toml"), "x", verdict, "said", 3, Found(["mind, the: gap", "and more"]), strict)
    assert found.result is (CheckVerdict.FAILED if strict else verdict)
    assert text(found, found.warnings).splitlines()[1:] == [
        "           warning: mind, the: gap",
        "           warning: and more",
    ]
    assert text(found, found.warnings).startswith("passed") == (found.result is CheckVerdict.PASSED)
    assert check_object(found)["warnings"] == found.warnings
    level = "error" if strict else "warning"
    first = {CheckVerdict.PASSED: "notice", CheckVerdict.FAILED: "error", CheckVerdict.UNDECIDED: "warning"}[verdict]
    commands = [(command, data) for command, _, data in workflow_commands(github(found, found.warnings))]
    assert commands == [(first, "said"), (level, "mind, the: gap"), (level, "and more")]


@pytest.mark.advice
@pytest.mark.parametrize("style", ["text", "json", "github"])
def test_a_reserve_that_is_missed_is_refused_in_every_format(tmp_path, style):
    """Gains with a ratio of 1.05 and more, absolutely stable, under a safety factor of 1.5."""
    (tmp_path / "gains.toml").write_text(FIXED.format(160.0))
    (tmp_path / "x.toml").write_text(
        for_passive_hands(DEVICE + "[stability]\ncriterion = 'passive'\nsafety_factor = 1.5\n")
    )
    done = run("x.toml", "gains.toml", "--format", style, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (ExitCode.FAILED, "")
    said = done.stdout
    if style == "json":
        (found,) = json.loads(said)
        assert (found["status"], found["certificate"]["verdict"], found["certificate"]["proved_ratio"]) == (
            "violated", "refuted", 1.0,
        )  # fmt: skip
        assert 1.05 < found["certificate"]["min_ratio"] < 1.5
        assert found["repairs"]
        said = found["reason"]
    else:
        assert "instead of" in said and "would pass" in said
    assert "absolutely stable; misses safety_factor 1.5: least Re Z_c / R 1.1" in said


ASCII = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("style", "env"),
    [(style, ASCII) for style in ("text", "json", "github")] + [("text", {"LC_ALL": "C"}), ("text", {"NO_COLOR": "1"})],
)
def test_formats_in_any_locale(tmp_path, style, env):
    name = os.fsdecode(b"gr\xc3\xb6\xc3\x9fe \xff \x1b[31m.toml")
    (tmp_path / name).write_text(DEVICE + "dampin = 1.0\n")
    (tmp_path / "poor.toml").write_text(for_passive_hands(DEVICE + FIXED.format(80.0)))
    done = command.process("check", ".", "--format", style, cwd=tmp_path, **env)
    assert (done.returncode, done.stderr) == (ExitCode.BAD_INPUT, "")
    assert style == "github" or "\x1b" not in done.stdout
    if style == "json":
        json.dumps(json.loads(done.stdout), ensure_ascii=False).encode()
