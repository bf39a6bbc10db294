"""Manage the folder of a design: the problem file that owns it, and the files of an earlier design in it."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from vctune.document.reading import ProblemFile
from vctune.document.records.design_file import read_design
from vctune.document.records.design_json import DesignRecord
from vctune.document.text.errors import InputError
from vctune.document.text.output_files import folder_name as folder_name
from vctune.document.text.output_files import make_folder as make_folder
from vctune.document.text.output_files import write_together

DESIGN_FILE, GAINS_FILE = "design.json", "gains.toml"
OWNER_FILE = "problem-file.txt"  # File with the path of the problem file that owns the folder
# Files and folders that other commands write for a design, in its folder
OF_DESIGN = ("firmware", "in-the-loop", "simulation.json", "traces.npz")
# Files and folders that other commands write for a problem, in its folder, independent of its design
OF_PROBLEM = ("region.json", "region.svg", "front")


def design_folder(file: ProblemFile, out: Path) -> Path:
    """Create the folder of a problem's design in OUT and return its path."""
    folder = out / folder_name(file.problem.name)
    claim_folder(file, folder)
    return folder


def claim_folder(file: ProblemFile, folder: Path) -> None:
    """Create a folder if needed, and check that a design of this problem would not overwrite files of another
    problem."""
    make_folder(folder)
    source, owner = Path(file.source), _owner(folder)
    if source.resolve() in ((folder / name).resolve() for name in (GAINS_FILE, DESIGN_FILE)):
        message = "would be overwritten by its own design; choose another folder by --out"
        raise InputError.of(file.source, "folder-in-use", message)
    held_design = _design_in(folder)
    if held_design is not None and held_design["name"] != file.problem.name:
        message = (
            f"holds the design of {held_design['name']!r}, not of {file.problem.name!r}; choose another name or folder"
        )
        raise InputError.of(str(folder), "folder-in-use", message)
    same_problem = held_design is not None and held_design["sha256"] == file.sha256
    if owner is not None and not same_problem and not _same(owner, source):
        message = (
            f"holds what was made of {_from(Path(), owner)}, whose problem is called {file.problem.name!r} too; state "
            f"another name in {file.source}, or choose another folder by --out"
        )
        raise InputError.of(str(folder), "folder-in-use", message)
    if source.is_file() and (owner is None or not _same(owner, source)):
        write_together({folder / OWNER_FILE: f"{_from(folder, source.resolve())}\n"})


def outdated(folder: Path, record: DesignRecord) -> list[Path]:
    """Return the files and folders that become outdated if a new design replaces the design of a folder."""
    try:
        earlier = read_design(folder / DESIGN_FILE)
    except InputError:
        return []
    names: tuple[str, ...] = ()
    if earlier.problem.sha256 != record.problem.sha256:
        names = (*OF_DESIGN, *OF_PROBLEM)
    elif earlier.design != record.design:
        names = OF_DESIGN
    return [place for name in names if (place := folder / name).exists()]


def _design_in(folder: Path) -> dict[str, Any] | None:
    """Return the name and the digest of the problem whose design a folder contains; None if it contains no design."""
    try:
        problem = json.loads((folder / DESIGN_FILE).read_text())["problem"]
        return {"name": problem["name"], "sha256": problem["sha256"]}
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _owner(folder: Path) -> Path | None:
    """Return the problem file that owns a folder; None if it is not known."""
    try:
        stated = (folder / OWNER_FILE).read_text(encoding="utf-8").strip()
    except (OSError, ValueError):
        return None
    return (folder / stated).resolve() if stated else None


def _same(one: Path, other: Path) -> bool:
    return os.path.samefile(one, other) if one.exists() and other.exists() else one.resolve() == other.resolve()


def _from(folder: Path, source: Path) -> str:
    """Return the relative path from a folder to a file, with slashes."""
    try:
        return Path(os.path.relpath(source, folder.resolve())).as_posix()
    except ValueError:
        return source.as_posix()
