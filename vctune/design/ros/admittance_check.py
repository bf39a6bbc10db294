"""Check each axis of a ROS 2 parameter file of an admittance_controller, and find repairs of a refuted one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal
from math import pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from vctune.design.advice.parameter_changes import ParameterChange, parameter_changes
from vctune.design.advice.repair import Found, Progress, find_repairs, hands_of
from vctune.design.check import (
    VERDICTS,
    Checked,
    CheckVerdict,
    DesignFinding,
    finding_of,
    first_remedy,
    remedy,
)
from vctune.design.judging.judge import Judgement, Status, judge
from vctune.design.judging.said import said_of
from vctune.design.records.shake import in_few_words, shaken_in_time
from vctune.design.result import Repair
from vctune.design.ros.admittance import (
    arm_tables,
    as_problem,
    corner_hz,
    coupling_of_admittance,
    document_of_both,
    followed,
    problems_of_axes,
)
from vctune.document.reading import ProblemFile, problem_at, problem_file
from vctune.document.ros import AXES, GRAVITY, HEAVIEST, LIGHTEST, TUNED, WEIGHT, Admittance, AdmittanceFile
from vctune.document.schema.validation import KeyPath
from vctune.document.text import toml
from vctune.document.text.errors import Code, InputError, Note
from vctune.document.text.toml import toml_text
from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.numbers.units import UNITS, Units, UnitSystem
from vctune.model.problem import Problem
from vctune.proof.certificate import together
from vctune.proof.claims.claim import Question
from vctune.proof.outcome import Outcome, Verdict

RATE = "sample_time"
Rate = tuple[str, float, int]  # key, value, Hz, and line of a stated update_rate
DIGITS = 3  # Least number of digits to which a sample_time must be 1/update_rate; the proof is at the file's rate
SAME_TOOL = 0.02  # Relative difference within which the weight of a file is that of the problem's tool
SLOW = 0.1  # Share of the Nyquist frequency below which vctune warns of a filter's corner frequency


def check_parameters(
    problems: Sequence[ProblemFile], path: Path, given: AdmittanceFile, progress: Progress = lambda stage: None
) -> list[Checked]:
    """Check the selected axes of a parameter file, each with the problem that is for it."""
    if not given.axes:
        return [_nothing_selected(problems[0], path, given)]
    if len(problems) == 1:
        return check_admittance(problems[0], path, given, progress)
    owners, selected = problems_of_axes(problems), [axis.axis for axis in given.axes]
    if missing := [name for name in selected if name not in owners]:
        message = f"selects {', '.join(missing)}, and no problem is for that; name one, or do not select it"
        raise InputError.of(str(path), "contradiction", message, key="admittance.selected_axes", line=given.line)
    checks = list[Checked]()
    for problem in problems:
        axes = tuple(axis for axis in given.axes if owners[axis.axis] is problem)
        if axes:
            checks += check_admittance(problem, path, replace(given, axes=axes), progress)
    return checks


def _nothing_selected(problem: ProblemFile, path: Path, given: AdmittanceFile) -> Checked:
    """Return the check of a file that moves no axis."""
    called = f"{given.name}: " if given.name else ""
    message = f"{path}: {called}no axis is selected (admittance.selected_axes), so that nothing moves or is proved"
    name = f"{problem.problem.name} {given.name}".strip()
    return Checked(path, name, CheckVerdict.PASSED, message, given.line, None)


def check_admittance(
    problem: ProblemFile,
    path: Path,
    given: AdmittanceFile,
    progress: Progress = lambda stage: None,
) -> list[Checked]:
    """Check the selected axes of a parameter file. Axes that have the same values are one check."""
    _require_rate(problem, path, given)
    given = _require_tool(problem, path, given)
    tables, axes = _device(problem, given), _chosen(problem, path, given)
    alike: dict[Any, list[Admittance]] = {}
    for axis in axes:
        numbers = replace(axis, axis=""), given.load and given.load.inertia(axis.axis)
        alike.setdefault((axis.turns, numbers), []).append(axis)
    checks: list[Checked] = []
    for group in alike.values():
        if _moves_as(group[0], problem):
            check = _checked(problem, tables, given, group[0], progress)
        else:
            message = f"not looked at: {_misfit(group, problem)}"
            check = _unproved(CheckVerdict.UNDECIDED, "ros-rotation", message, group[0])
        checks.append(_of_axes(check, problem, path, group, given.name))
    return _with_angles(checks, problem, path, tables, given, axes)


def _with_angles(
    checks: list[Checked],
    problem: ProblemFile,
    path: Path,
    tables: dict[str, Any],
    given: AdmittanceFile,
    axes: list[Admittance],
) -> list[Checked]:
    """Return the checks of proved axes of one servo, which say that they cover hands at every angle to the axes
    (model/README.md, section 17), or else one more check of all together."""
    if problem.problem.device.kind.own_loop or len(axes) < 2 or any(each.verdict != "passed" for each in checks):
        return checks
    named = _named(axes)
    found, alike = Outcome(Verdict.PROVED, 0), _alike(given, axes)
    if not (alike or all(_proved_by_resistance(tables, given, axis) for axis in axes)):
        found = together(questions_of(checks))
    if found.verdict is Verdict.PROVED:
        said = f"also in hands at every angle to {named}"
        if problem.problem.stability.damping_ratio is not None and not alike:
            said = f"stable also in hands at every angle to {named}, with the damping ratio proved along the axes alone"
        return [replace(each, message=f"{each.message}; {said}") for each in checks]
    hz = "" if found.witness is None else f", about {found.witness / (2 * pi):.4g} Hz"
    said = f"{named} together: proved each alone, and not in hands at an angle to them, since their laws differ{hz}"
    note = Note("ros-angle", f"{said}; the same law on all of them would be")
    apart = _unproved(CheckVerdict.UNDECIDED, note.code, note.text, axes[0])
    name, message = f"{problem.problem.name} {given.name} {named}", f"{path}: {apart.message}"
    return [*checks, replace(apart, source=path, name=" ".join(name.split()), message=message)]


def _alike(given: AdmittanceFile, axes: Sequence[Admittance]) -> bool:
    """Return whether all axes have one law and one tool, so that the proof of one covers every angle."""
    laws = {replace(axis, axis="", line=0) for axis in axes}
    return len(laws) == 1 and len({given.load and given.load.inertia(axis.axis) for axis in axes}) == 1


def questions_of(checks: Sequence[Checked]) -> list[Question]:
    """Return what was asked of designs that are judged."""
    judged = [each.finding.judgement for each in checks if isinstance(each.finding, DesignFinding)]
    return [
        Question(Design(each.posed.demands.device, each.gains, each.coupling), each.posed.demands, each.posed.box)
        for each in judged
    ]


def _proved_by_resistance(tables: dict[str, Any], given: AdmittanceFile, axis: Admittance) -> bool:
    """Return whether Re Z_c >= factor R is proved of an axis, as with every passive environment behind it."""
    document = document_of_both({**tables, "environment": {}}, given, axis)
    problem, _ = problem_at(as_problem(document), "")
    return problem is not None and judge(problem, *problem.fixed_design).status is Status.CERTIFIED


def _require_tool(problem: ProblemFile, path: Path, given: AdmittanceFile) -> AdmittanceFile:
    """Return the file without its tool if the problem states it too; refuse one that contradicts the problem."""
    tool, load = problem.problem.hands.tool, given.load
    if tool is None or load is None:
        return given
    low, high = tool.low.mass * (1 - SAME_TOOL), tool.high.mass * (1 + SAME_TOOL)
    if problem.problem.device.units == "linear" and not low <= load.mass <= high:
        stated = toml.Lines(problem.text).locate(("tool",))
        message = f"is {load.weight:g} N, {load.mass:.4g} kg, and {problem.source}:{stated} states another [tool]"
        message += "; leave [tool] out, or write the weight that hangs there"
        raise InputError.of(str(path), "contradiction", message, key=WEIGHT, line=given.lines[WEIGHT])
    return replace(given, load=None)


def _require_rate(problem: ProblemFile, path: Path, given: AdmittanceFile) -> None:
    """Refuse a file that states another rate than the problem, whose proof would be of another loop."""
    if given.rate is None:
        return
    (key, rate, line), T = given.rate, problem.problem.device.sample_time
    digits = max(len(f"{Decimal(repr(T)).normalize():e}".partition("e")[0].replace(".", "")), DIGITS)
    if float(f"{1 / rate:.{digits}g}") != T:
        stated = toml.Lines(problem.text).locate(("device", "sample_time"))
        message = f"{rate:g} Hz contradicts device.sample_time = {T!r} s, {1 / T:.6g} Hz, of {problem.source}"
        message += f":{stated}" if stated else ""
        raise InputError.of(
            str(path),
            "contradiction",
            f"{message}; write the rate at which the loop runs, or sample_time = {1 / rate:.6g}",
            key=key,
            line=line,
        )


def _chosen(problem: ProblemFile, path: Path, given: AdmittanceFile) -> list[Admittance]:
    """Return the selected axes, including those with the other kind of motion, which `check_admittance` skips."""
    axes = list(given.axes)
    others = [axis for axis in axes if not _moves_as(axis, problem)]
    if others and len(others) == len(axes):
        message = f"{', '.join(axis.axis for axis in others)} cannot be looked at: {_misfit(others, problem)}"
        raise InputError.of(str(path), "ros-rotation", message, key="admittance.selected_axes", line=given.line)
    return axes


def _moves_as(axis: Admittance, problem: ProblemFile) -> bool:
    return axis.turns == (problem.problem.device.units == "rotary")


def _misfit(axes: list[Admittance], problem: ProblemFile) -> str:
    """Return why axes cannot be checked with this problem."""
    own = problem.problem.device.units
    other: UnitSystem = "linear" if own == "rotary" else "rotary"
    moves = "rotations" if other == "rotary" else "translations"
    units = UNITS[other]
    return (
        f"{moves if len(axes) > 1 else f'a {moves[:-1]}'}, and {problem.source} has a {own} device (device.units); "
        f"name a problem of a {other} one, in {units.mass} and {units.damping}"
    )


def _unproved(verdict: CheckVerdict, code: Code, message: str, axis: Admittance) -> Checked:
    """Return a check that ends before there is a design to judge."""
    return Checked(Path(), "", verdict, Note(code, message).line, axis.line, None)


def _named(axes: Sequence[Admittance]) -> str:
    """Return the names of axes: x, y and z."""
    *others, last = (axis.axis for axis in axes)
    return f"{', '.join(others)} and {last}" if others else last


def _of_axes(
    checked: Checked, problem: ProblemFile, path: Path, axes: Sequence[Admittance], controller: str
) -> Checked:
    """Return a check with the names of its axes."""
    called = f"{controller} {_named(axes)}".strip()
    name, message, finding = f"{problem.problem.name} {called}", f"{called}: {checked.message}", checked.finding
    if isinstance(finding, DesignFinding):
        named = replace(finding.file, problem=replace(finding.file.problem, name=name))
        finding = replace(finding, file=named)
    else:
        message = f"{path}: {message}"
    return replace(checked, source=path, name=name, message=message, finding=finding)


def _device(problem: ProblemFile, given: AdmittanceFile) -> dict[str, Any]:
    """Return the problem's tables at the file's rate with the criterion "hands" and, unless the device is a servo,
    with its fixed gains."""
    bounds = problem.problem.bounds
    if not problem.problem.device.kind.senses_force:
        message = '"impedance", and an admittance_controller makes an admittance display; name a problem of one'
        raise InputError.of(problem.source, "other-kind", message, key="device.display")
    document = arm_tables(problem.document)
    if given.rate is not None:
        document["device"] = {**document["device"], "sample_time": 1 / given.rate[1]}
    if not problem.problem.device.kind.own_loop:
        return document
    if not (bounds.velocity.fixed and bounds.position.fixed):
        message = "are not fixed, and a file of ROS 2 has none: fix velocity and position, the loop that follows it"
        raise InputError.of(problem.source, "not-fixed", message, key="gains")
    known = {key: width for key, width in document.pop("uncertainty", {}).items() if key != "unmodelled"}
    document |= {"uncertainty": known} if known else {}
    document["gains"] = {"velocity": bounds.velocity.min, "position": bounds.position.min}
    return document


@np.errstate(all="ignore")
def _checked(
    problem: ProblemFile, tables: dict[str, Any], given: AdmittanceFile, axis: Admittance, progress: Progress
) -> Checked:
    """Check one axis; the result does not contain its name."""
    T = float(tables["device"]["sample_time"])
    looped = problem.problem.device.kind.own_loop
    coupling = coupling_of_admittance(axis, T, servo=not looped)
    if coupling.mass <= 0 or coupling.drag < 0:
        # for a servo, the law without a hand is unstable only if D T > 2 M; the theory does not cover D T from M to 2 M
        grows = looped or axis.damping * T > 2 * axis.mass
        verdict = CheckVerdict.FAILED if grows else CheckVerdict.UNDECIDED
        return _unproved(verdict, "ros-step", _explicit(axis, T, problem.problem.units), axis)
    document = document_of_both(tables, given, axis)
    file = problem_file(toml_text(as_problem(document)), Path(problem.source))
    file = replace(file, problem=followed(file.problem))
    progress(f"proving {axis.axis}")
    judgement = judge(file.problem, *file.problem.fixed_design)
    repairs = repairs_of_axis(document, file.problem, judgement, given.rate, progress)
    if repairs.repairs or repairs.together:
        own, both = (
            [_in_yaml(repair, given, axis) for repair in some or []] for some in (repairs.repairs, repairs.together)
        )
        repairs = repairs._replace(repairs=own, together=both)
    lighter = _lighter_tool(document, judgement, progress)
    finding = finding_of(file, judgement, repairs, [])
    traps = [note.line for note in (*given.notes, *_traps(axis, given.filter_coefficient, file.problem.device))]
    stated = problem.problem.uncertainty
    if looped and stated is not None and stated.unmodelled:
        said = "uncertainty.unmodelled is not covered by this proof, which is one in hands"
        traps.append(Note("ros-unmodelled", said).line)
    finding = replace(finding, warnings=[*traps, *finding.warnings])
    parts, line, verdict = [said_of(judgement)], axis.line, VERDICTS[judgement.status]
    if judgement.status is Status.CERTIFIED:
        parts += in_few_words(*shaken_in_time(judgement.posed.problem, judgement))
    parts += remedy(repairs, {}, f"in {problem.source} ")
    parts += [lighter] if lighter else []
    line = next((given.lines[repair.key] for repair in repairs.repairs or [] if repair.key in given.lines), line)
    first = first_remedy(repairs, f"in {problem.source} ")
    return Checked(Path(), "", verdict, "; ".join(parts), line, finding, remedy=first)


def _explicit(axis: Admittance, T: float, units: Units) -> str:
    if axis.damping * T >= axis.mass:
        left = 1 - axis.joint_damping * T
        if left <= 0:
            return f"stepped explicitly, joint_damping must be below 1/T = {1 / T:.4g}, not {axis.joint_damping:.4g}"
        lightest = f"{units.translated('a mass')} of {_few(axis.damping * T, 4, ROUND_CEILING)} {units.mass}"
        needed, most = (2 * axis.damping_ratio * T / left) ** 2 * axis.stiffness, axis.mass * left / T
        said = (
            f"stepped explicitly, a damping of {axis.damping:.4g} {units.damping} is modelled from {lightest} on, "
            f"not {axis.mass:.4g}"
        )
        ratio = most / (2 * sqrt(axis.mass * axis.stiffness))
        return (
            f"{said}; make it heavier, more than {_few(needed, 4, ROUND_CEILING)} {units.mass} with damping_ratio = "
            f"{axis.damping_ratio:g} kept, or damping_ratio less than {_few(ratio, 3, ROUND_FLOOR)}, or the "
            "sample time shorter"
        )
    least = (axis.stiffness * T / 2 - axis.joint_loss) / (2 * sqrt(axis.mass * axis.stiffness))
    taken = f"S T/2 = {axis.stiffness * T / 2:.4g} {units.damping}"
    return (
        f"stepped explicitly, a stiffness of {axis.stiffness:.4g} {units.stiffness} takes {taken} "
        f"from its damping, which is {axis.damping:.4g}; damping_ratio must be at least {_few(least, 3, ROUND_CEILING)}"
    )


def _few(number: float, digits: int, rounding: str) -> str:
    """Return a limit in few digits, rounded to the side on which what is said suffices."""
    return f"{float(Context(digits, rounding).create_decimal(repr(number))):g}"


def _traps(axis: Admittance, coefficient: float, device: Device) -> list[Note]:
    """Return warnings of common mistakes in a parameter file."""
    found, T = [], device.sample_time
    if axis.damping == 0:
        said = (
            f"stiffness 0 and joint_damping 0 mean no damping at all: D = 2 damping_ratio sqrt(M S) is 0 whatever "
            f"damping_ratio ({axis.damping_ratio:g}) says"
        )
        found.append(Note("ros-no-damping", said))
    elif axis.stiffness == 0 < axis.damping_ratio:
        loss = f"{axis.joint_loss:.4g} {UNITS[device.units].damping}"
        said = (
            f"stiffness 0 leaves damping_ratio ({axis.damping_ratio:g}) without effect: D = 2 damping_ratio sqrt(M S) "
            f"is 0, and joint_damping {axis.joint_damping:g} alone damps, by {loss}"
        )
        found.append(Note("ros-unused-ratio", said))
    if coefficient < 1 and (corner := corner_hz(coefficient, T)) < SLOW / (2 * T):
        said = f"filter_coefficient {coefficient:g} at {1 / T:g} Hz is a low-pass of {corner:.2g} Hz"
        found.append(Note("ros-slow-filter", said))
    return found


def repairs_of_axis(
    document: dict[str, Any], problem: Problem, judgement: Judgement, rate: Rate | None, progress: Progress
) -> Found:
    """Return the changes of one value after which a refuted axis passes; none if the axis needs no change. A rate that
    the parameter file states would contradict another sample time of the problem."""
    if judgement.status is not Status.VIOLATED:
        return Found()
    changes = [*_of_file(document), *parameter_changes(as_problem(document), problem)]
    others = ("coupling", "tool") if "gravity_compensation" in document else ("coupling",)
    own = [each for each in changes if each.path[0] not in others and (rate is None or each.path[-1] != RATE)]
    return find_repairs(document, own, hands_of(judgement), progress, _posed)


def _lighter_tool(document: dict[str, Any], judgement: Judgement, progress: Progress) -> str:
    """Return which tool passes instead of that of a refuted file; "" without a tool or if the axis passes."""
    if judgement.status is not Status.VIOLATED or "gravity_compensation" not in document:
        return ""
    path: KeyPath = tuple(WEIGHT.split("."))
    weight = float(document["gravity_compensation"]["CoG"]["force"])
    change = ParameterChange(path, "a lighter tool", weight, weight * LIGHTEST)
    found = find_repairs(document, [change], hands_of(judgement), progress, _posed).repairs
    if not found or found[0].new is None:
        return f"no lighter tool was found that passes, {WEIGHT} = {weight:g}"
    return f"a tool of at most {found[0].new / GRAVITY:.4g} kg passes, {WEIGHT} = {found[0].new:g}, not {weight:g}"


def _posed(document: dict[str, Any]) -> Problem | None:
    problem, _ = problem_at(as_problem(document), "")
    return problem and followed(problem)


def _in_yaml(repair: Repair, given: AdmittanceFile, axis: Admittance) -> Repair:
    """Return a repair whose line belongs into the parameter file: a list changes every selected axis like this one."""
    if repair.key not in TUNED:
        return repair
    value: Any = repair.new
    if values := given.lists.get(repair.key):
        alike = {other.axis for other in given.axes if replace(other, axis=axis.axis) == axis}
        value = [repair.new if name in alike else old for name, old in zip(AXES, values, strict=True)]
    return repair.model_copy(update={"needs": f"{repair.key}: {value!r}"})


def _of_file(document: dict[str, Any]) -> Iterator[ParameterChange]:
    """Yield the possible changes of the axis that keep its explicit step passive."""
    axis = Admittance(axis="", line=0, **document["admittance"])
    T, coefficient = float(document["device"]["sample_time"]), document["ft_sensor"]["filter_coefficient"]
    yield ParameterChange(("admittance", "mass"), "a heavier axis", axis.mass, HEAVIEST)
    yield ParameterChange(("admittance", "mass"), "a lighter axis", axis.mass, LIGHTEST)
    per_ratio, rate = 2 * sqrt(axis.stiffness / axis.mass), axis.damping / axis.mass
    spare = 1 / T - rate  # at D/M = 1/T the mass M - D T is 0
    if per_ratio > 0:
        most = axis.damping_ratio + spare / per_ratio
        yield ParameterChange(("admittance", "damping_ratio"), "a greater damping ratio", axis.damping_ratio, most)
    path = ("admittance", "joint_damping")
    yield ParameterChange(path, "a greater damping of the joints", axis.joint_damping, axis.joint_damping + spare)
    if coefficient < 1:
        yield ParameterChange(("ft_sensor", "filter_coefficient"), "a faster filter of the force", coefficient, 1.0)
