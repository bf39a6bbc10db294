"""Each code of a message has a page, and `vctune explain` finds codes, keys and words."""

from __future__ import annotations

from collections import Counter
from typing import get_args

import pytest
from command import run
from conftest import ROOT

from vctune.api.explaining import CODE, explain
from vctune.document.text.codes import Code

GUIDES = [path.read_text() for path in sorted((ROOT / "vctune").rglob("README.md"))]


def test_every_code_has_one_page_and_every_page_a_code():
    assert Counter(code for text in GUIDES for code, _ in CODE.findall(text)) == Counter(get_args(Code))


@pytest.mark.parametrize(
    ("asked", "kind", "name"),
    [
        ("device.mass", "key", "device.mass"),
        ("K_p", "term", "velocity gain, position gain"),
        ("infeasible", "term", "infeasible"),
        ("[unknown-key]", "code", "unknown-key"),
    ],
)
def test_a_name_is_found_however_it_is_written(asked, kind, name):
    assert (kind, name) in {(entry.kind, entry.name) for entry in explain(asked).entries}


def test_a_name_that_there_is_not_is_told_the_nearest(tmp_path):
    done = run("explain", "devise.mass", cwd=tmp_path)
    assert done.returncode == 2 and "device.mass" in done.stderr
