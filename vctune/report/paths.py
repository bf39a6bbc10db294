"""The files of reports. This module imports no heavy package."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

FigureKind = Literal["svg", "pdf", "png"]  # kinds of files of a picture that stands alone
REPORT = "report.html"
# Every figure that the report of a design, or of an identification, can have
DESIGN_FIGURES = ("hands", "any-hand", "llewellyn", "impedance", "transparency", "nyquist", "simulation")
IDENTIFICATION_FIGURES = ("identified",)


def report_paths(folder: Path, figures: tuple[str, ...] = DESIGN_FIGURES) -> list[Path]:
    """Return the paths of a folder's report and of every figure that it can have."""
    return [folder / REPORT, *(folder / f"{name}.svg" for name in figures)]
