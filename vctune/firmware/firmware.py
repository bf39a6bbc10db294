"""Define the content of an export: a design with its proved claims, and the rounded coefficients of the firmware."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, fields, replace
from math import inf, pi
from typing import Any, Literal

import numpy as np

from vctune.design.judging.judge import Judgement, Status, judge_all
from vctune.design.records.design import DesignRecord, record_of
from vctune.design.result import Solved
from vctune.document.reading import ProblemFile
from vctune.document.text.errors import printable
from vctune.document.text.json import digest
from vctune.model.device import Device
from vctune.model.experiment import Environment
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.numbers.matrices import nothing
from vctune.model.numbers.units import UNITS, Units
from vctune.model.problem import Problem
from vctune.model.sections import Section, rows_of_sections
from vctune.simulation.controller import Controller, controller_of, coupling_of
from vctune.simulation.scene import designed_law

Precision = Literal["double", "single"]
FILTERS = ("velocity_filter", "force_filter")  # Fields of a controller that are filters
# An environment without mass, damping and stiffness, because the constants of a firmware do not depend on it
NO_ENVIRONMENT = Environment(0.0, 0.0, 0.0, 0.0, False)


@dataclass(frozen=True, slots=True)
class Firmware:
    """A design, ready to be exported as firmware."""

    record: DesignRecord  # record of the exported design
    device: Device  # device of the problem, before the sample time and the filter are rounded
    gains: Gains  # the design before rounding
    coupling: AnyCoupling
    controller: Controller  # the controller without environment and limit, in its own precision
    precision: Precision  # precision of the firmware's arithmetic
    coefficients: dict[str, float]  # constants of the controller, in order, as rounded to its precision
    problem_sha256: str  # digest of the problem, and digest of problem, gains and coupling together
    design_sha256: str

    @property
    def name(self) -> str:
        """The name of the problem."""
        return self.record.problem.name

    @property
    def units(self) -> Units:
        """The units of the firmware's quantities."""
        return UNITS[self.device.units]

    @property
    def doubt(self) -> str:
        """The unproved claims with their verdicts and witnesses, in words; "" if the design is certified."""
        if self.record.status == "certified" or self.record.certificate is None:
            return ""
        claims = self.record.certificate.claims
        return "; ".join(
            f"{claim.verdict}{_place(claim.witness_hz)}: {claim.claim}" for claim in claims if claim.verdict != "proved"
        )


def firmware(
    file: ProblemFile, gains: Gains, coupling: AnyCoupling, precision: Precision, corner: float | None = None
) -> Firmware:
    """Return a design as firmware, after proving it with the constants that the firmware will have."""
    device = file.problem.device
    controller = controller_of(designed_law(device, gains, coupling, NO_ENVIRONMENT))
    coefficients = {name: getattr(controller, name) for name in constants_of(controller)} | filter_constants(controller)
    problem, design = file.problem, (gains, coupling)
    if precision == "single":
        coefficients = {name: float(np.float32(number)) for name, number in coefficients.items()}
        problem, design = rounded(file.problem, coefficients, controller)
        numbers: dict[str, Any] = {name: np.float32(coefficients[name]) for name in constants_of(controller)}
        numbers |= {name: _filter(name, coefficients, controller, np.float32) for name in FILTERS}
        controller = replace(controller, **numbers)
    judgement = judged(problem, design, corner)
    record = record_of(file, Solved(problem=problem, judgement=judgement))
    return Firmware(
        record=record,
        device=device,
        gains=gains,
        coupling=coupling,
        controller=controller,
        precision=precision,
        coefficients=coefficients,
        problem_sha256=file.sha256,
        design_sha256=digest([file.sha256, asdict(gains), asdict(coupling)]),
    )


@np.errstate(all="ignore")
def judged(problem: Problem, design: tuple[Gains, AnyCoupling], corner: float | None = None) -> Judgement:
    """Prove the claims of `vctune check` for a design, and return the verdicts."""
    return judge_all(problem, [design], [corner])[0]


