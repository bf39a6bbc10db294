"""Provide `vctune export` as a function."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, pi
from pathlib import Path
from typing import Any, get_args

from vctune.api.argument_ranges import Format
from vctune.api.result import RefusedError, code_of
from vctune.api.solving import known_record
from vctune.design.judging.judge import Status
from vctune.design.records.design import DesignRecord
from vctune.design.ros.admittance import problems_of_axes
from vctune.design.search.optimum import Progress
from vctune.document.building import DesignSource, ProblemSource, design_for
from vctune.document.building import problem as problem_of
from vctune.document.reading import ProblemFile, stated_problem
from vctune.document.reading import read_gains as read_gains
from vctune.document.text import toml
from vctune.document.text.errors import InputError, printable
from vctune.document.text.json import printed
from vctune.document.text.output_files import Content, make_folder, write_together
from vctune.firmware.firmware import Firmware, certified, firmware
from vctune.firmware.firmware import Precision as Precision
from vctune.firmware.preamble import statement
from vctune.firmware.ros2 import RosAxis, ros2_files, ros2_firmware
from vctune.model.gains import AnyCoupling, Gains

FOLDER = "firmware"  # Name of the folder for exported files, inside the design's folder


@dataclass(frozen=True, slots=True)
class Exported:
    """A design, exported as files."""

    file: ProblemFile  # the problem
    firmware: Firmware  # the exported design; of several designs, the first that is not certified, else the first
    files: Mapping[str, Content]  # contents of the files by name

    @property
    def statement(self) -> list[str]:
        """What is proved of the design, in lines that every file contains too."""
        return [printable(line) for line in statement(self.firmware) if line]

    def to_json(self, place: Path) -> dict[str, Any]:
        """Return the object for JSON of the files in a folder."""
        said = {"name": self.firmware.name, "status": self.firmware.record.status, "statement": self.statement}
        return printed("export", **said, folder=str(place), files=list(self.files))


def export(
    source: ProblemSource | DesignRecord | Sequence[ProblemSource | DesignRecord],
    gains: DesignSource | None = None,
    coupling: AnyCoupling | None = None,
    *,
    to: Format = "c",
    precision: Precision = "double",
    unproved: bool = False,
    progress: Progress = lambda stage: None,
) -> Exported:
    """Prove a design again with the constants of its firmware, and make the files.

    Parameters
    ----------
    source : ProblemSource or DesignRecord, or a sequence of them
        Path of a design.json or of a problem file, the tables of a problem, a problem, or the record of a design;
        several only for "ros2", whose file has an axis for each.
    gains : DesignSource, optional
        Gains, SI units, together with `coupling`; or a gains file or its path; None with the coupling of a
        servo, which has no gains, or for the source's own.
    coupling : AnyCoupling, optional
        Coupling of the design, SI units.
    to : Format
        "c" for C source with vectors to replay, or "ros2" for the parameters of an admittance_controller.
    precision : Precision
        Precision of the firmware's constants; "double" for a ROS 2 controller.
    unproved : bool
        Whether to also export a design that is not proved; the head of every file then says so.
    progress : Progress
        Function that receives the current stage.

    Returns
    -------
    Exported

    Raises
    ------
    NotCertifiedError
        If the design is not certified and `unproved` is not set. This is also an `InputError`.
    InputError
        If an option or a file is invalid, or if there is no design that the device, or ROS 2, can render.
    """
    for name, value, known in (("to", to, Format), ("precision", precision, Precision)):
        if value not in get_args(known):
            raise InputError.of(name, "bad-option", f"is {value!r}; one of {', '.join(get_args(known))}")
    several = isinstance(source, Sequence) and not isinstance(source, str)
    sources: Sequence[Any] = source if several else [source]  # type: ignore[assignment]
    if to == "ros2" and precision != "double":
        message = f"is {precision!r}, and an admittance_controller computes in double precision; leave it out"
        raise InputError.of("precision", "bad-option", message)
    if to != "ros2" and len(sources) != 1:
        raise InputError.of("to", "bad-option", f"{to} exports one design; only ros2 makes one file of several")
    stated = [stated_design(each, gains, coupling) for each in sources]
    progress("proving")
    file, design, corner = stated[0]
    if to != "ros2":
        controller = firmware(file, *design, precision, corner)
        if not certified(controller) and not unproved:
            raise NotCertifiedError(controller)
        return Exported(file, controller, _c_files(file, controller, progress))
    designs = {id(file): design for file, design, _ in stated}
    owners = problems_of_axes([file for file, *_ in stated])
    axes = [RosAxis(axis, owner, *designs[id(owner)]) for axis, owner in owners.items()]
    controllers = ros2_firmware(axes)
    first = next((number for number, controller in enumerate(controllers) if not certified(controller)), None)
    if first is not None and not unproved:
        raise NotCertifiedError(controllers[first], RIGID if axes[first].coupling.damping < inf else "")
    return Exported(file, controllers[first or 0], ros2_files(file.problem.name, axes, controllers))


# Hint for a design with a finite b_c that is not certified with the arithmetic of an admittance_controller
RIGID = (
    "; the controller renders mass and drag alone, without a damper in a row: write coupling.damping = inf, solve again"
)


class NotCertifiedError(RefusedError):
    """Error: vctune does not export a design because it is not certified. `status` is the design's status."""

    def __init__(self, controller: Firmware, also: str = "") -> None:
        single = " with the constants rounded to single precision" if controller.precision == "single" else ""
        self.status = Status(controller.record.status)
        refused = f"not exported: {self.status.value}{single}: {controller.doubt}{also}"
        message = f"{refused}; --unproved exports it, and says so"
        super().__init__(controller.name, "not-certified", message, code_of(self.status))


