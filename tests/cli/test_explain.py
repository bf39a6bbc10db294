"""Each code of a message has a page, and `vctune explain` finds codes, keys and words."""

from __future__ import annotations

import re
from collections import Counter
from typing import get_args

import pytest

from vctune.api.explaining import entries, explain
from vctune.document.text.errors import Code


def test_every_code_has_one_row_and_every_row_a_code():
    explained = [entry for entry in entries() if entry.kind == "code"]
    assert Counter(entry.name for entry in explained) == Counter(get_args(Code))
    for entry in explained:
        (shown,) = (each for each in explain(entry.name).entries if each.kind == "code")
        assert re.fullmatch(r".+\.\n\nWhat to do: .+\.", shown.text), shown


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


# Words that newcomers typed in vain, in three rounds
TYPED = (
    "gripper", "payload", "table", "pose", "ros2", "gear", "capstan", "negative damping", "second mode", "latency",
    "time-varying hand", "energy tank", "virtual spring", "detent", "compensator", "ringing", "damping ratio", "buzz",
    "voltage", "back-EMF", "feed-forward", "teleoperation", "limit cycle", "quantisation", "friction compensation",
    "angle", "hand guiding", "wrist", "teach", "stiff contact", "sampling rate", "tremor", "Colgate", "t_d", "law",
    "gravity_compensation", "jitter", "MoveIt Pro", "two handles", "1 N from rest", "rings for", "feels like",
)  # fmt: skip


@pytest.mark.parametrize("word", TYPED)
def test_words_of_newcomers_are_known(word):
    assert all(entry.text for entry in explain(word).entries)


@pytest.mark.parametrize(
    "word",
    ["limp", "holds no static force", "unstable at", "unstable at any multiple", "of little use", "certified",
     "violated", "undecided", "infeasible", "MuJoCo", "isaac", "kp", "kd", "PD", "joint", "armature", "exoskeleton",
     "dead band", "massless", "notch", "rings for", "peak |S|", "phase margin", "buzzes", "warn-limp", "warn-margin"],
)  # fmt: skip
def test_words_of_headlines_rows_and_the_field_are_known(word):
    assert explain(word).entries


def test_no_text_is_empty():
    assert not [entry.name for entry in entries() if not entry.text.strip()]