def constants_of(controller: Controller) -> tuple[str, ...]:
    """Return the names of the coefficients that are constants of the C code."""
    if controller.command != "force":
        own_spring = ("own_stiffness",) if controller.own_stiffness > 0 else ()
        return ("sample_time", "half_sample_time", "coupling_step", "coupling_decay", "resistance", *own_spring)
    own = ["position_gain", "coupling_step", "coupling_decay"]
    if controller.spring:
        own = ["coupling_stiffness", "coupling_damping"]
    return ("sample_time", "half_sample_time", "velocity_gain", *own, "resistance")


def filter_constants(controller: Controller) -> dict[str, float]:
    """Return the coefficients of a controller's filters as constants of the C code."""
    each = ((name, place, section) for name in FILTERS for place, section in enumerate(getattr(controller, name)))
    return {
        f"{name}_{place}_{key}": number
        for name, place, section in each
        for key, number in asdict(section).items()
        if not nothing(number)
    }


def _filter(
    name: str, coefficients: dict[str, float], controller: Controller, number: Callable[[float], Any]
) -> tuple[Section, ...]:
    """Return a filter of a controller with given coefficients."""
    places = range(len(getattr(controller, name)))
    keys = [field.name for field in fields(Section)]
    of = ({key: coefficients.get(f"{name}_{place}_{key}") for key in keys} for place in places)
    return tuple(Section(**{key: 0 if each is None else number(each) for key, each in one.items()}) for one in of)


def rounded(
    problem: Problem, coefficients: dict[str, float], controller: Controller
) -> tuple[Problem, tuple[Gains, AnyCoupling]]:
    """Return the problem and the design whose exact coefficients equal given rounded coefficients."""
    T, device, stability = coefficients["sample_time"], problem.device, problem.stability
    velocity, force = (_filter(name, coefficients, controller, float) for name in FILTERS)
    estimate, sensor, servo = device.velocity, device.force_sensor, device.servo
    if estimate is not None and velocity:
        count = len(velocity) - len(estimate.sections or ())  # low-passes come before sections
        a = velocity[0].now if count else None
        rows = rows_of_sections(velocity[count:]) or None
        estimate = replace(estimate, filter_hz=None, filter_coefficient=a, sections=rows)
    if sensor is not None and force:
        count = len(force) - len(sensor.sections or ())
        a, rows = force[0].now if count else None, rows_of_sections(force[count:]) or None
        sensor = replace(sensor, filter_coefficient=a, sections=rows)
    if servo is not None and servo.stiffness is not None:
        servo = replace(servo, stiffness=coefficients["own_stiffness"])
    if stability.band.max <= pi / device.sample_time:
        stability = replace(stability, band=replace(stability.band, max=min(stability.band.max, pi / T)))
    gains = Gains(coefficients.get("velocity_gain", 0.0), coefficients.get("position_gain", 0.0))
    device = replace(device, sample_time=T, velocity=estimate, force_sensor=sensor, servo=servo)
    again = replace(problem, device=device, stability=stability)
    return again, (gains, coupling_of(coefficients, T, device.rule))


def certified(firmware: Firmware) -> bool:
    """Return whether all claims about a firmware are proved."""
    return firmware.record.status == Status.CERTIFIED.value


def _place(hz: float | None) -> str:
    return "" if hz is None else f" at {hz:.6g} Hz"


def literal(number: float, precision: Precision) -> str:
    """Return the shortest C constant that a compiler reads as exactly the given number."""
    if number in (inf, -inf):
        return "VCTUNE_NONE" if number > 0 else "-VCTUNE_NONE"
    text = repr(number) if precision == "double" else str(np.float32(number))
    if not set(text) & set(".en"):
        text += ".0"
    return text if precision == "double" else f"{text}f"


def comment(text: str, width: int = 110) -> list[str]:
    """Return a text as lines for a comment in C, in ASCII. The text cannot begin or end a comment."""
    lines, line = [], ""
    plain_text = printable(text).encode("ascii", "replace").decode()
    for word in plain_text.replace("/", " / ").split() if "*" in text else plain_text.split():
        if line and len(line) + 1 + len(word) > width:
            lines.append(line)
            line = ""
        line = f"{line} {word}" if line else word
    return [*lines, line] if line else lines
