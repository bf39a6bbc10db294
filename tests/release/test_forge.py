"""What a forge reads: workflows, forms, the action, and the version that changelog and citation name."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest
import yaml
from conftest import ROOT

from vctune.version import __version__

FORGE = ROOT / ".github"
WORKFLOWS = sorted((FORGE / "workflows").glob("*.yml"))
FORMS = sorted(path for path in (FORGE / "ISSUE_TEMPLATE").glob("*.yml") if path.stem != "config")
SCHEMAS = {
    "github-workflows": WORKFLOWS,
    "github-issue-forms": FORMS,
    "github-issue-config": [FORGE / "ISSUE_TEMPLATE/config.yml"],
    "github-actions": [FORGE / "actions/check/action.yml"],
    "citation-file-format": [ROOT / "CITATION.cff"],
}


def read(path):
    return yaml.safe_load(path.read_text("utf-8"))


def test_the_changelog_and_the_citation_know_the_version():
    newest = re.search(r"^## (\d+\.\d+\.\d+)", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE)
    assert newest[1] == __version__ == read(ROOT / "CITATION.cff")["version"]


def test_no_guide_tells_to_fetch_a_tag_that_is_not_there():
    tags = subprocess.run(["git", "tag"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()
    for guide in (*ROOT.glob("*.md"), *(ROOT / "vctune").rglob("*.md"), *(ROOT / "docs").rglob("*.md")):
        named = re.findall(r"(?:rev: |@)(v\d+\.\d+\.\d+)", guide.read_text("utf-8"))
        assert set(named) <= set(tags), guide


def test_a_wrong_verdict_is_reported_with_problem_and_gains():
    (form,) = (read(path) for path in FORMS if path.stem == "wrong-verdict")
    required = {each["id"] for each in form["body"] if each["validations"]["required"]}
    assert {"problem", "gains", "command", "version"} <= required


def test_tests_run_on_three_systems_with_every_python():
    jobs = read(FORGE / "workflows/tests.yml")["jobs"]
    pythons = ["3.11", "3.12", "3.13"]
    assert jobs["linux"]["strategy"]["matrix"]["python"] == jobs["elsewhere"]["strategy"]["matrix"]["python"] == pythons
    assert jobs["elsewhere"]["strategy"]["matrix"]["os"] == ["macos-latest", "windows-latest"]


def test_every_test_is_run_each_night():
    folders = sorted({path.parent.name for path in (ROOT / "tests").glob("*/test_*.py")})
    parts = read(FORGE / "workflows/nightly.yml")["jobs"]["slow"]["strategy"]["matrix"]["part"]
    assert parts == ["test_*.py", *folders]


def test_workflows_name_folders_that_are_there():
    for path in WORKFLOWS:
        for name in re.findall(r"\b(?:tests|docs)/[\w/.]+", path.read_text("utf-8")):
            assert (ROOT / name).exists(), f"{path.name}: {name}"


@pytest.mark.slow
@pytest.mark.parametrize("schema", SCHEMAS)
def test_files_are_as_the_schemas_say(schema):
    command = [sys.executable, "-m", "check_jsonschema", "--builtin-schema", f"vendor.{schema}", *SCHEMAS[schema]]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
