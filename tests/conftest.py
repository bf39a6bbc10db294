"""Shared fixtures. Hypothesis runs the same examples every time, so that a red test is red for everyone."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("reproducible", derandomize=True, deadline=None, print_blob=False)
settings.load_profile("reproducible")

ROOT = Path(__file__).parent.parent
PROBLEM_FILES = sorted(
    path for path in (ROOT / "problems").rglob("*.toml") if path.parent != ROOT / "problems" / "studies"
)


@pytest.fixture(scope="session")
def problems() -> Path:
    return ROOT / "problems"
