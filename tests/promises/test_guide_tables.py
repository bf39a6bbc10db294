"""The tables of the guides say what the schemas, the claims and the records say."""

from __future__ import annotations

from difflib import unified_diff

import pytest
from conftest import ROOT
from guide_tables import TABLES, with_table


@pytest.mark.parametrize("name", TABLES)
def test_guide_has_the_table_of_today(name):
    guide = TABLES[name][0]
    text = (ROOT / guide).read_text(encoding="utf-8")
    here, made = text.splitlines(), with_table(text, name).splitlines()
    changed = "\n".join(unified_diff(here, made, guide, "made from the code", n=0, lineterm=""))
    assert not changed, f"`python tests/promises/guide_tables.py` writes the tables anew:\n{changed}"


def test_every_table_between_comments_is_made():
    """A table between two comments has a function that makes it, so that none is kept by hand."""
    texts = {str(page.relative_to(ROOT)): page.read_text(encoding="utf-8") for page in (ROOT / "vctune").rglob("*.md")}
    found = {(line, guide) for guide, text in texts.items() for line in text.splitlines() if line.startswith("<!-- /")}
    assert found == {(f"<!-- /{name} -->", guide) for name, (guide, _) in TABLES.items()}
