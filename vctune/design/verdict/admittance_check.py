"""A ROS 2 admittance in the place of the coupling: is it stable in every hand of the box, and what would help?

The controller steps M dv/dt + D v + S x = f explicitly: (M/T) (v - v_before) + D v_before + S x_before = f. That is a
mass M - D T by backward Euler, a drag D - S T/2 and a lossless spring S: the first is the coupling of the trapezoidal
rule with b_c = 2 (M - D T)/T and m_c = M - D T, and what is proved of it holds on every passive environment, the spring
among them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from math import exp, log, pi, sqrt
from pathlib import Path
from typing import Any

from vctune.design.verdict.gains_check import Checked, CheckVerdict, DesignFinding, check_problem
from vctune.document.reading import ProblemFile, problem_file
from vctune.document.ros import Admittance, AdmittanceFile
from vctune.document.text.codes import Code, Note
from vctune.document.text.errors import InputError
from vctune.document.text.toml_writing import toml_text
from vctune.model.device import Device
from vctune.model.experiment import Environment, Experiment, Operator, Sensors
from vctune.model.gains import Coupling, series_coupling
from vctune.model.hands import Hand
from vctune.model.numbers.units import UNITS, Units, UnitSystem
from vctune.simulation.mechanics.scene_stability import Mode, fastest_mode
from vctune.simulation.scene import designed_scene

SLOW = 0.1
"""A filter whose corner is below this share of the Nyquist frequency is named. Half names none of the usual 0.05 at 500
Hz and less, twice names some that a hand cannot tell from none."""


def check_admittance(
    problem: ProblemFile, path: Path, given: AdmittanceFile, only: Sequence[str] = ()
) -> list[Checked]:
    """Check the selected axes of a parameter file, those with the same numbers once.

    Parameters
    ----------
    problem : the device, with its velocity loop: the gains are fixed
    path : of the parameter file
    given : its selected axes
    only : names of the axes to check; empty for all

    Returns
    -------
    list of Checked
        One for each axis, in the file's order. An axis that does not move as the device does, a rotation or a
        translation, is undecided: it is not looked at.

    Raises
    ------
    InputError
        If the problem is an impedance display, lacks gains, or has a filter of its own; if `only` names an axis that
        the file does not select, or that does not move as the device does; or if no axis does.
    """
    document, axes = _device(problem, given), _chosen(problem, path, given, only)
    fitting = " ".join(f"--axis {axis.axis}" for axis in axes if _moves_as(axis, problem))
    checks: list[Checked] = []
    proved: dict[Admittance, Checked] = {}
    for axis in axes:
        if not _moves_as(axis, problem):
            message = f"not looked at: {_misfit([axis], problem)}, or leave it out by {fitting}"
            checks.append(
                _of_axis(_unproved(CheckVerdict.UNDECIDED, "ros-rotation", message, axis), problem, path, axis)
            )
            continue
        numbers = replace(axis, axis="")
        if numbers not in proved:
            proved[numbers] = _checked(problem, document, axis, given.filter_coefficient)
        checks.append(_of_axis(proved[numbers], problem, path, axis))
    return checks


def _chosen(problem: ProblemFile, path: Path, given: AdmittanceFile, only: Sequence[str]) -> list[Admittance]:
    """Return the axes to look at and those to name as not looked at."""
    selected = [axis.axis for axis in given.axes]
    if unknown := [name for name in only if name not in selected]:
        message = f"selects {', '.join(selected)}, and --axis asks for {', '.join(unknown)}; name axes that it selects"
        raise InputError.of(str(path), "contradiction", message, key="admittance.selected_axes", line=given.line)
    axes = [axis for axis in given.axes if not only or axis.axis in only]
    others = [axis for axis in axes if not _moves_as(axis, problem)]
    if others and (only or len(others) == len(axes)):
        message = f"{', '.join(axis.axis for axis in others)} cannot be looked at: {_misfit(others, problem)}"
        raise InputError.of(str(path), "ros-rotation", message, key="admittance.selected_axes", line=given.line)
    return axes


def _moves_as(axis: Admittance, problem: ProblemFile) -> bool:
    return axis.turns == (problem.problem.device.units == "rotary")


def _misfit(axes: list[Admittance], problem: ProblemFile) -> str:
    """Return why axes cannot be looked at with this problem."""
    own = problem.problem.device.units
    other: UnitSystem = "linear" if own == "rotary" else "rotary"
    moves = "rotations" if other == "rotary" else "translations"
    units = UNITS[other]
    return (
        f"{moves if len(axes) > 1 else f'a {moves[:-1]}'}, and {problem.source} has a {own} device (device.units); "
        f"check with a problem of a {other} one, in {units.mass} and {units.damping}"
    )


def _unproved(verdict: CheckVerdict, code: Code, message: str, axis: Admittance) -> Checked:
    """Return a check that ends before there is anything to judge."""
    return Checked(Path(), "", verdict, Note(code, message).line, axis.line, None)


def _of_axis(checked: Checked, problem: ProblemFile, path: Path, axis: Admittance) -> Checked:
    """Return a check as that of an axis with the same numbers."""
    name, message, finding = f"{problem.problem.name} {axis.axis}", f"{axis.axis}: {checked.message}", checked.finding
    if isinstance(finding, DesignFinding):
        named = replace(finding.file, problem=replace(finding.file.problem, name=name))
        finding = replace(finding, file=named)
    else:
        message = f"{path}: {message}"
    return replace(checked, source=path, name=name, message=message, line=axis.line, finding=finding)


def _device(problem: ProblemFile, given: AdmittanceFile) -> dict[str, Any]:
    """Return the problem's tables with the file's filter as force sensor and the criterion of hands."""
    bounds, sensor = problem.problem.bounds, problem.problem.device.force_sensor
    if not problem.problem.device.kind.senses_force:
        message = '"impedance", and an admittance_controller makes an admittance display; name a problem of one'
        raise InputError.of(problem.source, "other-kind", message, key="device.display")
    if not (bounds.velocity.fixed and bounds.position.fixed):
        message = "are not fixed, and a file of ROS 2 has none: fix velocity and position, the loop that follows it"
        raise InputError.of(problem.source, "not-fixed", message, key="gains")
    if sensor is not None and sensor.bandwidth_hz is not None and given.filter_coefficient < 1:
        message = "stands in the place of filter_coefficient: leave one of them out, or set filter_coefficient to 1"
        raise InputError.of(problem.source, "contradiction", message, key="device.force_sensor.bandwidth_hz")
    document = {key: value for key, value in problem.document.items() if key not in ("experiment", "uncertainty")}
    document["stability"] = {**document.get("stability", {}), "criterion": "hands"}
    document["gains"] = {"velocity": bounds.velocity.min, "position": bounds.position.min}
    if given.filter_coefficient < 1:
        corner = corner_hz(given.filter_coefficient, problem.problem.device.sample_time)
        stated = document["device"].get("force_sensor", {})
        document["device"] = {**document["device"], "force_sensor": {**stated, "bandwidth_hz": corner}}
    return document


def corner_hz(coefficient: float, sample_time: float) -> float:
    """Return the corner of the filter y += coefficient (x - y), Hz.

    Parameters
    ----------
    coefficient : in (0, 1)
    sample_time : T, s
    """
    return -log(1 - coefficient) / (2 * pi * sample_time)


def coupling_of_admittance(axis: Admittance, sample_time: float) -> Coupling:
    """Return the coupling that is an admittance, its lossless spring apart, as the controller steps it.

    Parameters
    ----------
    axis : what is rendered
    sample_time : T, s

    Returns
    -------
    Coupling
        With mass or drag below 0 where the explicit step is not passive.
    """
    mass = axis.mass - axis.damping * sample_time
    return Coupling(2 * mass / sample_time, mass, axis.damping - axis.stiffness * sample_time / 2)


def _checked(problem: ProblemFile, document: dict[str, Any], axis: Admittance, coefficient: float) -> Checked:
    """Check an axis; its name does not count."""
    T = problem.problem.device.sample_time
    coupling = coupling_of_admittance(axis, T)
    if coupling.mass <= 0 or coupling.drag < 0:
        return _unproved(CheckVerdict.FAILED, "ros-step", _explicit(axis, T, problem.problem.units), axis)
    file = _pasted(document, coupling, problem)
    checked = check_problem(file)
    finding = checked.finding
    assert isinstance(finding, DesignFinding), "a problem whose numbers are fixed is judged"
    told = [*(note.line for note in _traps(axis, coefficient, problem.problem.device)), *finding.warnings]
    parts = [checked.message]
    if checked.verdict is not CheckVerdict.PASSED:
        parts += [_with_its_spring(file, axis, finding), *_in_its_words(document, axis, finding, problem)]
    return replace(checked, message="; ".join(parts), finding=replace(finding, warnings=told))


def _pasted(document: dict[str, Any], coupling: Coupling, problem: ProblemFile) -> ProblemFile:
    numbers = {"damping": coupling.damping, "mass": coupling.mass, "drag": coupling.drag}
    return problem_file(toml_text({**document, "coupling": numbers}), Path(problem.source))


def _explicit(axis: Admittance, T: float, units: Units) -> str:
    if axis.damping * T >= axis.mass:
        left = 1 - axis.joint_damping * T
        if left <= 0:
            return f"stepped explicitly, joint_damping must be below 1/T = {1 / T:.4g}, not {axis.joint_damping:.4g}"
        needed = (2 * axis.damping_ratio * T / left) ** 2 * axis.stiffness
        return (
            f"stepped explicitly, a damping of {axis.damping:.4g} {units.damping} needs {units.translated('a mass')} "
            f"of more than {needed:.4g} {units.mass}, not {axis.mass:.4g}; "
            "make it heavier, or damping_ratio or sample time smaller"
        )
    least = (axis.stiffness * T / 2 - axis.joint_loss) / (2 * sqrt(axis.mass * axis.stiffness))
    taken = f"S T/2 = {axis.stiffness * T / 2:.4g} {units.damping}"
    return (
        f"stepped explicitly, a stiffness of {axis.stiffness:.4g} {units.stiffness} takes {taken} "
        f"from its damping, which is {axis.damping:.4g}; damping_ratio must be at least {least:.3g}"
    )


def _traps(axis: Admittance, coefficient: float, device: Device) -> list[Note]:
    """Return what is easily overlooked in such a file."""
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


def _with_its_spring(file: ProblemFile, axis: Admittance, finding: DesignFinding) -> str:
    """Return whether it is with the file's own stiffness that it grows."""
    hands = file.problem.hands_met
    assert hands is not None, "the criterion is that of hands"
    held = finding.judgement.in_hand
    corners = [Hand(*numbers) for numbers in product(*zip(_numbers(hands.low), _numbers(hands.high), strict=True))]
    tried = [*corners, *([held.hand] if held is not None else [])]
    hand, worst = max(((hand, _mode(file, axis, finding, hand)) for hand in tried), key=lambda pair: pair[1].radius)
    units = file.problem.units
    own = f"with its own stiffness of {axis.stiffness:g} {units.stiffness}"
    if worst.radius < 1:
        return f"{own} alone it does not grow in the corners of the box: another passive environment makes it"
    return f"{own} it grows at {worst.hz:.4g} Hz in the hand of {hand.in_words(units)}"


