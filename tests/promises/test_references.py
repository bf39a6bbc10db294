"""What a page, a docstring or a comment refers to is there: files, and sections by their numbers."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest
from conftest import ROOT
from readme import PAGES

SECTION = re.compile(r"([\w/]*/README\.md), sections? (\d+)(?:(?: to |, | and )(\d+))*")
"""How code refers to a page: model/README.md, section 4."""
ELSEWHERE = re.compile(r"\b(?:DESIGN|REVIEW|STYLE|THEORY)(?:\.md|'s)? (?:section )?\d")
"""Numbered sections of a document that is not here."""
LINK = re.compile(r"\]\(([^)\s]+)\)|src=\"([^\"]+)\"")


def tracked(*suffixes: str) -> list[Path]:
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return [ROOT / name for name in listed.splitlines() if name.endswith(suffixes) and (ROOT / name).exists()]


def anchors(page: Path) -> set[str]:
    """Return the anchors that a forge makes of a page's headings."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    for link in (found[1] or found[2] for found in LINK.finditer(page.read_text())):
        if "://" in link:
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), link
        if anchor:
            assert anchor in anchors(target if target.suffix == ".md" else target / "README.md"), link


def test_code_refers_to_sections_that_exist():
    for path in tracked(".py", ".m", ".toml", ".j2"):
        for found in SECTION.finditer(re.sub(r"\n\s*(?:#|%)?\s*", " ", path.read_text())):
            page = ROOT / "vctune" / found[1]
            assert page.exists(), f"{path}: {found[0]}"
            for number in re.findall(r"\d+", found[0].partition("README.md")[2]):
                assert re.search(rf"^## {number} ", page.read_text(), re.MULTILINE), f"{path}: {found[0]}"


def test_nothing_refers_to_a_document_that_is_not_here():
    for path in tracked(".py", ".m", ".toml", ".j2", ".md"):
        if path != Path(__file__):
            found = ELSEWHERE.search(path.read_text())
            assert found is None, f"{path}: {found[0]}"


def test_names_in_the_glossary_are_in_the_code():
    code = "\n".join(path.read_text() for path in (ROOT / "vctune").rglob("*.py"))
    glossary = (ROOT / "vctune/README.md").read_text().partition("## Glossary")[2]
    for row in re.findall(r"^\|.*\|$", glossary, re.MULTILINE):
        for name in re.findall(r"`([^`]+)`", row.rsplit("|", 2)[1]):
            if name.endswith(".py"):
                found = list((ROOT / "vctune").rglob(f"*{Path(name).name}"))
                assert any(str(path).endswith(f"/{name}") for path in found), name
            else:
                last = name.strip("[]=").rsplit(".", 1)[-1]
                assert re.search(rf"\b{last}\b", code), name
