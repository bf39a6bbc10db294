"""Read those parameters of a ROS 2 admittance_controller that affect stability."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from math import inf, isfinite, sqrt
from pathlib import Path
from typing import Any

from vctune.document.text import toml
from vctune.document.text.errors import InputError, Mistake, Note

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
WEIGHT = "gravity_compensation.CoG.force"  # Key of the weight of the tool, N
GRAVITY = 9.81  # m/s^2, with which the documentation of the controller computes a weight
TYPE = "admittance_controller/AdmittanceController"  # Type of the controller whose law vctune proves
# Parameters that the controller declares and vctune does not use, and those that every controller has
DECLARED = {
    "": ("joints", "command_joints", "command_interfaces", "state_interfaces", "chainable_command_interfaces",
         "enable_parameter_update_without_reactivation", "robot_description", "type", "update_rate", "use_sim_time",
         "is_async", "fallback_controllers", "params_file", "node_options_args", "qos_overrides"),
    "kinematics": ("plugin_name", "plugin_package", "base", "tip", "alpha", "group_name"),
    "ft_sensor": ("name", "frame", "filter_coefficient"),
    "control": ("frame",),
    "fixed_world_frame": ("frame",),
    "gravity_compensation": ("frame", "CoG"),
    "admittance": ("selected_axes", "mass", "damping_ratio", "stiffness", "joint_damping"),
}  # fmt: skip


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
class Load:
    """The tool whose weight the controller takes off the sensed force. Its inertia stays in it."""

    weight: float  # N, > 0
    place: tuple[float, float, float]  # centre of gravity, m
    turned: bool  # whether its frame is that of the axes

    @property
    def mass(self) -> float:
        """The mass of the tool, kg."""
        return self.weight / GRAVITY

    def inertia(self, axis: str) -> tuple[float, float]:
        """Return the least and the greatest mass of the tool along an axis, kg; about a rotation, its moment of inertia
        as a point, kg m^2, up to that at the greatest distance if the frames differ."""
        if not axis.startswith("r"):
            return self.mass, self.mass
        squares = [x * x for x in self.place]
        if not self.turned:
            return 0.0, self.mass * sum(squares)
        about = self.mass * (sum(squares) - squares["xyz".index(axis[-1])])
        return about, about


@dataclass(frozen=True, slots=True)
class AdmittanceFile:
    """The selected axes of a parameter file."""

    axes: tuple[Admittance, ...]  # selected axes in the order of `AXES`
    filter_coefficient: float  # weight of each new sample in the filter of the force, in (0, 1]
    line: int  # line of the file that selects the axes
    lines: Mapping[str, int]  # lines of the file by the dotted keys of `TUNED`
    name: str = ""  # of the controller, if the file has several
    rate: tuple[str, float, int] | None = None  # key, value, Hz, and line of the stated update_rate
    notes: tuple[Note, ...] = field(default=())  # warnings about the file
    load: Load | None = None  # the tool; None if the file states no weight
    lists: Mapping[str, tuple[float, ...]] = field(default_factory=dict)  # numbers of all of `AXES` by their key


# Message about a controller that does not render a mass with drag
FORWARD_DYNAMICS = (
    "states pd_gains, those of FZI's cartesian_controllers; their law solves a virtual arm's dynamics from rest in "
    "every cycle, has no mass, and acts on the rate of the force; vctune does not prove it; name the parameters of an "
    "admittance_controller"
)


def is_admittance(path: Path) -> bool:
    """Return whether a file has the suffix of a ROS 2 parameter file."""
    return path.suffix.lower() in SUFFIXES


def read_admittances(path: Path) -> list[AdmittanceFile]:
    """Read the parameters of each admittance_controller of a file."""
    source = str(path)
    import yaml

    text = toml.read_text(path)
    try:
        root = yaml.compose(text, yaml.SafeLoader)
        value = _nested(yaml.safe_load(text))
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        message = f"not valid YAML: {getattr(error, 'problem', None) or error}"
        raise InputError.of(source, "not-yaml", message, line=None if mark is None else mark.line + 1) from None
    except (ValueError, RecursionError) as error:
        raise InputError.of(source, "not-yaml", f"not valid YAML: {error or 'nested too deeply'}") from None
    matches = list(_nodes(value, (), "admittance"))
    if not matches and any(_nodes(value, (), "pd_gains")):
        raise InputError.of(source, "ros-other-law", FORWARD_DYNAMICS)
    if not matches:
        message = "states no controller with ros__parameters.admittance; name a file with one"
        raise InputError.of(source, "ambiguous-files", message)
    found = []
    for place, given in matches:
        reader, name = _Reader(source, place, given, root), place[-2] if len(place) > 1 else ""
        manager = _manager(value, name)
        _require_type(reader, manager, name)
        read = reader.read()
        found.append(replace(read, name=name * (len(matches) > 1), rate=_rate(reader, manager)))
    return found


def _nested(value: Any) -> Any:
    """Return tables with dotted names, which are legal, as nested tables."""
    if not isinstance(value, Mapping):
        return value
    made: dict[str, Any] = {}
    for key, entry in value.items():
        *tables, last = str(key).split(".")
        table = made
        for name in tables:
            table = table.setdefault(name, {})
            if not isinstance(table, dict):
                raise ValueError(f"{key} is a table and a value")
        inner = _nested(entry)
        if isinstance(inner, dict) and isinstance(table.get(last), dict):
            table[last] |= inner
        else:
            table[last] = inner
    return made


def _nodes(value: Any, place: tuple[str, ...], table: str) -> Iterator[tuple[tuple[str, ...], Mapping[str, Any]]]:
    """Yield the place and the parameters of every node that states a given parameter."""
    # the limit on the depth has nothing to do with the axes: it ends the search in deeply nested files
    if not isinstance(value, Mapping) or len(place) > len(AXES):
        return
    for key, entry in value.items():
        if key == "ros__parameters" and isinstance(entry, Mapping) and table in entry:
            yield (*place, str(key)), entry
        else:
            yield from _nodes(entry, (*place, str(key)), table)


def _manager(value: Any, name: str) -> tuple[tuple[str, ...], Mapping[str, Any]] | None:
    """Return the place and the parameters of the controller_manager that runs a controller; None if there is none."""
    running = [(place, given) for place, given in _nodes(value, (), name) if isinstance(given[name], Mapping)]
    for place, given in _nodes(value, (), "update_rate"):
        if place[-2:-1] and place[-2].rpartition("/")[2] == "controller_manager":  # in any namespace
            running.append((place, given))
    return next(iter(running), None)


def _require_type(reader: _Reader, manager: tuple[tuple[str, ...], Mapping[str, Any]] | None, name: str) -> None:
    """Refuse a controller of another type, which may be another law under the same parameters."""
    place, given = manager or ((), {})
    of_manager = given.get(name)
    stated = [((*place, name, "type"), of_manager.get("type"))] if isinstance(of_manager, Mapping) else []
    for key, value in [*stated, ((*reader.place, "type"), reader.given.get("type"))]:
        if value is not None and value != TYPE:
            message = f"is {str(value)[:80]}; vctune proves the law of {TYPE} only"
            raise InputError(reader.source, [Mistake("ros-other-law", ".".join(key), message, reader.line_of(key))])


def _rate(reader: _Reader, manager: tuple[tuple[str, ...], Mapping[str, Any]] | None) -> tuple[str, float, int] | None:
    """Return key, value and line of the update_rate of a controller, else of its controller_manager."""
    for place, given in ((reader.place, reader.given), *([manager] if manager else [])):
        value = given.get("update_rate", 0)
        if _is_number(value) and value > 0:
            key = (*place, "update_rate")
            return ".".join(key), float(value), reader.line_of(key) or 1
    return None


class _Reader:
    """Reads the parameters of one controller and collects their faults."""

    def __init__(self, source: str, place: tuple[str, ...], given: Mapping[str, Any], root: Any) -> None:
        self.source, self.place, self.given, self._root = source, place, given, root
        self._mistakes: list[Mistake] = []
        self._notes: list[Note] = []

    def read(self) -> AdmittanceFile:
        """Return the content of the file."""
        selected = self._list("selected_axes", flags=True)
        masses = self._list("mass", least=LIGHTEST, most=HEAVIEST)
        ratios, stiffnesses = self._list("damping_ratio"), self._list("stiffness", most=STIFFEST)
        joint = self._number("admittance", "joint_damping", JOINT_DAMPING, most=1e6)
        coefficient = self._number("ft_sensor", "filter_coefficient", COEFFICIENT, most=1.0)
        if coefficient == 0:
            self._wrong("ft_sensor.filter_coefficient", "is 0: no force ever comes through; at most 1 is no filter")
        load = self._load()
        if self._mistakes:
            raise InputError(self.source, self._mistakes)
        line, selection = (self._line(f"admittance.{name}") or 1 for name in ("mass", "selected_axes"))
        axes = (
            Admittance(axis, mass, ratio, stiffness, joint, line)
            for axis, chosen, mass, ratio, stiffness in zip(AXES, selected, masses, ratios, stiffnesses, strict=True)
            if chosen
        )
        lines = {key: self._line(key) or 1 for key in (*TUNED, WEIGHT)}
        self._note_unknown()
        lists = {"admittance.mass": tuple(masses), "admittance.damping_ratio": tuple(ratios)}
        notes = tuple(self._notes)
        return AdmittanceFile(tuple(axes), coefficient, selection, lines, notes=notes, load=load, lists=lists)

    def _load(self) -> Load | None:
        """Return the tool; None without a weight."""
        known, control = self._table("gravity_compensation"), self._table("control")
        centre = known.get("CoG", {})
        if not isinstance(centre, Mapping):
            self._wrong("gravity_compensation.CoG", f"is {_shown(centre)}: must be a table")
            return None
        weight, place = centre.get("force", 0.0), centre.get("pos", [0.0, 0.0, 0.0])
        if not (_is_number(weight) and 0 <= weight <= HEAVIEST):
            self._wrong(WEIGHT, f"is {_shown(weight)}: must be the weight of the tool, N, from 0 to {HEAVIEST:g}")
            return None
        if not (isinstance(place, list) and len(place) == 3 and all(map(_is_number, place))):
            self._wrong("gravity_compensation.CoG.pos", f"is {_shown(place)}: must be three numbers, m")
            return None
        frames = [table.get("frame") for table in (known, control)]
        x, y, z = map(float, place)
        return Load(float(weight), (x, y, z), frames[0] == frames[1]) if weight > 0 else None

    def _note_unknown(self) -> None:
        """Warn of keys that the controller ignores, since it does not declare them."""
        tables = {name: self.given.get(name) for name in DECLARED if name} | {"": self.given}
        keys = [(name, key) for name, table in tables.items() if isinstance(table, Mapping) for key in table]
        for table, key in keys:
            known = [*DECLARED[table], *(filter(None, DECLARED) if table == "" else ())]
            if str(key) in known:
                continue
            whole, near = f"{table}.{key}".lstrip("."), get_close_matches(str(key), known, n=1)
            hint = f"; did you mean {near[0]}?" if near else ""
            self._notes.append(
                Note("ros-unknown-key", f"line {self._line(whole)}: {whole}: the controller ignores it{hint}")
            )

    def _list(self, name: str, *, least: float = 0.0, most: float = inf, flags: bool = False) -> list[Any]:
        """Return one value for each axis. Record a fault for a list of another length, or for each invalid value."""
        key, values = f"admittance.{name}", self._table("admittance").get(name)
        kind = "true or false" if flags else "numbers"
        if not isinstance(values, list) or len(values) != len(AXES):
            others = [str(other) for other in self._table("admittance") if str(other) not in DECLARED["admittance"]]
            near = get_close_matches(name, others, n=1) if values is None else []
            hint = f"; did you mean it by {near[0]}?" if near else ""
            said = f"must be a list of {len(AXES)} {kind}, of {', '.join(AXES)}; it is {_shown(values)}{hint}"
            self._wrong(key, said)
            return [0.0] * len(AXES)
        for axis, element in zip(AXES, values, strict=True):
            if flags and not isinstance(element, bool):
                self._wrong(key, f"of {axis} is {_shown(element)}: must be true or false")
            elif not flags and not (_is_number(element) and least <= element <= most):
                limit = f" and at most {most:g}" if most < inf else ""
                self._wrong(key, f"of {axis} is {_shown(element)}: must be a number of at least {least:g}{limit}")
        if not flags and all(isinstance(element, int) for element in values):
            said = f"line {self._line(key)}: {key} is a list of integers, which ROS 2 refuses; write {values[0]}.0, ..."
            self._notes.append(Note("ros-integers", said))
        return [element if flags or not _is_number(element) else float(element) for element in values]

    def _number(self, table: str, name: str, default: float, most: float) -> float:
        """Return a number, or its default if it is absent or invalid; record a fault if it is invalid."""
        value = self._table(table).get(name, default)
        if not (_is_number(value) and 0 <= value <= most):
            self._wrong(f"{table}.{name}", f"is {_shown(value)}: must be a number from 0 to {most:g}")
            return default
        return float(value)

    def _table(self, name: str) -> Mapping[str, Any]:
        table = self.given.get(name)
        if table is None:
            return {}
        if isinstance(table, Mapping):
            return table
        self._wrong(name, f"is {_shown(table)}: must be a table")
        return {}

    def _wrong(self, key: str, message: str) -> None:
        self._mistakes.append(Mistake("ros-parameter", ".".join([*self.place, key]), message, self._line(key)))

    def _line(self, key: str) -> int | None:
        return self.line_of((*self.place, *key.split(".")))

    def line_of(self, path: tuple[str, ...]) -> int | None:
        """Return the line of a key or, if it is absent, of the nearest table above it. Names may be dotted."""
        node, line, steps = self._root, None, list(path)
        while steps:
            pairs = node.value if hasattr(node, "value") and isinstance(node.value, list) else []
            named = [(str(name.value).split("."), name, entry) for name, entry in pairs if hasattr(name, "value")]
            match = next((each for each in named if steps[: len(each[0])] == each[0]), None)
            if match is None:
                return line
            line, node, steps = match[1].start_mark.line + 1, match[2], steps[len(match[0]) :]
        return line


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)


def _shown(value: Any) -> str:
    return "missing" if value is None else repr(value)[:60]
