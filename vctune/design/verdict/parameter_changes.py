"""Define the changes of one value of a problem file that a repair may make."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal
from math import inf, pi
from typing import Any

from vctune.document.schema.rules import FASTEST
from vctune.document.schema.validation import KeyPath, dotted
from vctune.document.text.raw import number_at, placed
from vctune.model.numbers.keys import KEYS, SPRING_KEYS, SYMBOLS
from vctune.model.parts import PART_NUMBERS
from vctune.model.problem import Problem

# Steps that the search tries, relative to the smaller of the old and the new value, or to the natural size if the old
# value is 0; the last step is the limit
STEPS = (0.03, 0.1, 0.3, 0.6, 1.0, 1.5, 2.2, 3.0, 10.0, 100.0)
STEPS_FROM_ZERO = (1e-4, 1e-2, 0.1, 0.3, 1.0, 3.0, 10.0)
ROUNDING = 0.15  # Greatest share by which rounding to few digits may enlarge a step
FURTHEST = 1e6  # Greatest factor by which the search changes a bound or a gain; no device needs more
SOFTEST = 1e-3  # Least share to which the search reduces the greatest mass, damping or stiffness of the hands
DIGITS = 12  # Greatest number of significant digits of a new value
# Parameters of a device's parts for which better parts exist, such as the bandwidth of an actuator
BETTER = {key: each for key, each in PART_NUMBERS.items() if each.better}
OTHER_END: dict[str | int, str | int] = {0: 1, 1: 0, "min": "max", "max": "min"}
ONLY_UPWARDS = ("coupling.mass", "coupling.drag")  # Keys of parameters that increase Re Z_c as they grow


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
    def eases(self) -> bool:
        """Whether a larger change only relaxes constraints or permits more designs: fewer hands, a narrower band, wider
        bounds."""
        if self.path[0] in ("operator", "environment"):
            return self.path[-1] != "max" or self.limit < self.old
        return self.path[0] == "stability" or self.path[-1] in ("min", "max") or self.key in ONLY_UPWARDS

    def value(self, relative: float) -> float:
        """Return the value after a given relative change, limited to `limit`."""
        if self.old == 0:
            return min(self.scale * relative, self.limit)
        if self.old == inf:
            return max(self.scale / relative, self.limit)
        if self.limit > self.old:
            return min(self.old * (1 + relative), self.limit)
        return max(self.old / (1 + relative), self.limit)

    def relative_change(self, new: float) -> float:
        """Return the relative change to a new value; inf for a change to 0."""
        if self.old == 0:
            return new / self.scale
        if self.old == inf:
            return self.scale / new
        return abs(new - self.old) / min(new, self.old) if new > 0 else inf

    def size(self, new: float) -> float:
        """Return the size r/(1 + r) of a relative change r, to compare changes of different values."""
        relative = self.relative_change(new)
        return relative / (1 + relative) if relative < inf else 1.0

    def steps(self) -> Iterator[float]:
        """Yield the relative changes to try, up to the limit."""
        last = self.relative_change(self.limit)
        if not self.switch:
            steps = STEPS_FROM_ZERO if self.old == 0 else STEPS
            yield from (relative for relative in steps if relative < last)
        yield last

    def rounded(self, relative: float) -> float:
        """Return the new value after a relative change, rounded away from the old value to as few digits as
        possible."""
        exact, upwards = self.value(relative), self.limit > self.old
        for digits in range(1, DIGITS):
            context = Context(prec=digits, rounding=ROUND_CEILING if upwards else ROUND_FLOOR)
            new = float(context.create_decimal(Decimal(exact)))
            within = new <= self.limit if upwards else new >= self.limit
            if within and self.relative_change(new) <= relative * (1 + ROUNDING):
                return new
        towards = Context(prec=3, rounding=ROUND_FLOOR if upwards else ROUND_CEILING)  # the limit itself is not passed
        return float(towards.create_decimal(Decimal(exact)))

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


def parameter_changes(document: dict[str, Any], problem: Problem) -> list[ParameterChange]:
    """Return the possible changes of a problem: of the device, of the constraints, and of the bounds or gains in the
    file."""
    band = _of_band(document, problem) if problem.passive else ()
    of_demands = [*band, *_of_worlds(problem), *_of_demands(problem)]
    return [*_of_device(problem), *_of_operator(problem), *of_demands, *_of_gains(document, problem)]


def _of_device(problem: Problem) -> Iterator[ParameterChange]:
    device, loop = problem.device, _natural_impedance(problem)
    if device.servo is None:
        yield ParameterChange(
            ("device", "damping"), "more device damping", device.damping, max(100 * device.damping, loop), loop
        )
    yield ParameterChange(
        ("device", "sample_time"), "a shorter sample time", device.sample_time, device.sample_time / 100
    )
    late: KeyPath = ("device", "delay") if device.servo is None else ("device", "servo", "delay")
    if device.latency > 0:
        yield ParameterChange(late, "less delay", device.latency, 0.0)
    nyquist = 0.5 / device.sample_time
    for key, each in sorted(BETTER.items(), key=lambda entry: entry[1].quantity == "time"):
        number, meaning = device.number(key), problem.units.translated(each.better)
        if number is None or number == 0:
            continue
        limit = 0.0
        if each.quantity == "rate":
            fastest = nyquist if each.sampled else max(100 * number, nyquist)
            limit = min(fastest, FASTEST / device.sample_time)
        yield ParameterChange(("device", *key.split(".")), meaning, number, limit)


def _of_operator(problem: Problem) -> Iterator[ParameterChange]:
    """Yield changes that leave fewer hands: more damping or, for a claim about a box of hands, less mass or
    stiffness."""
    device, low, high = problem.device, problem.hands.low, problem.hands.high
    meaning, loop = "more damping in every hand", _natural_impedance(problem)
    path: KeyPath = ("operator", "damping")
    if problem.hands_met is None:
        yield ParameterChange(path, meaning, low.damping, max(100 * low.damping, loop), loop)
        return
    for name, scale in (("damping", loop), ("stiffness", loop / device.loop_lag)):
        least, most = getattr(low, name), getattr(high, name)
        if least < most:
            more = meaning if name == "damping" else "more stiffness in every hand"
            yield ParameterChange(("operator", name, "min"), more, least, most, min(scale, most), most)
    for name, lighter in (("mass", "lighter hands"), ("damping", "less damped hands"), ("stiffness", "softer hands")):
        least, most = getattr(low, name), getattr(high, name)
        if least < most:
            lowest = max(least, SOFTEST * most)
            yield ParameterChange(("operator", name, "max"), lighter, most, lowest, 1.0, least)


def _of_worlds(problem: Problem) -> Iterator[ParameterChange]:
    """Yield changes that leave fewer environments: narrower ranges of mass and stiffness, or more damping."""
    worlds = problem.worlds
    if worlds is None or worlds.exact:
        return
    low, high, loop = worlds.low, worlds.high, problem.device.mass / problem.device.loop_lag
    path: KeyPath = ("environment", "damping", "min")
    more = "more damping in every environment"
    yield ParameterChange(path, more, low.damping, max(100 * low.damping, loop), loop)
    if worlds.walls:
        yield ParameterChange(("environment", "walls"), "springs that are always in contact", 1.0, 0.0, switch=True)
    tau = problem.device.loop_lag
    for name, least, most, scale, words in (
        ("mass", low.mass, high.mass, loop * tau, ("lighter", "heavier")),
        ("stiffness", low.stiffness, high.stiffness, loop / tau, ("softer", "stiffer")),
    ):
        if least < most:
            lowest, highest = max(least, SOFTEST * (most if most < inf else scale)), min(most, FURTHEST * scale)
            yield ParameterChange(("environment", name, "max"), f"{words[0]} environments", most, lowest, scale, least)
            path = ("environment", name, "min")
            yield ParameterChange(path, f"{words[1]} environments", least, highest, scale, most)


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


def _of_demands(problem: Problem) -> Iterator[ParameterChange]:
    stability = problem.stability
    most, factor = stability.max_sensitivity, stability.safety_factor
    if problem.device.kind.own_loop:
        yield ParameterChange(("stability", "max_sensitivity"), "a greater |S|", most, 10 * most)
    if factor > 1:
        yield ParameterChange(("stability", "safety_factor"), "a smaller safety factor", factor, 1.0)


def _of_gains(document: dict[str, Any], problem: Problem) -> Iterator[ParameterChange]:
    """Yield changes of the fixed variables of a design, and wider bounds of the ranges in the file."""
    natural = _natural_sizes(problem)
    for key in problem.device.kind.stated:
        table, name = key.split(".")
        path, bounds, symbol = (table, name), getattr(problem.bounds, name), SYMBOLS[key]
        downwards = key not in ONLY_UPWARDS
        if number_at(document, *path, "max") is not None:
            furthest, unit = _upwards(bounds.max, natural[key]), natural[key]
            yield ParameterChange((*path, "max"), f"a higher bound of {symbol}", bounds.max, furthest, unit, bounds.min)
            if downwards and bounds.min > 0:
                furthest = _downwards(bounds.min, key)
                yield ParameterChange(
                    (*path, "min"), f"a lower bound of {symbol}", bounds.min, furthest, unit, bounds.max
                )
        elif number_at(document, *path) is not None or key == "coupling.drag":
            yield change_of_gain(problem, key, bounds.min, _upwards(bounds.min, natural[key]))
            if downwards and bounds.min > 0:
                yield change_of_gain(problem, key, bounds.min, _downwards(bounds.min, key))


def change_of_gain(problem: Problem, key: str, old: float, limit: float) -> ParameterChange:
    """Return the change of a variable of a design towards another value."""
    table, name = key.split(".")
    way = f"a {'greater' if limit > old else 'smaller'} {SYMBOLS[key]}"
    meaning = "some drag" if key == "coupling.drag" and old == 0 else way
    return ParameterChange((table, name), meaning, old, limit, _natural_sizes(problem)[key])


def _natural_impedance(problem: Problem) -> float:
    """Return the mass of a device divided by its loop's lag, N s/m; for a servo, which has no mass, Z_0."""
    if problem.device.servo is not None:
        return problem.transparency.reference_impedance
    return problem.device.mass / problem.device.loop_lag


def _natural_sizes(problem: Problem) -> dict[str, float]:
    """Return the natural size of each variable of a design, under the variable's key."""
    tau = problem.device.loop_lag
    loop = _natural_impedance(problem) + problem.device.damping
    Z_0 = problem.transparency.reference_impedance
    return dict(zip(KEYS, (loop, loop / tau, Z_0, Z_0 * tau, Z_0), strict=True)) | {SPRING_KEYS[3]: Z_0 / tau}


def _upwards(old: float, natural: float) -> float:
    """Return the greatest value to try."""
    return max(FURTHEST * old, 10 * natural)


def _downwards(old: float, key: str) -> float:
    """Return the least value to try, which is 0 for a gain of the velocity loop."""
    return 0.0 if key.startswith("gains.") else old / FURTHEST