def _numbers(hand: Hand) -> tuple[float, float, float]:
    return hand.mass, hand.damping, hand.stiffness


def _mode(file: ProblemFile, axis: Admittance, finding: DesignFinding, hand: Hand) -> Mode:
    spring = Environment(0.0, 0.0, axis.stiffness, 0.0, False, "trapezoid")
    operator = Operator("sine", 0.0, 0.01, 0.05, 1, *_numbers(hand))
    experiment = Experiment(axis.axis, spring, operator, None, Sensors(0.0, 0.0, 0), None, None)
    judged = finding.judgement
    return fastest_mode(designed_scene(file.problem.device, judged.gains, series_coupling(judged.coupling), experiment))


def _in_its_words(
    document: dict[str, Any], axis: Admittance, finding: DesignFinding, problem: ProblemFile
) -> list[str]:
    """Return the repairs that the file itself can make, each proved again as the file would state it."""
    T, found = problem.problem.device.sample_time, []
    for repair in finding.repairs or []:
        if repair.key == "coupling.drag" and repair.new is not None:
            better, said = _with_drag(axis, repair.new, T)
            coupling = coupling_of_admittance(better, T)
            if coupling.mass > 0 and check_problem(_pasted(document, coupling, problem)).verdict is CheckVerdict.PASSED:
                found.append(f"in the file's words: {said}")
        if repair.key == "device.force_sensor.bandwidth_hz" and repair.new is not None:
            found.append(f"in the file's words: filter_coefficient {1 - exp(-2 * pi * repair.new * T):.4g}")
    return found


def _with_drag(axis: Admittance, drag: float, T: float) -> tuple[Admittance, str]:
    """Return the axis with a hundredth more than a drag, by the parameter that damps it, and what to change."""
    lost = axis.stiffness * T / 2
    if axis.stiffness == 0:
        rate = float(f"{1.01 * drag / axis.mass:.4g}")
        return replace(axis, joint_damping=rate), f"joint_damping {rate:g} instead of {axis.joint_damping:g}"
    free = 1.01 * (drag + lost - axis.joint_loss)
    ratio = float(f"{free / (2 * sqrt(axis.mass * axis.stiffness)):.4g}")
    return replace(axis, damping_ratio=ratio), f"damping_ratio {ratio:g} instead of {axis.damping_ratio:g}"
