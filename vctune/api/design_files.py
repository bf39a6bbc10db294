"""Write the files of a design: gains.toml, design.json and the report."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vctune.api.folders import DESIGN_FILE, GAINS_FILE
from vctune.design.result import Solved
from vctune.design.verdict.design_record import record_of
from vctune.document.building import ProblemSource
from vctune.document.building import problem as problem_of
from vctune.document.gains_file import gains_text, numbers_text
from vctune.document.reading import ProblemFile
from vctune.document.records.design_json import DesignRecord, design_of, read_design
from vctune.document.records.gains_json import SpringRecord as SpringRecord
from vctune.document.records.part import text as text
from vctune.document.records.printed_json import ReportRecord as ReportRecord
from vctune.document.records.simulation_json import simulation_beside
from vctune.document.text.date import today
from vctune.document.text.errors import InputError
from vctune.document.text.output_files import make_folder, write_together
from vctune.report.paths import REPORT as REPORT
from vctune.report.paths import report_paths


def write_design(problem: ProblemSource, solved: Solved, folder: str | Path) -> Path:
    """Write gains.toml and design.json, and remove the report of an earlier design.

    Parameters
    ----------
    problem : ProblemSource
        The problem that was solved.
    solved : Solved
        Result of `solve`.
    folder : str or Path
        Folder for the files; the function creates it if it does not exist.

    Returns
    -------
    Path
        The path of design.json.

    Raises
    ------
    InputError
        If the folder cannot be written. The function then changes no file.
    """
    file, folder = problem_of(problem), Path(folder)
    make_folder(folder)
    write_solved(folder, file, solved)
    return folder / DESIGN_FILE


def write_solved(folder: Path, file: ProblemFile, solved: Solved) -> DesignRecord:
    """Write gains.toml and design.json into an existing folder, and remove the report of an earlier design."""
    from vctune.design.nlp.ipopt import ipopt_version

    record = record_of(file, solved, ipopt_version(), today())
    write_record(folder, file, record)
    return record


def write_report(design: str | Path | Mapping[str, Any] | DesignRecord, folder: str | Path | None = None) -> Path:
    """Write the report of a design, report.html and its figures, without solving again.

    Parameters
    ----------
    design : str or Path or Mapping[str, Any] or DesignRecord
        Path of a design.json, the file's object, or its record.
    folder : str or Path, optional
        Folder for the report; the function creates it if it does not exist. None for the folder of the
        design.json; required if `design` is no path. If the folder of the design.json, or without a path this
        folder, has a simulation.json of the design, the report also shows the simulation.

    Returns
    -------
    Path
        The path of report.html.

    Raises
    ------
    InputError
        If there is no such design, if its object is invalid, or if the folder is missing or cannot be written.
    """
    from vctune.report.page import write_report as write

    if isinstance(design, str | Path):
        record, beside = read_design(Path(design)), Path(design).parent
    elif folder is None:
        raise InputError.of("folder", "bad-option", "is missing; name the folder of the report")
    else:
        record, beside = design if isinstance(design, DesignRecord) else design_of(dict(design), "design"), Path(folder)
    folder = beside if folder is None else Path(folder)
    make_folder(folder)
    write(record, folder, simulation_beside(beside, record))
    return folder / REPORT


def known_record(source: Any) -> DesignRecord | None:
    """Read the record of a design from a file or an object. Return None if the source states a problem."""
    if isinstance(source, DesignRecord):
        return source
    if isinstance(source, str | Path) and Path(source).suffix == ".json":
        return read_design(Path(source))
    if isinstance(source, Mapping) and "schema" in source:
        return design_of(dict(source), "design")
    return None


def write_record(folder: Path, file: ProblemFile, record: DesignRecord) -> None:
    """Write design.json and gains.toml, and remove the report, and without a design the gains, of an earlier design."""
    files = {folder / DESIGN_FILE: json_text(record)}
    gains, kind = folder / GAINS_FILE, file.problem.device.kind
    if record.design is not None and record.certificate is not None:
        origin: dict[str, str | float] = {
            "problem": file.problem.name,
            "sha256": file.sha256,
            "vctune": str(record.versions["vctune"]),
            "verdict": record.certificate.verdict,
            "numbers": numbers_text(kind, *record.design),
        }
        if (hands := record.certificate.hands) is not None and hands.walls is not None:
            origin["corner_hz"] = hands.walls.corner_hz
        files[gains] = gains_text(kind, *record.design, origin, record.problem.units)
    write_together(files, [*report_paths(folder), *([] if gains in files else [gains])])


def json_text(record: DesignRecord) -> str:
    """Return the text of a design.json."""
    return json.dumps(record.to_json(), indent=2, allow_nan=False) + "\n"