def write_export(exported: Exported, folder: str | Path) -> Path:
    """Write all files of an export. If an error occurs, write no file.

    Parameters
    ----------
    exported : Exported
        The files.
    folder : str or Path
        Folder of the design, in which the function creates the folder of the files.

    Returns
    -------
    Path
        The path of the files' folder.

    Raises
    ------
    InputError
        If the folder cannot be written.
    """
    place = Path(folder) / FOLDER
    make_folder(place)
    write_together({place / name: content for name, content in exported.files.items()})
    return place


def is_source(path: Path) -> bool:
    """Return whether a file states a problem or a design with its problem, and not gains alone."""
    return path.suffix == ".json" or "device" in toml.parse(toml.read_text(path), str(path))


def stated_design(
    source: ProblemSource | DesignRecord, gains: DesignSource | None, coupling: AnyCoupling | None
) -> tuple[ProblemFile, tuple[Gains, AnyCoupling], float | None]:
    """Return the problem, the design, and the corner frequency, rad/s, with which its walls were proved, if any."""
    record = known_record(source)
    if record is None:
        file = problem_of(source)  # type: ignore[arg-type]
        if gains is not None or coupling is not None:
            file, design = design_for(file, gains, coupling)
            return file, (design.gains, design.coupling), design.corner
        if not file.problem.bounds.fixed:
            message = "not every gain is fixed; name a gains file, or a design.json of `vctune solve`"
            raise InputError.of(file.source, "not-fixed", f"nothing to export: {message}", key="gains")
        return file, file.problem.fixed_design, None
    name = str(source) if isinstance(source, str | Path) else "design"
    if gains is not None or coupling is not None:
        message = "is a design of its own; name a problem file with other gains"
        raise InputError.of(name, "ambiguous-files", message, key="gains")
    if record.design is None:
        raise InputError.of(name, "no-design", f"nothing to export: {record.reason or record.status}", key="gains")
    walls = record.certificate and record.certificate.hands and record.certificate.hands.walls
    return stated_problem(record.problem, name), record.design, 2 * pi * walls.corner_hz if walls else None


def _c_files(file: ProblemFile, controller: Firmware, progress: Progress) -> Mapping[str, Content]:
    """Return the C code of a controller, with the files that replay its experiments."""
    from vctune.firmware.c_source import c_source
    from vctune.firmware.vectors import replay_files, replays

    sources = c_source(controller)
    return {**sources, **replay_files(controller, replays(file, controller, progress))}
