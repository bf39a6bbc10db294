"""Name the folder of a design and the files in it."""

from __future__ import annotations

from pathlib import Path

from vctune.document.reading import ProblemFile
from vctune.document.text.output_files import folder_name as folder_name
from vctune.document.text.output_files import make_folder as make_folder

DESIGN_FILE, GAINS_FILE = "design.json", "gains.toml"


def design_folder(file: ProblemFile, out: Path) -> Path:
    """Create the folder of a problem's design in OUT and return its path."""
    folder = out / folder_name(file.problem.name)
    make_folder(folder)
    return folder
