"""Provide `vctune export` as a function."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, pi
from pathlib import Path
from typing import get_args

from vctune.api.argument_ranges import Format
from vctune.api.design_files import known_record
from vctune.design.ros.admittance_design import problems_of_axes
from vctune.design.search.optimum import Progress
from vctune.design.verdict.judge import Status
from vctune.document.building import DesignSource, ProblemSource, design_for
from vctune.document.building import problem as problem_of
from vctune.document.reading import ProblemFile, parse_problem
from vctune.document.reading import read_gains as read_gains
from vctune.document.records.design_json import DesignRecord
from vctune.document.records.printed_json import ExportRecord
from vctune.document.text import toml
from vctune.document.text.errors import InputError, Mistake, printable
from vctune.document.text.output_files import Content, make_folder, write_together
from vctune.firmware.c_text import Precision as Precision
from vctune.firmware.firmware import Firmware, certified, firmware
from vctune.firmware.preamble import statement
from vctune.firmware.ros2 import RosAxis, ros2_files, ros2_firmware
from vctune.model.gains import AnyCoupling, Gains

Files = Mapping[str, Content]  # Contents of files, by name
FOLDER = "firmware"  # Name of the folder for exported files, inside the design's folder


@dataclass(frozen=True, slots=True)
class Exported:
    """A design, exported as files."""

    file: ProblemFile  # the problem
    firmware: Firmware  # the exported design; for a ROS 2 controller see `export_parameters`
    files: Files  # contents of the files by name


def export(
    source: ProblemSource | DesignRecord,
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
    source : ProblemSource or DesignRecord
        Path of a design.json or of a problem file, the tables of a problem, a problem, or the record of a
        design.
    gains : DesignSource, optional
        Gains, SI units, given together with `coupling`; or a gains file or its path; None for the gains of the
        design.json, or for the gains that the problem fixes.
    coupling : AnyCoupling, optional
        Coupling of the design, SI units.
    to : Format
        "c" for C source with vectors to replay, or "ros2" for the parameters of an admittance_controller.
    precision : Precision
        Precision of the firmware's constants; "double" for a ROS 2 controller.
    unproved : bool
        Whether to also export a design that is not proved; the head of every file then states that it is not
        proved.
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
        If an option is unknown, if a file is invalid, if there is no design, or if the design is for another kind of
        device; or if `to` is "ros2" and the controller cannot render the design.
    """
    for name, value, known in (("to", to, Format), ("precision", precision, Precision)):
        if value not in get_args(known):
            raise InputError.of(name, "bad-option", f"is {value!r}; one of {', '.join(get_args(known))}")
    if to == "ros2":
        require_double(precision)
        return export_parameters([source], gains, coupling, unproved=unproved, progress=progress)
    file, design = stated_design(source, gains, coupling)
    progress("proving")
    controller = firmware(file, *design, precision, _stated_corner(source, gains, coupling, file))
    if not certified(controller) and not unproved:
        raise NotCertifiedError(controller)
    return Exported(file, controller, _c_files(file, controller, progress))


def require_double(precision: Precision) -> None:
    """Check that a ROS 2 controller is exported in double precision, because the controller computes in double
    precision."""
    if precision != "double":
        message = f"is {precision!r}, and an admittance_controller computes in double precision; leave it out"
        raise InputError.of("precision", "bad-option", message)


def export_parameters(
    sources: Sequence[ProblemSource | DesignRecord],
    gains: DesignSource | None = None,
    coupling: AnyCoupling | None = None,
    *,
    unproved: bool = False,
    progress: Progress = lambda stage: None,
) -> Exported:
    """Prove designs with the arithmetic of a ROS 2 admittance_controller, and make one parameter file of them."""
    progress("proving")
    stated = [stated_design(source, gains, coupling) for source in sources]
    owners, designs = problems_of_axes([file for file, _ in stated]), {id(file): design for file, design in stated}
    axes = [RosAxis(axis, file, *designs[id(file)]) for axis, file in owners.items()]
    controllers = ros2_firmware(axes)
    first = next((number for number, controller in enumerate(controllers) if not certified(controller)), None)
    if first is not None and not unproved:
        raise NotCertifiedError(controllers[first], RIGID if axes[first].coupling.damping < inf else "")
    file = stated[0][0]
    return Exported(file, controllers[first or 0], ros2_files(file.problem.name, axes, controllers))


