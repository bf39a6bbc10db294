"""Read problem files and gains files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import inf, pi
from pathlib import Path
from typing import Any

from vctune.document.gains_file import numbers_in
from vctune.document.records.gains_json import ProblemRecord
from vctune.document.schema.defaults import resolve
from vctune.document.schema.number_units import units_stated
from vctune.document.schema.problem_schema import (
    GainsDocument,
    ProblemDocument,
    ServoGainsDocument,
    SpringGainsDocument,
    SteppedTable,
)
from vctune.document.schema.rules import ADDS_TO_WALL, BEYOND_REST, contradictions
from vctune.document.schema.statement import statement
from vctune.document.schema.validation import Contradiction, Fault, KeyPath, examined, refusal, validated
from vctune.document.text import toml
from vctune.document.text.errors import InputError, Mistake
from vctune.document.text.json import problem_digest
from vctune.model.display import ADMITTANCE, DISPLAYS, IMPEDANCE, SERVO, STEPPED, Display, DisplayName, stated_display
from vctune.model.gains import AnyCoupling, Coupling, Gains
from vctune.model.numbers.units import UNITS, UnitSystem
from vctune.model.problem import Problem


@dataclass(frozen=True, slots=True)
class ProblemFile:
    """A problem and the text that states it.

    Attributes
    ----------
    problem : Problem
        Problem with all defaults filled in.
    text : str
        Text in TOML.
    source : str
        Path of the file, "stdin" for standard input; "problem" without a file.
    """

    problem: Problem
    text: str
    source: str = "problem"

    @property
    def document(self) -> dict[str, Any]:
        """The parsed text."""
        return toml.parse(self.text, self.problem.name)

    @property
    def sha256(self) -> str:
        """The digest that ties a design to its problem.

        The digest depends on the meaning of the problem, not on its text (`problem_digest`).
        """
        return problem_digest(self.problem)

    def line_of(self, path: KeyPath) -> int:
        """Return the line of a key or, if it is absent, of the innermost table that should contain it."""
        return toml.Lines(self.text).nearest(path)


def read_problem(path: str | Path) -> ProblemFile:
    """Read a problem file.

    Parameters
    ----------
    path : str or Path
        Path of a TOML file; "-" is standard input.

    Returns
    -------
    ProblemFile
        The `problem` with all defaults filled in, and the `text` that states it.

    Raises
    ------
    InputError
        If the file cannot be read or is invalid; the error lists all mistakes with line, dotted key, value and remedy.
    """
    if ".csv" in Path(path).suffixes:
        message = f"is a log, not a problem; `vctune identify {path}` makes a problem file from it"
        raise InputError.of(str(path), "other-kind", message)
    return problem_file(toml.read_text(Path(path)), Path(path))


def problem_file(text: str, path: Path) -> ProblemFile:
    """Return the problem that the text of a file states."""
    path = toml.called(path)
    name = path.stem.encode("utf-8", "replace").decode()
    return ProblemFile(parse_problem(text, str(path), name), text, str(path))


def parse_problem(text: str, source: str, default_name: str) -> Problem:
    """Return the problem that a TOML text states."""
    problem, faults = problem_at(toml.parse(text, source), default_name)
    if problem is None:
        raise refusal(faults, text, source)
    return problem


def problem_at(raw: dict[str, Any], default_name: str) -> tuple[Problem | None, list[Fault]]:
    """Return the problem that parsed TOML states and no faults, or None and all faults."""
    document, faults = examined(ProblemDocument, raw, contradictions)
    if document is None or faults:
        units = units_stated(raw)  # the text about a missing key is written for a linear device
        return None, [
            fault._replace(message=units.translated(fault.message)) if fault.code == "missing-key" else fault
            for fault in faults
        ]
    problem = resolve(document, default_name)
    low, high = problem.transparency.band.min / (2 * pi), problem.stability.band.max / (2 * pi)
    if problem.stability.band.min < problem.stability.band.max:
        return problem, []
    message = (
        f"with the lower edge {low:g} Hz the default stability band, from there to 0.05/tau with tau = "
        f"sample_time/2 + delay ({high:g} Hz), is empty; set stability.band_hz"
    )
    return None, [Fault(("transparency", "band_hz"), message, "contradiction")]


def on_yardstick(document: dict[str, Any], base: Problem) -> dict[str, Any]:
    """Return the tables of a problem in which the bands and Z_0 of another one apply where they state none."""
    stated = statement(base)
    keys = [("transparency", "band_hz"), ("transparency", "reference_impedance")]
    keys += [("stability", "band_hz")] * base.passive
    return toml.placed(
        document, ((key, toml.value_at(stated, key)) for key in keys if not toml.value_at(document, key))
    )


@dataclass(frozen=True, slots=True)
class GainsFile:
    """Gains and coupling as a gains file states them."""

    kind: Display  # kind of display of the design
    gains: Gains  # the design; the gains that a kind of display lacks are 0
    coupling: AnyCoupling
    sha256: str | None  # digest of the problem for which the design was made; None if the file does not state it
    units: UnitSystem | None  # units of the numbers; None if the file does not state them
    text: str  # the file's text
    source: str = "design"  # path of the file; "design" without a file
    solved: Mapping[str, float] = field(default_factory=dict)  # numbers of the original design by their keys
    corner: float | None = None  # corner of the multiplier that proves the design's walls, rad/s


def read_gains(path: str | Path) -> GainsFile:
    """Read a gains file; "-" is standard input. Raises `InputError` like `read_problem`."""
    return gains_file(toml.read_text(Path(path)), Path(path))


def gains_file(text: str, path: Path) -> GainsFile:
    """Return the gains that the text of a file states."""
    path = toml.called(path)
    kind = _kind_of(toml.parse(text, str(path)))
    document = validated(GAINS_DOCUMENTS[kind.name], text, str(path), _other_display)
    stated, origin, coupling = getattr(document, "gains", None), document.design, document.coupling
    if isinstance(coupling, SteppedTable):
        coupling = Coupling(inf, coupling.mass, coupling.drag)
    gains = Gains(getattr(stated, "velocity", 0.0), getattr(stated, "position", 0.0))
    solved = numbers_in(origin.numbers or "", kind)
    corner = None if origin.corner_hz is None else 2 * pi * origin.corner_hz
    return GainsFile(kind, gains, coupling, origin.sha256, origin.units, text, str(path), solved, corner)


# Schema of a gains file for each kind of display
GAINS_DOCUMENTS: dict[DisplayName, type[GainsDocument | SpringGainsDocument | ServoGainsDocument]] = {
    "admittance": GainsDocument,
    "impedance": SpringGainsDocument,
    "servo": ServoGainsDocument,
}


def _kind_of(raw: dict[str, Any]) -> Display:
    """Return the kind of display of a gains file."""
    if toml.value_at(raw, ("coupling", "stiffness")) is not None:
        return IMPEDANCE
    stated = toml.value_at(raw, ("design", "display"))
    if "gains" in raw or stated not in (None, "servo"):
        return ADMITTANCE
    return STEPPED if toml.value_at(raw, ("coupling", "rule")) == "euler" else SERVO


def _other_display(raw: dict[str, Any]) -> list[Contradiction]:
    """Return the fault of a gains file whose numbers contradict the display that it states."""
    kind, stated = _kind_of(raw), toml.value_at(raw, ("design", "display"))
    if stated not in DISPLAYS or stated == kind.name:
        return []
    if kind is ADMITTANCE and stated == "servo":
        return [(("design", "display"), '"servo" contradicts [gains], which no servo has; correct one')]
    key, other = ("stiffness", "impedance") if kind is IMPEDANCE else ("mass", "admittance")
    message = f'"{stated}" contradicts [coupling], in which {key} makes it that of an {other} display; correct one'
    return [(("design", "display"), message)]


def called(display: DisplayName) -> str:
    """Return the words for a kind of display in messages."""
    return "a servo" if display == "servo" else f"an {display} display"


def problem_of_gains(file: ProblemFile, given: GainsFile) -> ProblemFile:
    """Return a problem with the rule of gains if they state another one; refuse gains for another kind of device."""
    lines = toml.Lines(given.text)
    telling = ("coupling", "stiffness" if given.kind is IMPEDANCE else "mass")
    keys = {"display": telling, "units": ("design", "units")}
    mistakes = [
        Mistake("other-kind", ".".join(keys[which]), message, lines.locate(keys[which]))
        for which, message in _differences(file, given.kind.name, given.units, "gains")
    ]
    if mistakes:
        raise InputError(given.source, mistakes)
    device = file.problem.device
    if given.kind is STEPPED and device.rule != "euler":
        tables = {**file.document, "coupling": {"rule": "euler"}}
        file = replace(problem_file(toml.toml_text(tables), Path(file.source)), source=file.source)
    if file.problem.device.rule == "euler":
        _require_step(given, file.problem.device.sample_time)
    if file.problem.rigid and given.gains.velocity != 0:
        line = lines.locate(("gains", "velocity"))
        raise InputError.of(given.source, "contradiction", ADDS_TO_WALL, key="gains.velocity", line=line)
    return file


def _require_step(given: GainsFile, T: float) -> None:
    """Refuse numbers that are not those of M a + D v = F, or with which a step of it goes beyond rest."""
    coupling = given.coupling
    assert isinstance(coupling, Coupling)
    key, message = "", ""
    if not coupling.rigid:
        key, message = "damping", 'means nothing with rule = "euler" of the problem; write mass and drag of its law'
    elif coupling.mass <= (least := coupling.drag * T):
        key, message = "mass", f"{coupling.mass:g} is not above drag times sample_time, {least:g}: {BEYOND_REST}"
    if key:
        place = ("coupling", key)
        line = toml.Lines(given.text).locate(place)
        raise InputError.of(given.source, "contradiction", message, key=".".join(place), line=line)


def stated_problem(record: ProblemRecord, source: str) -> ProblemFile:
    """Return the problem whose text a record states."""
    problem = parse_problem(record.text, f"{source}: problem.text", record.name)
    return ProblemFile(problem, record.text, record.name)


def digest_mistakes(record: ProblemRecord, file: ProblemFile) -> list[Mistake]:
    """Return the mistake of a record whose digest is of another problem than its text."""
    message = "does not belong to problem.text: one of them was changed, or vctune's defaults were"
    return [] if file.sha256 == record.sha256 else [Mistake("damaged-document", "problem.sha256", message)]


def require_record_of(file: ProblemFile, record: ProblemRecord, source: str, what: str) -> None:
    """Check that a record is for the same kind of device as a problem."""
    device = toml.parse(record.text, source).get("device")
    differ = _differences(file, stated_display(device if isinstance(device, dict) else {}).name, record.units, what)
    if differ:
        keys = {"display": "problem.text", "units": "problem.units"}
        raise InputError(source, [Mistake("other-kind", keys[which], message) for which, message in differ])


def _differences(file: ProblemFile, display: DisplayName, units: UnitSystem | None, what: str) -> list[tuple[str, str]]:
    """Return the differences between two kinds. Each is "display" or "units", with its message."""
    device, remedy = file.problem.device, f"name the problem of the {what}, or solve this one"
    verb = "are" if what == "gains" else "is"
    sides = [("display", called(display), called(device.display))]
    if units is not None:
        sides.append(("units", _in_units(units), _in_units(device.units)))
    return [
        (key, f"the {what} {verb} for {one}, and {file.source} has {other} (device.{key}); {remedy}")
        for key, one, other in sides
        if one != other
    ]


def _in_units(system: UnitSystem) -> str:
    units = UNITS[system]
    return f"a {system} device, in {units.damping} and {units.stiffness}"
