"""Provide `vctune identify` as a function."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from vctune.document.log import read_log, read_log_map
from vctune.document.reading import ProblemFile, problem_file
from vctune.document.records.identification_json import (
    DEVICE_FILE,
    FILE,
    IdentificationRecord,
    device_text,
)
from vctune.document.text.errors import InputError
from vctune.document.text.output_files import Content, make_folder, write_together
from vctune.report.paths import IDENTIFICATION_FIGURES, report_paths

if TYPE_CHECKING:
    from collections.abc import Callable

    from vctune.identification.identify import Identified

LONGEST_NAME = 200  # Greatest length of a name in a problem file


@dataclass(frozen=True, slots=True)
class Identification:
    """A device, identified from recordings."""

    found: Identified  # the identified device with its box and the fits of the recordings
    record: IdentificationRecord  # the object of identification.json
    text: str  # text of device.toml

    @property
    def file(self) -> ProblemFile:
        """The device as a problem."""
        return problem_file(self.text, Path(DEVICE_FILE))


def identify(
    logs: str | Path | Sequence[str | Path],
    config: str | Path | None = None,
    *,
    servo: bool = False,
    progress: Callable[[str], None] = lambda stage: None,
) -> Identification:
    """Identify a device from its recordings.

    Parameters
    ----------
    logs : str or Path or Sequence[str or Path]
        CSV files, plain or .gz, all from the same device.
    config : str or Path, optional
        The log.toml that assigns the columns; None if the headers name them.
    servo : bool
        Whether the recordings contain a servo's command and position.
    progress : Callable[[str], None]
        Function that receives the current stage.

    Returns
    -------
    Identification

    Raises
    ------
    InputError
        If a file cannot be read or does not determine the device; the message states line, column and remedy. Also if
        there is no log or if SciPy is not installed.
    """
    paths = [Path(logs)] if isinstance(logs, str | Path) else [Path(path) for path in logs]
    if not paths:
        raise InputError.of("logs", "bad-option", "there is none; name at least one CSV file")
    known = read_log_map(None if config is None else Path(config), servo=servo)
    recordings = [read_log(path, known) for path in paths]
    from vctune.identification.identify import identification_record
    from vctune.identification.identify import identify as run

    stem = paths[0].name.removesuffix(".gz").removesuffix(".csv")[:LONGEST_NAME]
    name = known.document.name or stem or "device"
    found = run(recordings, known, name, progress)
    record = identification_record(found, known.document.description, _versions())
    text = device_text(record)
    problem_file(text, Path(DEVICE_FILE))
    return Identification(found, record, text)


def write_identification(identified: Identification, folder: str | Path, *, report: bool = True) -> Path:
    """Write device.toml, identification.json, and the report with its figures.

    Also remove the files of an earlier identification.

    Parameters
    ----------
    identified : Identification
        Identification to write.
    folder : str or Path
        Folder for the files; the function creates it if it does not exist.
    report : bool
        Whether to write the report.

    Returns
    -------
    Path
        The path of device.toml.

    Raises
    ------
    InputError
        If the folder cannot be written.
    """

    folder = Path(folder)
    make_folder(folder)
    value = json.dumps(identified.record.to_json(), indent=1, allow_nan=False) + "\n"
    files: dict[Path, Content] = {folder / DEVICE_FILE: identified.text, folder / FILE: value}
    if report:
        from vctune.report.identification import identification_files

        files |= identification_files(identified.found, identified.record, folder)
    write_together(files, [path for path in report_paths(folder, IDENTIFICATION_FIGURES) if path not in files])
    return folder / DEVICE_FILE


def _versions() -> dict[str, str | None]:
    from importlib.metadata import version

    from vctune.version import __version__

    return {"vctune": __version__, "numpy": version("numpy"), "scipy": version("scipy")}