# Hint for a design with a finite b_c that is not certified with the arithmetic of an admittance_controller
RIGID = (
    "; the controller renders mass and drag alone, without a damper in a row: write coupling.damping = inf, solve again"
)


class NotCertifiedError(InputError):
    """Error: vctune does not export a design because it is not certified. `status` is the design's status."""

    def __init__(self, controller: Firmware, also: str = "") -> None:
        single = " with the constants rounded to single precision" if controller.precision == "single" else ""
        self.status = Status(controller.record.status)
        message = (
            f"not exported: {self.status.value}{single}: {controller.doubt}{also}; --unproved exports it, and says so"
        )
        super().__init__(controller.name, [Mistake("not-certified", "", message)])


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


def export_record(exported: Exported, place: Path) -> ExportRecord:
    """Return an export as a record for JSON."""
    controller = exported.firmware
    return ExportRecord(
        name=controller.name,
        status=controller.record.status,
        statement=[printable(line) for line in statement(controller) if line],
        folder=str(place),
        files=list(exported.files),
    )


def is_source(path: Path) -> bool:
    """Return whether a file states a problem or a design with its problem, and not gains alone."""
    return path.suffix == ".json" or "device" in toml.parse(toml.read_text(path), str(path))


def stated_design(
    source: ProblemSource | DesignRecord, gains: DesignSource | None, coupling: AnyCoupling | None
) -> tuple[ProblemFile, tuple[Gains, AnyCoupling]]:
    """Return the problem and the design that the arguments name."""
    record = known_record(source)
    if record is None:
        file = problem_of(source)  # type: ignore[arg-type]
        if gains is not None:
            design = design_for(file, gains, coupling)
            return file, (design.gains, design.coupling)
        if not file.problem.bounds.fixed:
            message = (
                "nothing to export: not every gain is fixed; name a gains file, or a design.json of `vctune solve`"
            )
            raise InputError.of(file.source, "not-fixed", message, key="gains")
        return file, file.problem.fixed_design
    source_name = str(source) if isinstance(source, str | Path) else "design"
    if gains is not None:
        raise InputError.of(
            source_name, "ambiguous-files", "is a design of its own; name a problem file with other gains", key="gains"
        )
    if record.design is None:
        raise InputError.of(
            source_name, "no-design", f"nothing to export: {record.reason or record.status}", key="gains"
        )
    file = ProblemFile(
        parse_problem(record.problem.text, source_name, record.problem.name), record.problem.text, record.problem.name
    )
    if file.sha256 != record.problem.sha256:
        message = "does not belong to the problem's text: one of them was changed; solve the problem again"
        raise InputError.of(source_name, "damaged-document", message, key="problem.sha256")
    return file, record.design


def _stated_corner(
    source: ProblemSource | DesignRecord, gains: DesignSource | None, coupling: AnyCoupling | None, file: ProblemFile
) -> float | None:
    """Return the corner frequency, rad/s, with which the walls of a design were proved; None if no file states it."""
    record = known_record(source)
    if record is None:
        return None if gains is None else design_for(file, gains, coupling).corner
    walls = record.certificate and record.certificate.hands and record.certificate.hands.walls
    return 2 * pi * walls.corner_hz if walls else None


def _c_files(file: ProblemFile, controller: Firmware, progress: Progress) -> Files:
    """Return the C code of a controller, with the files that replay its experiments."""
    from vctune.firmware.c_source import c_source
    from vctune.firmware.vectors import replay_files, replays

    sources = c_source(controller)
    return {**sources, **replay_files(controller, replays(file, controller, progress))}
