"""Find repairs of a refuted axis of a ROS 2 parameter file: first changes of the axis, then changes of the problem."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import sqrt
from typing import Any

from vctune.design.ros.admittance_problem import FILTER_AS_CORNER, as_problem
from vctune.design.verdict.judge import Judgement, Status
from vctune.design.verdict.parameter_changes import ParameterChange, parameter_changes
from vctune.design.verdict.repair import Progress, find_repairs
from vctune.document.reading import pose
from vctune.document.records.design_json import Repair
from vctune.document.ros import HEAVIEST, LIGHTEST, TUNED, Admittance
from vctune.model.problem import Problem


def repairs_of_axis(
    document: dict[str, Any], problem: Problem, judgement: Judgement, progress: Progress
) -> list[Repair] | None:
    """Return the changes of one value after which a refuted axis passes; None if the axis needs no change."""
    if judgement.status is not Status.VIOLATED:
        return None
    changes = [*_of_file(document), *parameter_changes(as_problem(document), problem)]
    of_file = FILTER_AS_CORNER if document["ft_sensor"]["filter_coefficient"] < 1 else ""
    own = [each for each in changes if each.path[0] != "coupling" and each.key != f"device.{of_file}"]
    found = find_repairs(document, own, progress, _posed)
    return sorted(map(_in_yaml, found), key=lambda repair: (repair.key not in TUNED, repair.rank))


def remedy(repairs: Sequence[Repair], source: str) -> str:
    """Return the best repair in words."""
    words = [
        f"{place}{', or '.join(map(str, found))} would pass"
        for place, found in (
            ("", [repair for repair in repairs if repair.key in TUNED]),
            (f"in {source} ", [repair for repair in repairs if repair.key not in TUNED]),
        )
        if found
    ]
    return "; ".join(words) or "no change of one number passes"


def _posed(document: dict[str, Any]) -> Problem | None:
    return pose(as_problem(document), "")[0]


def _in_yaml(repair: Repair) -> Repair:
    return repair.model_copy(update={"needs": f"{repair.key}: {repair.new!r}"}) if repair.key in TUNED else repair


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
