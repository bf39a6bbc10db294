"""Provide `vctune identify` as a function."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from vctune.api.result import Files, Printed, Table, write
from vctune.document.log import read_log_map, read_logs
from vctune.document.reading import ProblemFile, problem_file
from vctune.document.records.identification_json import DEVICE_FILE, FILE, IdentificationRecord, device_text
from vctune.document.text.errors import InputError, printable
from vctune.document.text.output_files import make_folder
from vctune.exit_codes import ExitCode
from vctune.report.paths import IDENTIFICATION_FIGURES, report_paths
from vctune.version import __version__

if TYPE_CHECKING:
    from vctune.identification.identify import Identified

LONGEST_NAME = 200  # Greatest length of a name in a problem file


@dataclass(frozen=True, slots=True)
class Identification:
    """A device, identified from recordings."""

    found: Identified  # the identified device and the fits of the recordings
    text: str  # text of device.toml
    file: ProblemFile  # the device as a problem
    exit_code = ExitCode.OK

    @property
    def record(self) -> IdentificationRecord:
        """The object of identification.json."""
        return self.found.record

    def rows(self) -> Printed:
        """Yield the recordings, the parameters with their intervals, the warnings and the remarks."""
        record = self.record
        yield ((printable(record.name), "bold"),)
        for one in record.recordings:
            left = "" if one.residual_share is None else f", residual {one.residual_share:.2%}"
            yield (f"{printable(one.source)}: {one.kind}, {one.used} of {one.samples} samples{left}",)
        rows = [
            (each.key, *(f"{value:.5g}" for value in (each.value, each.low, each.high)), each.unit, each.limit)
            for each in record.numbers
        ]
        yield Table(rows, ("number", "value", "from", "to", "", "limited by"), right=(1, 2, 3))
        if record.unmodelled:
            hertz, radius = max(record.unmodelled, key=lambda point: point[1] or 0.0)
            yield (f"unmodelled: up to {radius:.3g} of the response, at {hertz:.4g} Hz",)
        yield from ((("warning:", "yellow"), f" {printable(warning)}") for warning in record.warnings)
        yield from (((printable(remark), "dim"),) for remark in record.remarks)

    def files(self, folder: Path, *, report: bool = True) -> Files:
        """Return device.toml, identification.json and the report, in place of those of an earlier identification."""
        value = json.dumps(self.record.to_json(), indent=1, allow_nan=False) + "\n"
        files: Files = {folder / DEVICE_FILE: self.text, folder / FILE: value}
        files |= dict.fromkeys(report_paths(folder, IDENTIFICATION_FIGURES))
        if report:
            from vctune.report.identification import identification_files

            files |= identification_files(self.found, self.record, folder)
        return files

    def steps(self, folder: Path) -> list[str]:
        """Return no next step: a problem file follows, and the guide tells its use."""
        return []


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
        If there is no log, or a file cannot be read or does not determine the device; with line, column and remedy.
    """
    paths = [Path(logs)] if isinstance(logs, str | Path) else [Path(path) for path in logs]
    if not paths:
        raise InputError.of("logs", "bad-option", "there is none; name at least one CSV file")
    known = read_log_map(None if config is None else Path(config), servo=servo)
    recordings = read_logs(paths, known)
    from vctune.identification.identify import identify as run

    stem = paths[0].name.removesuffix(".gz").removesuffix(".csv")[:LONGEST_NAME]
    versions = {"vctune": __version__, "numpy": version("numpy"), "scipy": version("scipy")}
    found = run(recordings, known, known.document.name or stem or "device", progress, versions)
    text = device_text(found.record)
    return Identification(found, text, problem_file(text, Path(DEVICE_FILE)))


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
    make_folder(Path(folder))
    write(identified.files(Path(folder), report=report))
    return Path(folder) / DEVICE_FILE
