"""Get the current day. vctune writes no other clock reading into a file."""

from __future__ import annotations

import os
from datetime import UTC, datetime


def today() -> str:
    """Return the day in UTC, such as 2026-01-31."""
    stated = os.environ.get("SOURCE_DATE_EPOCH", "")
    now = datetime.fromtimestamp(int(stated), UTC) if stated.isdigit() else datetime.now(UTC)
    return now.date().isoformat()
