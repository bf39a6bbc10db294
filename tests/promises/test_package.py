"""What is shipped: the problems, as `vctune example` writes them, and all that an installed vctune needs."""

from __future__ import annotations

import os
import re
from pathlib import Path
from urllib.parse import urlparse
from urllib.request import url2pathname

import pytest
from command import run, strict
from conftest import ROOT

from vctune.document.reading import read_problem
from vctune.exit_codes import ExitCode

DEVICES = sorted(path.stem for path in (ROOT / "problems/devices").glob("*.toml"))
FILES = {path.stem: path for folder in ("problems", "problems/devices") for path in (ROOT / folder).glob("*.toml")}
PROBLEMS = [*sorted(set(FILES) - set(DEVICES)), *DEVICES]


def test_every_problem_is_an_example(tmp_path):
    listed = [line.split(maxsplit=1) for line in run("example", cwd=tmp_path).stdout.splitlines()]
    assert [name for name, _ in listed] == PROBLEMS
    assert all(purpose and not purpose.startswith("#") for _, purpose in listed)
    assert strict(run("example", "--json", cwd=tmp_path).stdout)["names"] == PROBLEMS
    for name in PROBLEMS:
        done = run("example", name, "--out", "mine", "--json", cwd=tmp_path)
        assert strict(done.stdout)["file"] == os.path.join("mine", f"{name}.toml")
        written = tmp_path / "mine" / f"{name}.toml"
        here, there = read_problem(written), read_problem(FILES[name])
        assert here.sha256 == there.sha256 and here.text.splitlines()[1:] == there.text.splitlines()[1:]
        schema = urlparse(here.text.splitlines()[0].removeprefix("#:schema "))
        named = Path(url2pathname(schema.path))  # that of the vctune installed, which need not be this tree's
        assert named.read_bytes() == (ROOT / "vctune/document/problem.schema.json").read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("name", DEVICES)
def test_a_device_that_people_own_has_a_certified_design(name, tmp_path):
    """From numbers with a source and intervals of what no source states, which the file says."""
    text = FILES[name].read_text()
    assert "http" in text or "data sheet" in text or "manual" in text
    assert "assumption" in text or "measured by a user" in text or "the manual states" in text
    done = run("solve", str(FILES[name]), "--no-report", "--json", "--out", str(tmp_path), cwd=tmp_path)
    assert done.returncode == ExitCode.OK and strict(done.stdout)["status"] == "certified"


def test_no_remedy_names_a_package_that_no_index_has():
    """Extras are those of a checkout: vctune is on no index."""
    said = [path for path in (ROOT / "vctune").rglob("*") if path.suffix in (".py", ".md")]
    assert len(said) > 100
    assert [path for path in said if re.search(r"pip install\s+\W?vctune", path.read_text())] == []
