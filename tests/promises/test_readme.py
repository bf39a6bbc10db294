"""Every README tells the truth: what it shows is what its commands print today, and its links lead somewhere."""

from __future__ import annotations

import io
import re
from contextlib import chdir, redirect_stdout

import pytest
from conftest import ROOT, mostly_slow
from readme import CONSOLE, NUMBER, PAGES, TABLES, with_sessions, with_tables

TEXTS = {str(page.relative_to(ROOT)): page.read_text() for page in PAGES}
LONGEST = 200
"""Lines of the first page."""


SESSIONS = [page for page, text in TEXTS.items() if CONSOLE.search(text)]

MOST_MODULES = 17
"""In a folder: more cannot be held in one's head."""


@pytest.mark.parametrize("page", mostly_slow(SESSIONS, ["README.md"]))
def test_console_sessions(page):
    """Words equal, numbers to 0.1 %; counts of boxes, which depend on the last digits, to a tenth."""
    shown, made = TEXTS[page].splitlines(), with_sessions(TEXTS[page]).splitlines()
    assert len(made) == len(shown)
    for here, there in zip(shown, made, strict=True):
        assert NUMBER.sub("#", here).split() == NUMBER.sub("#", there).split()
        assert [float(x) for x in NUMBER.findall(here)] == pytest.approx(
            [float(x) for x in NUMBER.findall(there)], rel=0.1 if "boxes" in here else 1e-3
        )


@pytest.mark.parametrize("page", [page for page, text in TEXTS.items() if "<!-- /" in text])
def test_generated_tables(page):
    assert with_tables(TEXTS[page]) == TEXTS[page]


def test_every_table_is_shown_once():
    for name in TABLES:
        assert sum(text.count(f"<!-- {name} -->") for text in TEXTS.values()) == 1


def test_library_example():
    example = re.search(r"```python\n(.*?)```", TEXTS["README.md"], re.DOTALL)[1]
    with chdir(ROOT), redirect_stdout(io.StringIO()) as said:
        exec(example, {})
    assert said.getvalue().startswith("certified Gains(velocity=")


def test_first_page_is_short():
    assert len(TEXTS["README.md"].splitlines()) <= LONGEST


def test_every_folder_has_a_page():
    """A package has a guide; its rooms are in it, and every guide names every module (`test_generated_tables`)."""
    for folder in [ROOT, *(ROOT / "vctune").glob("*/"), ROOT / "problems", ROOT / "results", ROOT / "tests"]:
        if (folder / "__init__.py").exists() or folder.parent != ROOT / "vctune":
            assert (folder / "README.md").exists(), folder


MOST_FILES = 6
"""That a recipe touches."""


def test_recipes_touch_few_files_that_are_there():
    guide = (ROOT / ".github/CONTRIBUTING.md").read_text()
    recipes = re.findall(r"^### (.*?)\n(.*?)(?=^### |\Z)", guide, re.MULTILINE | re.DOTALL)
    for name, text in recipes:
        files = re.findall(r"^\| (.*?) \|", text, re.MULTILINE)[2:]
        assert len(files) <= MOST_FILES, name
        for path in re.findall(r"`([\w/.]+)`", " ".join(files)):
            assert (ROOT / path).exists(), path


def test_rooms_can_be_held_in_ones_head():
    for folder in {path.parent for path in (ROOT / "vctune").rglob("*.py")}:
        assert len(list(folder.glob("[!_]*.py"))) <= MOST_MODULES, folder
