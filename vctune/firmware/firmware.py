"""Define the content of an export: a design with its proved claims, and the rounded coefficients of the firmware."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from math import inf, log, pi
from typing import Any, Literal

import numpy as np

from vctune.design.design_record import record_of
from vctune.design.judging.judge import Judgement, Status, judge_all
from vctune.design.result import Solved
from vctune.document.reading import ProblemFile
from vctune.document.records.design_json import DesignRecord
from vctune.document.text.errors import printable
from vctune.document.text.json import digest
from vctune.model.device import Device
from vctune.model.experiment import Environment
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.numbers.units import UNITS, Units
from vctune.model.problem import Problem
from vctune.simulation.controller import Controller, controller_of, coupling_of
from vctune.simulation.scene import designed_law

Precision = Literal["double", "single"]
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
    coefficients = {name: getattr(controller, name) for name in constants_of(controller)}
    problem, design = file.problem, (gains, coupling)
    if precision == "single":
        coefficients = {name: float(np.float32(number)) for name, number in coefficients.items()}
        problem, design = rounded(file.problem, coefficients)
        numbers: dict[str, Any] = {name: np.float32(number) for name, number in coefficients.items()}
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
        return ("sample_time", "half_sample_time", "coupling_step", "coupling_decay", "resistance")
    own = ["position_gain", "coupling_step", "coupling_decay"]
    if controller.spring:
        own = ["coupling_stiffness", "coupling_damping"]
    return ("sample_time", "half_sample_time", "velocity_gain", *own, "resistance", "smoothing")


def rounded(problem: Problem, coefficients: dict[str, float]) -> tuple[Problem, tuple[Gains, AnyCoupling]]:
    """Return the problem and the design whose exact coefficients equal given rounded coefficients."""
    T, device, stability = coefficients["sample_time"], problem.device, problem.stability
    estimate = device.velocity
    if estimate is not None and estimate.filter_hz is not None:
        estimate = replace(estimate, filter_hz=-log(1 - coefficients["smoothing"]) / (2 * pi * T))
    if stability.band.max <= pi / device.sample_time:
        stability = replace(stability, band=replace(stability.band, max=min(stability.band.max, pi / T)))
    gains = Gains(coefficients.get("velocity_gain", 0.0), coefficients.get("position_gain", 0.0))
    again = replace(problem, device=replace(device, sample_time=T, velocity=estimate), stability=stability)
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
