"""Define the changes of one value of a problem file that a repair may make."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal
from math import inf, pi
from typing import Any

from vctune.document.schema.rules import FASTEST
from vctune.document.schema.validation import KeyPath, dotted
from vctune.document.text.toml import number_at, placed
from vctune.model.numbers.units import KEYS, SPRING_KEYS
from vctune.model.parts import PART_NUMBERS
from vctune.model.problem import Problem

# Steps that the search tries before the limit, relative to the smaller of the old and the new value, or to the natural
# size if the old value is 0
STEPS = (0.03, 0.1, 0.3, 0.7, 1.5, 3.0, 6.0, 12.0, 30.0, 100.0, 300.0)
STEPS_FROM_ZERO = (1e-4, 1e-3, 1e-2, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0)
ROUNDING = 0.02  # Greatest share of a change, or of the value, by which rounding to few digits may enlarge the change
FURTHEST = 1e3  # Greatest factor by which the search changes a value
DIGITS = 12  # Greatest number of significant digits of a new value
SLIGHT = 0.1  # Share of the limit by which a value may be beyond it and is meant to be the limit
OTHER_END: dict[str | int, str | int] = {0: 1, 1: 0, "min": "max", "max": "min"}
ASSUMED = (
    "operator",
    "tool",
    "environment",
    "stability",
)  # Tables that state what is assumed of the world and asked for

CHOSEN = ("gains", "coupling", "admittance", "ft_sensor")  # Tables of what a design, or a ROS 2 file, chooses


@dataclass(frozen=True, slots=True)
class ParameterChange:
    """A value of a problem file that may change in one direction."""

    path: KeyPath  # place of the value in the file
    meaning: str  # meaning of the change, in words
    old: float  # the value in the file, or the default
    limit: float  # the furthest value to try, above or below `old`
    scale: float = 1.0  # natural size of the value, used if `old` is 0 or infinite
    other: float | None = None  # the other edge of the band, or the other end of the range
    switch: bool = False  # whether the value is a switch, which the change turns from true (1) to false (0)

    @property
    def key(self) -> str:
        """The dotted key."""
        return dotted(self.path)

    @property
    def assumes(self) -> bool:
        """Whether the change is one of what is assumed or asked for, not of the design or the device."""
        return self.path[0] in ASSUMED

    @property
    def chooses(self) -> bool:
        """Whether the change is one of the gains or the coupling, which are free to choose."""
        return self.path[0] in CHOSEN

    @property
    def eases(self) -> bool:
        """Whether a larger change only relaxes constraints or permits more designs: fewer hands, a narrower band, wider
        bounds."""
        if self.path[0] == "tool":
            return self.path[-1] == "max"
        if self.path[0] in ("operator", "environment"):
            return self.path[-1] != "max" or self.limit < self.old
        return self.path[0] == "stability" or self.path[-1] in ("min", "max")

    def relative(self, new: float) -> float:
        """Return the relative change to a new value; inf for a change to 0."""
        if self.old in (0, inf):
            return new / self.scale if self.old == 0 else self.scale / new
        return abs(new - self.old) / min(new, self.old) if new > 0 else inf

    def size(self, new: float) -> float:
        """Return the size r/(1 + r) of a relative change r, to compare changes of different values."""
        relative = self.relative(new)
        return relative / (1 + relative) if relative < inf else 1.0

    def steps(self, solved: Mapping[str, float]) -> Iterator[tuple[float, float]]:
        """Yield relative changes with their new values, up to the limit; a solved value of the key, however far, is
        among them."""
        known = solved.get(self.key)
        if known is not None and known != self.old and (known > self.old) == (self.limit > self.old):
            yield self.relative(known), known
        last = self.relative(self.limit)
        for step in () if self.switch else STEPS_FROM_ZERO if self.old == 0 else STEPS:
            if step < last:
                yield step, self.at(step)
        yield last, self.limit

    def between(self, first: float, second: float) -> float:
        """Return a value between two, by their factor if there is one."""
        if inf in (first, second):
            return 4 * min(first, second)
        return (first * second) ** 0.5 if first > 0 and second > 0 else 0.5 * (first + second)

    def at(self, relative: float) -> float:
        """Return the value at a relative change."""
        if self.old in (0, inf):
            return self.scale * relative if self.old == 0 else self.scale / relative
        return self.old * (1 + relative) if self.limit > self.old else self.old / (1 + relative)

    def rounded(self, exact: float) -> float:
        """Return a new value, rounded away from the old one to as few digits as possible, and not beyond the limit;
        one that is far beyond it, as a solved value may be, stays as it is."""
        upwards, close = self.limit > self.old, ROUNDING * min(abs(exact - self.old), exact)
        if (exact >= self.limit) if upwards else (exact <= self.limit):
            return self.limit if abs(exact - self.limit) <= SLIGHT * self.limit else exact
        for digits in range(1, DIGITS):
            new = _digits(exact, digits, ROUND_CEILING if upwards else ROUND_FLOOR)
            if abs(new - exact) <= close and ((new <= self.limit) if upwards else (new >= self.limit)):
                return new
        return exact

    def line(self, new: float) -> str:
        """Return the new line of TOML after the change."""
        if self.switch:
            return f"{self.key} = false"
        if self.other is None:
            return f"{self.key} = {new!r}"
        low, high = sorted((new, self.other))
        form = f"[{low!r}, {high!r}]" if isinstance(self.path[-1], int) else f"{{ min = {low!r}, max = {high!r} }}"
        return f"{dotted(self.path[:-1])} = {form}"

    def applied(self, document: dict[str, Any], new: float) -> dict[str, Any]:
        """Return the document with the value changed."""
        if self.switch:
            return placed(document, ((self.path, False),))
        beside = () if self.other is None else (((*self.path[:-1], OTHER_END[self.path[-1]]), self.other),)
        return placed(document, (*beside, (self.path, new)))


def _digits(value: float, digits: int, rounding: str) -> float:
    return float(Context(prec=digits, rounding=rounding).create_decimal(Decimal(value)))


def parameter_changes(document: dict[str, Any], problem: Problem) -> Iterator[ParameterChange]:
    """Yield the possible changes of a problem: of the device, of the constraints, and of the bounds or gains in the
    file."""
    yield from _of_device(problem)
    yield from _of_operator(problem)
    yield from _of_band(document, problem) if problem.passive else ()
    yield from _of_worlds(problem)
    stability = problem.stability
    most, factor = stability.max_sensitivity, stability.safety_factor
    if problem.device.kind.own_loop:
        yield ParameterChange(("stability", "max_sensitivity"), "a greater |S|", most, 10 * most)
    if factor > 1:
        yield ParameterChange(("stability", "safety_factor"), "a smaller safety factor", factor, 1.0)
    if (ratio := stability.damping_ratio) is not None:
        yield ParameterChange(("stability", "damping_ratio"), "a smaller damping ratio", ratio, ratio / FURTHEST)
    yield from _of_gains(document, problem)


def _of_device(problem: Problem) -> Iterator[ParameterChange]:
    device, T = problem.device, problem.device.sample_time
    if device.servo is None:
        yield _more_damping(("device", "damping"), "more device damping", device.damping, problem)
    if not device.digital:  # at another rate the same coefficients are another filter
        yield ParameterChange(("device", "sample_time"), "a shorter sample time", T, T / FURTHEST)
    late: KeyPath = ("device", "delay") if device.servo is None else ("device", "servo", "delay")
    if (delay := device.stated_delay) > 0:
        yield ParameterChange(late, "less delay", delay, delay / FURTHEST)
    better = {key: each for key, each in PART_NUMBERS.items() if each.better and device.number(key)}
    for key, each in sorted(better.items(), key=lambda entry: entry[1].quantity == "time"):
        number = device.number(key)
        limit = number / FURTHEST
        if each.quantity == "rate":
            limit = min(0.5 / T if each.sampled else max(FURTHEST * number, 0.5 / T), FASTEST / T)
        meaning = problem.units.translated(each.better)
        yield ParameterChange(("device", *key.split(".")), meaning, number, limit)


def _of_operator(problem: Problem) -> Iterator[ParameterChange]:
    """Yield changes that leave fewer hands: more damping or, for a claim about a box of hands, also less mass or
    stiffness."""
    held, meaning = problem.hands.held, "more damping in every hand"
    low, high = held.low, held.high
    if problem.hands_met is None:
        yield _more_damping(("operator", "damping"), meaning, low.damping, problem)
        return
    loop = _natural_impedance(problem)
    for name, words, scale in (
        ("damping", meaning, loop),
        ("stiffness", "more stiffness in every hand", loop / problem.device.loop_lag),
    ):
        yield from _raised(("operator", name), words, getattr(low, name), getattr(high, name), scale)
    for name, words in (("mass", "lighter hands"), ("damping", "less damped hands"), ("stiffness", "softer hands")):
        yield from _lowered(("operator", name), words, getattr(low, name), getattr(high, name), 1.0)
    if (tool := problem.hands.tool) is not None and (most := tool.high.mass) > 0:
        if tool.low.mass == most:
            yield ParameterChange(("tool", "mass"), "a lighter tool", most, most / FURTHEST)
        yield from _lowered(("tool", "mass"), "lighter tools", tool.low.mass, most, most)


def _of_worlds(problem: Problem) -> Iterator[ParameterChange]:
    """Yield changes that leave fewer environments: narrower ranges of mass and stiffness, or more damping."""
    worlds = problem.worlds
    if worlds is None or worlds.exact:
        return
    low, high, loop, tau = worlds.low, worlds.high, _natural_impedance(problem), problem.device.loop_lag
    path: KeyPath = ("environment", "damping", "min")
    yield _more_damping(path, "more damping in every environment", low.damping, problem)
    if worlds.walls:
        yield ParameterChange(("environment", "walls"), "springs that are always in contact", 1.0, 0.0, switch=True)
    for name, scale, less, more in (
        ("mass", loop * tau, "lighter", "heavier"),
        ("stiffness", loop / tau, "softer", "stiffer"),
    ):
        least, most = getattr(low, name), getattr(high, name)
        yield from _lowered(("environment", name), f"{less} environments", least, most, scale)
        yield from _raised(("environment", name), f"{more} environments", least, most, scale)


def _raised(path: KeyPath, meaning: str, least: float, most: float, scale: float) -> Iterator[ParameterChange]:
    """Yield a greater lower end of a range."""
    if least < most:
        yield ParameterChange((*path, "min"), meaning, least, min(most, FURTHEST * scale), min(scale, most), most)


def _lowered(path: KeyPath, meaning: str, least: float, most: float, scale: float) -> Iterator[ParameterChange]:
    """Yield a smaller upper end of a range."""
    if least < most:
        lowest = max(least, (most if most < inf else scale) / FURTHEST)
        yield ParameterChange((*path, "max"), meaning, most, lowest, scale, least)


def _more_damping(path: KeyPath, meaning: str, old: float, problem: Problem) -> ParameterChange:
    loop = _natural_impedance(problem)
    return ParameterChange(path, meaning, old, FURTHEST * (old or loop), loop)


def _of_band(document: dict[str, Any], problem: Problem) -> Iterator[ParameterChange]:
    """Yield changes to narrower stability bands, which keep at least one octave."""
    band, path = problem.stability.band, ("stability", "band_hz")
    low, high = _hz(document, 0, band.min), _hz(document, 1, band.max)
    nyquist, inner = 0.5 / problem.device.sample_time, problem.transparency.band.min / (2 * pi)
    lowest, highest = max(2 * low, inner / 100), min(high / 2, nyquist)
    if lowest < min(high, nyquist):
        change = "a lower upper edge of the stability band"
        yield ParameterChange((*path, 1), change, high, lowest, nyquist, low)
    if highest > low:
        change = "a higher lower edge of the stability band"
        yield ParameterChange((*path, 0), change, low, highest, inner, high)


def _hz(document: dict[str, Any], edge: int, omega: float) -> float:
    """Return an edge of the stability band as the file states it, or the default in `DIGITS` digits."""
    stated = number_at(document, "stability", "band_hz", edge)
    return float(f"{omega / (2 * pi):.{DIGITS}g}") if stated is None else stated


def _of_gains(document: dict[str, Any], problem: Problem) -> Iterator[ParameterChange]:
    """Yield changes of the fixed variables of a design, and wider bounds of the ranges in the file."""
    for key, natural in _natural_sizes(problem).items():
        _, name = path = tuple(key.split("."))
        bounds, symbol = getattr(problem.bounds, name), problem.device.kind.symbol(key)
        lowest = bounds.min / FURTHEST
        if number_at(document, *path, "max") is not None:
            most, widest = bounds.max, FURTHEST * max(bounds.max, natural)
            yield ParameterChange((*path, "max"), f"a higher bound of {symbol}", most, widest, natural, bounds.min)
            if bounds.min > 0:
                low = f"a lower bound of {symbol}"
                yield ParameterChange((*path, "min"), low, bounds.min, lowest, natural, most)
        elif bounds.min < inf and (number_at(document, *path) is not None or key == "coupling.drag"):
            yield change_of_gain(problem, key, bounds.min, FURTHEST * (bounds.min or natural))
            if bounds.min > 0:
                yield change_of_gain(problem, key, bounds.min, lowest)


def change_of_gain(problem: Problem, key: str, old: float, limit: float) -> ParameterChange:
    """Return the change of a variable of a design towards another value."""
    table, name = key.split(".")
    way = f"a {'greater' if limit > old else 'smaller'} {problem.device.kind.symbol(key)}"
    meaning = "some drag" if key == "coupling.drag" and old == 0 else way
    return ParameterChange((table, name), meaning, old, limit, _natural_sizes(problem)[key])


def _natural_impedance(problem: Problem) -> float:
    """Return the mass of a device divided by its loop's lag, N s/m; for a servo, which has no mass, Z_0."""
    if problem.device.servo is not None:
        return problem.transparency.reference_impedance
    return problem.device.mass / problem.device.loop_lag


def _natural_sizes(problem: Problem) -> dict[str, float]:
    """Return the natural size of each stated variable of a design, under the variable's key."""
    tau, Z_0 = problem.device.loop_lag, problem.transparency.reference_impedance
    loop = _natural_impedance(problem) + problem.device.damping
    sizes = dict(zip(KEYS, (loop, loop / tau, Z_0, Z_0 * tau, Z_0), strict=True)) | {SPRING_KEYS[3]: Z_0 / tau}
    return {key: sizes[key] for key in problem.device.kind.stated}
