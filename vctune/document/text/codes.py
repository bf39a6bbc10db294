"""List the stable codes of all refusals, warnings, remarks and omitted lines."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

# All codes
Code = Literal[
    "ambiguous-files", "bad-option", "cannot-write", "contradiction", "damaged-document", "file-exists",
    "internal-error", "interrupted", "limit-band", "limit-differ", "limit-floor", "limit-friction", "limit-handle",
    "limit-jitter", "limit-latency", "limit-residuals", "limit-stated", "limit-zero", "log-columns", "log-samples",
    "log-signal", "log-text", "log-unexplained", "missing-key", "more-mistakes", "no-design",
    "no-experiment", "no-plane", "no-workers", "not-certified", "not-fixed", "not-json", "not-toml", "not-yaml",
    "nothing-free", "nothing-proved", "other-document", "other-kind", "other-version", "out-of-range",
    "remark-actuator-lag", "remark-assumed-sensor", "remark-assumed-velocity", "remark-handle-damping",
    "remark-highest-line", "remark-jitter", "remark-latency-only", "remark-no-lag", "remark-order",
    "remark-saturated", "remark-slow-motion", "remark-stated-delay", "remark-unpushed", "remark-unused",
    "remark-weak-delay", "ros-integers", "ros-unknown-key", "ros-no-damping", "ros-other-law", "ros-parameter",
    "ros-rotation", "ros-slow-filter", "ros-step", "ros-unused-ratio", "rows-file", "rows-torn", "time-limit",
    "unknown-key", "unknown-name", "unreadable-file", "usage", "warn-band-edge", "warn-bound", "warn-environment",
    "warn-gain", "warn-idle", "warn-mass", "warn-name", "warn-residual", "warn-sample-time", "warn-stiffness",
    "warn-yields", "wrong-type",
]  # fmt: skip
ENDING = re.compile(r" \[([a-z]+(?:-[a-z]+)*)\]$")  # A code in brackets at the end of a line


def coded(text: str, code: Code) -> str:
    """Return a line with its code in brackets at the end, as an argument for `vctune explain`."""
    return f"{text} [{code}]"


def has_code(line: str | None, code: Code) -> bool:
    """Return whether a line ends with a code."""
    match = ENDING.search(line or "")
    return match is not None and match[1] == code


@dataclass(frozen=True, slots=True)
class Note:
    """A note for the reader: a warning, a part that a search omitted, or a remark on a log."""

    code: Code  # code of the note
    text: str  # text of the note
    path: tuple[str | int, ...] = ()  # key of the problem file that the note is about

    @property
    def line(self) -> str:
        """The text, with its code at the end."""
        return coded(self.text, self.code)
