"""Shared fixtures. Hypothesis runs the same examples every time, so that a red test is red for everyone."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("reproducible", derandomize=True, deadline=None, print_blob=False)
settings.load_profile("reproducible")

ROOT = Path(__file__).parent.parent
DEVICE = "[device]\nmass = 0.4\ndamping = 2.0\nsample_time = 1e-3\n"
FIXED = "[gains]\nvelocity = 150.0\nposition = 6000.0\n[coupling]\ndamping = {}\nmass = 0.37\n"
"""A device, and gains for it that are certified with a coupling damping of 160 and violated with 80."""
PROBLEM_FILES = sorted(
    path for path in (ROOT / "problems").rglob("*.toml") if path.parent != ROOT / "problems" / "studies"
)


def for_passive_hands(text: str) -> str:
    """Return a problem file's text with the criterion "passive" in the place of the default."""
    table, asked = "[stability]\n", "[stability]\ncriterion = 'passive'\n"
    if "criterion" in text:
        return text
    return text.replace(table, asked) if table in text else text + asked


@pytest.fixture(scope="session")
def problems() -> Path:
    return ROOT / "problems"


@pytest.fixture
def folder(tmp_path):
    """One good, one violated, one unreadable and one free problem."""
    (tmp_path / "good.toml").write_text(for_passive_hands(DEVICE + FIXED.format(160.0)))
    (tmp_path / "poor.toml").write_text(for_passive_hands(DEVICE + FIXED.format(80.0)))
    (tmp_path / "bad.toml").write_text(DEVICE + "dampin = 1.0\n")
    (tmp_path / "free.toml").write_text(for_passive_hands(DEVICE))
    return tmp_path
