"""Read those parameters of a ROS 2 admittance_controller that affect stability."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import inf, isfinite, sqrt
from pathlib import Path
from typing import Any

from vctune.document.text import toml
from vctune.document.text.errors import InputError, Mistake

# Axes in the order of the lists of the file: three translations, then three rotations
AXES = ("x", "y", "z", "rx", "ry", "rz")
COEFFICIENT, JOINT_DAMPING = 0.05, 5.0  # Default values of filter_coefficient and joint_damping in the controller
# Least mass, greatest mass and greatest stiffness that the controller accepts
LIGHTEST, HEAVIEST, STIFFEST = 1e-4, 1e6, 1e8
SUFFIXES = (".yaml", ".yml")
# Keys of the numbers that a user tunes for stability
TUNED = (
    "admittance.mass",
    "admittance.damping_ratio",
    "admittance.joint_damping",
    "ft_sensor.filter_coefficient",
)


@dataclass(frozen=True, slots=True)
class Admittance:
    """The admittance that the controller renders on one axis."""

    axis: str  # name of the axis, one of `AXES`
    mass: float  # M, kg; for a rotation kg m^2
    damping_ratio: float  # zeta, dimensionless
    stiffness: float  # S, N/m; for a rotation N m/rad
    joint_damping: float  # rate at which each joint loses velocity in addition to D, 1/s
    line: int  # line of the file that states the masses

    @property
    def turns(self) -> bool:
        """Whether the axis is a rotation."""
        return self.axis.startswith("r")

    @property
    def damping(self) -> float:
        """D = 2 zeta sqrt(M S) plus the effect of joint_damping, N s/m; for a rotation N m s/rad."""
        return 2 * self.damping_ratio * sqrt(self.mass * self.stiffness) + self.joint_loss

    @property
    def joint_loss(self) -> float:
        """The damping due to joint_damping, N s/m; for a rotation N m s/rad. joint_damping acts as an acceleration on
        every joint, and thus on the tool."""
        return self.joint_damping * self.mass


@dataclass(frozen=True, slots=True)
class AdmittanceFile:
    """The selected axes of a parameter file."""

    axes: tuple[Admittance, ...]  # selected axes in the order of `AXES`, at least one
    filter_coefficient: float  # weight of each new sample in the filter of the force, in (0, 1]
    line: int  # line of the file that selects the axes
    lines: Mapping[str, int]  # lines of the file by the dotted keys of `TUNED`


# Message about a controller that does not render a mass with drag
FORWARD_DYNAMICS = (
    "states pd_gains, those of FZI's cartesian_controllers; their law solves a virtual arm's dynamics from rest in "
    "every cycle, has no mass, and acts on the rate of the force; vctune does not prove it; name the parameters of an "
    "admittance_controller"
)


def is_admittance(path: Path) -> bool:
    """Return whether a file has the suffix of a ROS 2 parameter file."""
    return path.suffix.lower() in SUFFIXES


def read_admittance(path: Path) -> AdmittanceFile:
    """Read the parameter file of one admittance_controller."""
    source = str(path)
    try:
        import yaml
    except ImportError:
        raise InputError.of(source, "missing-package", "reading YAML needs PyYAML: pip install pyyaml") from None
    text = toml.read_text(path)
    try:
        root = yaml.compose(text, yaml.SafeLoader)
        value = yaml.safe_load(text)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        message = f"not valid YAML: {getattr(error, 'problem', None) or error}"
        raise InputError.of(source, "not-yaml", message, line=None if mark is None else mark.line + 1) from None
    except (ValueError, RecursionError) as error:
        raise InputError.of(source, "not-yaml", f"not valid YAML: {error or 'nested too deeply'}") from None
    matches = list(_controllers(value, ()))
    if not matches and any(_controllers(value, (), "pd_gains")):
        raise InputError.of(source, "ros-other-law", FORWARD_DYNAMICS)
    if len(matches) != 1:
        known = ", ".join(".".join(place) for place, _ in matches)
        message = f"states {len(matches)} controllers with ros__parameters.admittance{f' ({known})' if known else ''}"
        raise InputError.of(source, "ambiguous-files", f"{message}; name a file with one")
    return _Reader(source, *matches[0], root).read()


def _controllers(
    value: Any, place: tuple[str, ...], table: str = "admittance"
) -> Iterator[tuple[tuple[str, ...], Mapping[str, Any]]]:
    """Yield the place and the parameters of every controller that states a given table."""
    # the limit on the depth has nothing to do with the axes: it ends the search in deeply nested files
    if not isinstance(value, Mapping) or len(place) > len(AXES):
        return
    for key, entry in value.items():
        if key == "ros__parameters" and isinstance(entry, Mapping) and table in entry:
            yield (*place, str(key)), entry
        else:
            yield from _controllers(entry, (*place, str(key)), table)


class _Reader:
    """Reads the parameters of one controller and collects their faults."""

    def __init__(self, source: str, place: tuple[str, ...], given: Mapping[str, Any], root: Any) -> None:
        self._source, self._place, self._given, self._root = source, place, given, root
        self._mistakes: list[Mistake] = []

    def read(self) -> AdmittanceFile:
        """Return the content of the file."""
        selected = self._list("selected_axes", flags=True)
        masses = self._list("mass", least=LIGHTEST, most=HEAVIEST)
        ratios, stiffnesses = self._list("damping_ratio"), self._list("stiffness", most=STIFFEST)
        joint = self._number("admittance", "joint_damping", JOINT_DAMPING, most=1e6)
        coefficient = self._number("ft_sensor", "filter_coefficient", COEFFICIENT, most=1.0)
        if coefficient == 0:
            self._wrong("ft_sensor.filter_coefficient", "is 0: no force ever comes through; at most 1 is no filter")
        if not self._mistakes and not any(selected):
            self._wrong("admittance.selected_axes", "selects no axis: there is nothing to check")
        if self._mistakes:
            raise InputError(self._source, self._mistakes)
        line, selection = (self._line(f"admittance.{name}") or 1 for name in ("mass", "selected_axes"))
        axes = (
            Admittance(axis, mass, ratio, stiffness, joint, line)
            for axis, chosen, mass, ratio, stiffness in zip(AXES, selected, masses, ratios, stiffnesses, strict=True)
            if chosen
        )
        lines = {key: self._line(key) or 1 for key in TUNED}
        return AdmittanceFile(tuple(axes), coefficient, selection, lines)

    def _list(self, name: str, *, least: float = 0.0, most: float = inf, flags: bool = False) -> list[Any]:
        """Return one value for each axis. Record a fault for a list of another length, or for each invalid value."""
        key, values = f"admittance.{name}", self._table("admittance").get(name)
        kind = "true or false" if flags else "numbers"
        if not isinstance(values, list) or len(values) != len(AXES):
            self._wrong(key, f"must be a list of {len(AXES)} {kind}, of {', '.join(AXES)}; it is {_shown(values)}")
            return [0.0] * len(AXES)
        for axis, element in zip(AXES, values, strict=True):
            if flags and not isinstance(element, bool):
                self._wrong(key, f"of {axis} is {_shown(element)}: must be true or false")
            elif not flags and not (_is_number(element) and least <= element <= most):
                limit = f" and at most {most:g}" if most < inf else ""
                self._wrong(key, f"of {axis} is {_shown(element)}: must be a number of at least {least:g}{limit}")
        return [element if flags or not _is_number(element) else float(element) for element in values]

    def _number(self, table: str, name: str, default: float, most: float) -> float:
        """Return a number, or its default if it is absent or invalid; record a fault if it is invalid."""
        value = self._table(table).get(name, default)
        if not (_is_number(value) and 0 <= value <= most):
            self._wrong(f"{table}.{name}", f"is {_shown(value)}: must be a number from 0 to {most:g}")
            return default
        return float(value)

    def _table(self, name: str) -> Mapping[str, Any]:
        table = self._given.get(name, {})
        if isinstance(table, Mapping):
            return table
        self._wrong(name, f"is {_shown(table)}: must be a table")
        return {}

    def _wrong(self, key: str, message: str) -> None:
        self._mistakes.append(Mistake("ros-parameter", ".".join([*self._place, key]), message, self._line(key)))

    def _line(self, key: str) -> int | None:
        """Return the line of a key or, if it is absent, of the nearest table above it."""
        node, line = self._root, None
        for step in (*self._place, *key.split(".")):
            pairs = node.value if hasattr(node, "value") and isinstance(node.value, list) else []
            matches = [(name, entry) for name, entry in pairs if str(name.value) == step]
            if not matches:
                return line
            line, node = matches[0][0].start_mark.line + 1, matches[0][1]
        return line


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)


def _shown(value: Any) -> str:
    return "missing" if value is None else repr(value)[:60]
