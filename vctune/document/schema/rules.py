"""Find contradictions between values of a problem file that are valid on their own."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from itertools import pairwise
from math import floor, inf, isnan, nan, pi
from typing import Any

from vctune.document.schema.number_units import unit_of, units_stated
from vctune.document.schema.validation import Contradiction, KeyPath
from vctune.document.text.hints import LONGEST_SAMPLE, in_finer_unit, seconds_meant
from vctune.document.text.toml import number_at, value_at
from vctune.model.experiment import Friction, MovingHand
from vctune.model.fields import keys_of_table
from vctune.model.hands import HAND
from vctune.model.numbers.units import KEYS, LINEAR, ROTARY, SPRING_KEYS
from vctune.model.parts import DELAYS, LOOP_DELAYS, MAY_BE_ZERO, NUMBERS, PART_NUMBERS, PARTS, UNCERTAIN
from vctune.model.problem import HUMAN_HANDS
from vctune.model.transparency import TERMS

Key = str | KeyPath  # A key, dotted or as a path
Found = Iterator[tuple[Key, str]]
MAX_DECADES = 12  # Greatest width of a band, in decades of frequency
# Greatest permitted delay of the device or the servo, and of its force sensor, each with its uncertainty, in samples
MAX_DELAY_SAMPLES = 200
FASTEST, SLOWEST = 1e3, 1e-6  # Greatest and least bandwidth or resonance, as a share of the sampling rate
COEFFICIENT = "filter_coefficient"
TOOL = ("tool.mass", "tool.damping")
BEYOND_REST = "a step by Euler would go beyond rest; take more mass, less drag or a shorter sample_time"
MOTION = ("from", "to", "speed", "cycles", "damping", "stiffness")  # Keys of the motion of a hand, in their order
LEAST_STROKE = 4  # Least duration of a stroke at the greatest speed of the hand, sample times
MOST_SAMPLES = 5_000_000  # Greatest number of samples of an experiment


class Stated:
    """What a problem's tables state, which may be invalid in part. In the rules of an experiment, the key `experiment`
    is its table."""

    def __init__(self, raw: dict[str, Any]) -> None:
        self.raw, self.units = raw, units_stated(raw)
        self.T = T if (T := self("device.sample_time")) > 0 else nan  # s
        self.servo, self.impedance = "servo" in self.table("device"), self.value("device.display") == "impedance"

    def __call__(self, key: Key, absent: float = nan) -> float:
        """Return a finite number. One that the file does not state is nan, which satisfies no comparison."""
        number = number_at(self.raw, *_path(key))
        return number if number is not None else absent if self.value(key) is None else nan

    def reach(self, key: str) -> tuple[float, float]:
        """Return the least and the greatest value of a parameter of the device, by its key, with its uncertainty."""
        known, share = self(f"device.{key}"), self(("uncertainty", key), 0.0)
        if isinstance(self.value(("uncertainty", key)), dict):
            least = 0.0 if key in MAY_BE_ZERO else nan
            return self(("uncertainty", key, "min"), least), self(("uncertainty", key, "max"))
        return known * (1 - share), known * (1 + share)

    def value(self, key: Key) -> Any:
        """Return any value; None if the file does not state it."""
        return value_at(self.raw, _path(key))

    def table(self, key: Key) -> dict[str, Any]:
        """Return a table; an empty one if the file states none."""
        return table if isinstance(table := self.value(key), dict) else {}

    def tables(self, key: Key) -> list[dict[str, Any]]:
        """Return a list of tables, with an empty one in the place of each element that is none."""
        listed = self.value(key)
        return [one if isinstance(one, dict) else {} for one in listed] if isinstance(listed, list) else []

    def band(self, table: str) -> tuple[float, float]:
        """Return the edges of a band, which may be infinite."""
        edges = [(table, "band_hz", end) for end in (0, 1)]
        low, high = (inf if self.value(edge) == inf else self(edge) for edge in edges)
        return low, high


ADDS_TO_WALL = "adds to coupling.damping, which is the damping of the wall; leave it out"
_UNMOVED = "the hand does not move it: its motion follows the command alone"
_PARALLEL = "its coupling is coupling.damping beside coupling.stiffness"
# Keys without a meaning for a kind of display, each with the reason
MEANINGLESS: dict[str, dict[str, str]] = {
    "impedance": {
        "device.force_sensor": "it senses no force",
        "gains.position": "it has no velocity loop, whose error an integrator would add up",
        "coupling.mass": _PARALLEL,
        "coupling.drag": _PARALLEL,
        "stability.band_hz": "its demands are proved at every frequency up to the Nyquist frequency",
        "uncertainty.unmodelled": "its demands are not proved of a response that is not known",
    },
    "servo": {
        "device.mass": _UNMOVED,
        "device.damping": _UNMOVED,
        "device.delay": "the delay is device.servo.delay",
        "device.hold": "its command is held over a sample, or interpolated",
        "device.display": "a servo is an admittance display",
        "device.velocity": "no gain of this file acts on its velocity",
        "device.actuator": "its lag is device.servo.bandwidth_hz and order",
        "device.structure": "a spring behind its loop is not modelled",
        "gains": "its loop is the vendor's; only the coupling is designed",
        "coupling.stiffness": "its coupling is damping and mass in series, beside drag",
        "stability.band_hz": "its requirements are proved at every frequency up to the Nyquist frequency",
        "device.friction": _UNMOVED,
        "stability.rest": _UNMOVED,
        "uncertainty.mass": _UNMOVED,
        "uncertainty.damping": _UNMOVED,
        "uncertainty.delay": 'the delay is "servo.delay"',
        "stability.max_sensitivity": "the file closes no loop of its own that could be too sensitive",
    },
}
# Keys of an experiment without a meaning for a servo; a number of 0 says the same as no number
MEANINGLESS_IN_EXPERIMENT = {
    "experiment.friction": "the hand does not move it, and its motion follows the command whatever rubs",
    "experiment.sensors.position_resolution": "the firmware reads no position of it",
    "experiment.actuator.limit": "the firmware commands no force",
    "experiment.baseline": "a regular PID commands a force, which it does not take",
}


def contradictions(raw: dict[str, Any]) -> list[Contradiction]:
    """Return the contradictions in the valid parts of a problem's tables."""
    file = Stated(raw)
    rules = (
        _ranges, _bands, _constraints, _environments, _long_delays, _parts, _display, _in_hands_alone, _law, _rest,
        _damping, _calm,
        _names, _rotary_hands,
    )  # fmt: skip
    found = [(_path(key), message) for rule in rules for key, message in rule(file)]
    for index, table in enumerate(file.tables("experiment")):
        one = Stated(raw | {"experiment": table})
        for rule in (_motion, _rendering, _hardware, _rotary_defaults):
            found += [(("experiment", index, *_path(key)[1:]), message) for key, message in rule(one)]
    if found and file.T >= LONGEST_SAMPLE:  # the others may follow from it
        return [(("device", "sample_time"), f"is {file.T:g} s; {seconds_meant(file.T)}")]
    return found


def impossible_parts(raw: dict[str, Any]) -> list[Contradiction]:
    """Return the contradictions in the parts of a device and in its uncertainty."""
    return [(_path(key), message) for key, message in _parts(Stated(raw))]


def _parts(file: Stated) -> Found:
    if isinstance(file.value("device"), dict):
        for rule in (_rates, _low_passes, _springs, _masses, _uncertain, _unmodelled):
            yield from rule(file)


def _path(key: Key) -> KeyPath:
    return tuple(key.split(".")) if isinstance(key, str) else key


def _ranges(file: Stated) -> Found:
    for key in (*KEYS, *SPRING_KEYS[3:], *HAND, *TOOL, "environment.mass", "environment.stiffness"):
        if (low := file(f"{key}.min")) > (high := file(f"{key}.max")):
            yield key, f"min = {low:g} is above max = {high:g}; swap them"


def _bands(file: Stated) -> Found:
    """Yield the bands without a width, with too many decades, or with an edge that the device does not permit."""
    to_infinity = file.value("device.hold") == "lag" and not file("device.delay", 0.0) > 0
    to_infinity &= not set(PARTS) & set(file.table("device"))
    nyquist = 0.5 / file.T
    for table in ("transparency", "stability"):
        key, (low, high) = f"{table}.band_hz", file.band(table)
        if inf > low >= high:
            yield key, f"the lower edge {low:g} Hz is not below the upper edge {high:g} Hz; a band needs a width"
        if low == inf:
            yield key, "the lower edge is infinite; use a finite one"
        if 0 < low * 10.0**MAX_DECADES < high < inf:
            yield key, f"from {low:g} to {high:g} Hz are more than {MAX_DECADES} decades; narrow it"
        if inf > high > nyquist * (1 + 1e-12):
            yield key, f"the upper edge {high:g} Hz is above the Nyquist frequency {nyquist:g} Hz; lower it"
        if table == "stability" and high == inf and not to_infinity:
            yield key, 'the upper edge inf needs hold = "lag", delay = 0 and no parts of the device; use a finite one'


def _constraints(file: Stated) -> Found:
    """Yield an impossible safety factor, weights that are all 0, and a criterion that does not cover the device."""
    if 0 < (factor := file("stability.safety_factor")) < 1:
        yield "stability.safety_factor", f"{factor:g} is below 1, where the handle is not absolutely stable"
    if all(file(f"transparency.weights.{term}") == 0 for term in TERMS):
        yield "transparency.weights", "all three are 0: nothing is left to optimise; give one a positive weight"
    in_hands = file.value("stability.criterion") == "hands" and not file.servo
    if in_hands and file.value("uncertainty.unmodelled"):
        remedy = 'leave it out, or write stability.criterion = "both" or "passive"'
        yield "uncertainty.unmodelled", f"is not covered by the proof in hands; {remedy}"


def _environments(file: Stated) -> Found:
    """Yield the claims that cannot be proved with a box of environments, and the keys that walls do not allow."""
    if not isinstance(file.value("environment"), dict):
        return
    if file.impedance:
        yield from _rigid_world(file)
        return
    if file.value("environment.stiffness") == inf:
        yield (
            "environment.stiffness",
            "a rigid world is of an impedance display, whose coupling is then a wall; write the stiffest spring that "
            "the device renders, or leave it out",
        )
    if file.value("stability.criterion") in ("passive", "both") and not file.servo:
        yield from _any_hand_alone(file)
    if file.value("uncertainty.unmodelled") and (not file.servo or file.value("environment.walls") is True):
        what = "walls" if file.servo else "[environment] of a loop of its own"
        yield "uncertainty.unmodelled", f"is not proved with {what}; leave one of them out"
    corner = file("environment.corner_hz")
    if file.value("environment.walls") is not True:
        if not isnan(corner):
            yield "environment.corner_hz", "applies only to walls; write walls = true, or leave it out"
        return
    most = file("environment.stiffness.max")
    if isnan(most):
        yield (
            "environment.walls",
            "needs a stiffest wall; state stiffness.max, or leave out [environment]: the claim then covers every "
            "passive environment, including walls of any stiffness",
        )
    elif most == file("environment.stiffness.min", 0.0):
        yield "environment.walls", f"needs a range of stiffness, not {most:g} alone; a wall has two slopes"
    if corner * pi * file.T > 1:
        highest = float(f"{1 / (pi * file.T) * (1 - 5e-7):.6g}")  # rounded down to six digits
        yield "environment.corner_hz", f"{corner:g} Hz is above 1/(pi sample_time); write at most {highest:g}"


def _any_hand_alone(file: Stated) -> Found:
    """Yield why any passive hand cannot be asked for with a box of environments, or with nothing behind."""
    criterion = file.value("stability.criterion")
    masses, springs = ([file(f"environment.{name}{end}") for end in (".max", "")] for name in ("mass", "stiffness"))
    if 0 not in masses or 0 not in springs or file("environment.damping.min") > 0:
        yield (
            "stability.criterion",
            f'"{criterion}" allows any passive hand, which is proved with every passive environment or with nothing '
            "behind (mass.max = 0, stiffness.max = 0), while [environment] states others; "
            'write "hands", or leave out the criterion or [environment]',
        )
        return
    for end, (edge, endless) in enumerate(zip(file.band("stability"), (0.0, inf), strict=True)):
        if edge == endless:
            yield ("stability", "band_hz", end), f"{edge:g} has no proof with nothing behind; state another edge"
    for key in ("gains.velocity", "gains.position"):
        if isnan(file(key)):
            yield key, f'must be one number: with nothing behind, "{criterion}" asks for mass and drag for given gains'
    if file.value("coupling.damping") not in (None, inf):
        yield "coupling.damping", "holds nothing with nothing behind; write inf, or leave it out"


def _rigid_world(file: Stated) -> Found:
    """Yield what a file with an impedance display states beside a rigid world, or instead of it."""
    stated = file.table("environment")
    if stated.get("stiffness") != inf:
        yield (
            "environment",
            'means nothing with device.display = "impedance", whose demands are proved with every passive environment: '
            "write stiffness = inf if its coupling is a wall, or leave it out",
        )
        return
    for key in (key for key in stated if key != "stiffness"):
        yield ("environment", key), "means nothing beside stiffness = inf: nothing moves behind a wall; leave it out"
    if file.value("gains.velocity") not in (None, 0):
        yield "gains.velocity", ADDS_TO_WALL


def _long_delays(file: Stated) -> Found:
    """Yield a delay that, with its uncertainty, has too many samples."""
    most = MAX_DELAY_SAMPLES
    for key in LOOP_DELAYS:
        delay, share = file(f"device.{key}"), file(("uncertainty", key), 0.0)
        samples, latest = delay / file.T, file.reach(key)[1]
        ranged = ("uncertainty", key, "max")
        if file.value(ranged) is not None and samples <= most < latest / file.T:
            yield ranged, f"{latest:.12g} s is {latest / file.T:.12g} sample times; at most {most} are supported"
        if samples > most:
            unit, instead = in_finer_unit(delay, most * file.T)
            hint = f"; is it in {unit}? Then write {instead:g}" if instead < most * file.T else ""
            said = f"{delay:.12g} s is {samples:.12g} sample times; at most {most} are supported{hint}"
            yield f"device.{key}", said
        elif samples * (1 + share) > most and share < 1:
            greatest = floor((most / samples - 1) * 1e6) / 1e6
            yield (
                ("uncertainty", key),
                f"{share:.12g} lets device.{key} = {delay:.12g} s reach {samples * (1 + share):.12g} sample times; at "
                f"most {most} are supported: write at most {greatest:g}, or a shorter device.{key}",
            )


def _rates(file: Stated) -> Found:
    """Yield the bandwidths and resonances that do not fit the sample time, and too long delays of the sensed force."""
    fastest, slowest, nyquist = FASTEST / file.T, SLOWEST / file.T, 0.5 / file.T
    for part, each in ((part, each) for part, of in PARTS.items() for each in of.numbers):
        key, name = f"device.{part}.{each.name}", f"{part}.{each.name}"
        number = file(key)
        if each.quantity == "rate" and each.sampled and number > nyquist:
            yield key, f"{number:g} Hz is above the Nyquist frequency {nyquist:g} Hz; lower it, or leave it out"
        elif each.quantity == "rate" and not each.sampled and number > fastest:
            remedy = "lower it" if part == "servo" else "leave the table out"
            yield key, f"{number:g} Hz is above {fastest:g} Hz, where it does nothing; {remedy}"
        elif each.quantity == "rate" and not each.sampled and 0 < number < slowest:
            yield key, f"{number:g} Hz is below {slowest:g} Hz; raise it"
        samples = file.reach(name)[1] / file.T
        if name in DELAYS and name not in LOOP_DELAYS and number >= 0 and samples > MAX_DELAY_SAMPLES:
            most = f"at most {MAX_DELAY_SAMPLES} are supported"
            yield key, f"{number:.12g} s is up to {samples:.12g} sample times; {most}"


def _low_passes(file: Stated) -> Found:
    """Yield the order of a low-pass without its frequency, a low-pass that is stated twice, and the resolution of a
    position that is not read."""
    for part, each in ((part, each) for part, of in PARTS.items() for each in of.numbers if each.order_key):
        stated = file.table(f"device.{part}")
        if each.order_key in stated and each.name not in stated and COEFFICIENT not in stated:
            yield f"device.{part}.{each.order_key}", f"is of a low-pass; write {each.name} too, or leave it out"
    velocity = file.table("device.velocity")
    if "filter_hz" in velocity and COEFFICIENT in velocity:
        yield f"device.velocity.{COEFFICIENT}", "states the low-pass of filter_hz again; leave one of them out"
    if "resolution" in velocity and velocity.get("from", "measured") == "measured" and not file.impedance:
        yield "device.velocity.resolution", 'is of a position that is differenced; write from = "difference"'


STRUCTURES = ("structure", "structure_2", "structure_3")


def _springs(file: Stated) -> Found:
    """Yield springs without a stiffness or with two, springs that follow none, and more than the model has."""
    device: dict[str, Any] = {} if file.servo else file.table("device")
    if isinstance(device.get("structure"), list) and "structure_2" in device:
        yield "device.structure_2", "is the second [[device.structure]] too; write a list, or a table for each"
    for before, key in pairwise((*STRUCTURES, "structure_4")):
        if key in device and key not in STRUCTURES:
            yield f"device.{key}", f"is one spring too many; at most {len(STRUCTURES)} are modelled"
        elif key in device and before not in device:
            yield f"device.{key}", f"is behind device.{before}, which is not there"
    for key in STRUCTURES:
        stated = [name for name in ("frequency_hz", "stiffness") if name in file.table(f"device.{key}")]
        if isinstance(device.get(key), dict) and not stated:
            yield f"device.{key}", "needs frequency_hz, or the stiffness of the spring"
        elif len(stated) > 1:
            yield f"device.{key}.stiffness", "states the spring of frequency_hz again; leave one of them out"
    if file.value("device.velocity.at") == "handle" and not file.servo and "structure" not in device:
        yield "device.velocity.at", '"handle" is behind a spring; write [device.structure], or leave it out'


def _in_hands_alone(file: Stated) -> Found:
    """Yield what is proved in hands alone: a sensor at the handle, and several springs of an impedance display."""
    if file.servo:
        return
    sensed, springs = file.value("device.velocity.at") == "handle", "structure_2" in file.table("device")
    if sensed and "resolution" in file.table("device.velocity"):
        yield "device.velocity.resolution", "is of an encoder on the motor; leave it out"
    criterion, met = file.value("stability.criterion"), file.value("environment") is not None and not file.impedance
    if criterion == "hands" or (criterion is None and met):
        return
    remedy = 'state the hands in [operator] and write stability.criterion = "hands"'
    if sensed:
        yield "device.velocity.at", f'"handle" is not proved in any passive hand; {remedy}, or leave it out'
    if springs and file.impedance:
        yield "device.structure_2", f"of an impedance display it is not proved in any passive hand; {remedy}"


def _masses(file: Stated) -> Found:
    """Yield handles and masses between springs that are not lighter than the whole device, with their uncertainty."""
    keys = [key for key in STRUCTURES if key in file.table("device")]
    mass, unit = file("device.mass"), file.units.mass
    behind = sum(file(f"device.{key}.handle_mass") for key in keys)
    lightest, heaviest = file.reach("mass")[0], sum(file.reach(f"{key}.handle_mass")[1] for key in keys)
    more = next((key for key in keys if file.value(("uncertainty", f"{key}.handle_mass"))), None)
    what = "the handle" if len(keys) == 1 else "what is behind the springs"
    if behind >= mass > 0 and len(keys) == 1:
        message = f"{behind:g} {unit} is not less than device.mass = {mass:g} {unit}, of which it is a part"
        yield "device.structure.handle_mass", message
    elif behind >= mass > 0:
        message = f"with the others, {behind:g} {unit} is not less than device.mass = {mass:g} {unit}, their whole"
        yield f"device.{keys[-1]}.handle_mass", message
    elif heaviest >= lightest > 0 < behind:
        message = f"lets {what}, {heaviest:g} {unit}, be as heavy as the device, {lightest:g} {unit}"
        yield ("uncertainty", f"{more}.handle_mass" if more else "mass"), message


def _uncertain(file: Stated) -> Found:
    """Yield the uncertainties in the wrong place, and those of numbers that the device lacks."""
    for part, name in (key.split(".") for key in NUMBERS if "." in key):
        key, misplaced, device = f"{part}.{name}", file.table(f"uncertainty.{part}"), file.table(f"device.{part}")
        if name in misplaced:
            yield f"uncertainty.{key}", f'belongs in quotes: "{key}" = {misplaced[name]}'
        if file.value(("uncertainty", key)) and name not in device:
            yield ("uncertainty", key), f"there is no device.{key} to be uncertain; write it, or leave this out"
        elif file.value(("uncertainty", key)) and key == "servo.delay" and "bandwidth_hz" not in device:
            message = "of a latency whose bandwidth is unknown; state the greatest delay instead, or the bandwidth_hz"
            yield ("uncertainty", key), message
    for key in (key for key in UNCERTAIN if isinstance(file.value(("uncertainty", key)), dict)):
        yield from _ranged(file, key)


def _ranged(file: Stated, key: str) -> Found:
    """Yield the faults of a range of a parameter, which lies around the value that the device states."""
    (low, high), path = file.reach(key), ("uncertainty", key)
    stated = file(f"device.{key}", 0.0 if key in MAY_BE_ZERO else nan)
    if isnan(low) or isnan(high):  # an end that is missing, which is told as that
        return
    if low > high:
        yield path, f"min = {low:g} is above max = {high:g}; swap them"
    elif stated < low or stated > high:
        message = f"{low:.12g} to {high:.12g} does not include device.{key} = {stated:.12g}; move one of them"
        yield path, message
    elif PART_NUMBERS[key].quantity == "rate":
        least, most = SLOWEST / file.T, (0.5 if PART_NUMBERS[key].sampled else FASTEST) / file.T
        if stated <= most < high:
            yield (*path, "max"), f"{high:g} Hz is above {most:g} Hz; lower it"
        elif low < least <= stated:
            yield (*path, "min"), f"{low:g} Hz is below {least:g} Hz; raise it"


def _unmodelled(file: Stated) -> Found:
    """Yield frequencies of the disc that do not increase, and a stability band from 0 or to inf."""
    rows, key = file.value("uncertainty.unmodelled"), "uncertainty.unmodelled"
    if not isinstance(rows, list) or not rows:
        return
    hz = [file(("uncertainty", "unmodelled", row, 0)) for row in range(len(rows))]
    if any(b <= a for a, b in pairwise(hz)) and not any(map(isnan, hz)):
        yield key, "the frequencies do not increase; put them in order"
    if (last := max((at for at in hz if at > 0), default=nan)) > 0.5 / file.T * (1 + 1e-12):
        yield (
            key,
            f"{last:g} Hz is above the Nyquist frequency {0.5 / file.T:g} Hz: the disc is of the sampled response, in "
            "which a higher frequency shows below it; state the radius there, and leave this row out",
        )
    low, high = file.band("stability")
    if low == 0:
        yield "stability.band_hz", "a band from 0 cannot be proved of a response that is not known; raise the edge"
    if high == inf:
        yield "stability.band_hz", "a band to inf cannot be proved of a response that is not known; lower the edge"


def _display(file: Stated) -> Found:
    """Yield the keys without a meaning for the display, and the values that it does not permit."""
    if not isinstance(file.value("device"), dict):
        return
    kind = "servo" if file.servo else "impedance"
    display = "[device.servo]" if file.servo else 'device.display = "impedance"'
    for key, reason in MEANINGLESS[kind].items() if file.servo or file.impedance else ():
        if file.value(key) is not None:
            yield key, f"means nothing with {display}: {file.units.translated(reason)}; leave it out"
    if file.servo:
        yield from _hands_of_servo(file)
    elif file.impedance:
        if file.value("device.velocity.from") == "measured":
            yield from _measured(file)
        if file.value("device.hold") == "lag":
            yield "device.hold", '"lag" is not proved on an impedance display; write "zoh", or leave it out'
    else:
        if file.value("coupling.stiffness") is not None:
            message = 'is of an impedance display; write device.display = "impedance", or leave it out'
            yield "coupling.stiffness", message
        lowest = 0.0 if file.value("coupling.damping.max") is not None else nan
        for key, absent in (("coupling.damping", nan), ("coupling.damping.min", lowest)):
            if file(key, absent) == 0:
                message = "0 is too small on an admittance display, whose coupling it would open; write a positive one"
                yield key, message


def _measured(file: Stated) -> Found:
    """Yield what is not proved of an impedance display with a measured velocity."""
    key = "device.velocity.from"
    if file.value("environment.stiffness") != inf:
        yield (
            key,
            '"measured" is proved of a wall alone, since the coupling of a display that renders runs on the difference '
            'of the position; write environment.stiffness = inf, or "difference"',
        )
    elif file.value("stability.criterion") != "hands":
        yield (
            key,
            '"measured" is not proved in any passive hand, whose resonances above the sampling rate a measured '
            'velocity folds down without limit; write stability.criterion = "hands", or "difference"',
        )


def _law(file: Stated) -> Found:
    """Yield what M a + D v = F by Euler does not permit, and a step of it that goes beyond rest."""
    if file.value("coupling.rule") != "euler":
        return
    if not file.servo:
        yield "coupling.rule", '"euler" is the law of a [device.servo]; leave it out'
        return
    if file.value("coupling.damping") not in (None, inf):
        yield "coupling.damping", 'means nothing with rule = "euler": mass a + drag v = F has none; leave it out'
    mass, drag = file("coupling.mass"), file("coupling.drag")
    if file.value("environment.walls") is True and (isnan(mass) or isnan(drag)):
        yield "coupling.rule", '"euler" is not solved for with walls; fix mass and drag, or leave it out'
    if mass <= (least := drag * file.T):
        yield "coupling.mass", f"{mass:g} is not above drag times sample_time, {least:g}: {BEYOND_REST}"


def _rest(file: Stated) -> Found:
    """Yield a demand of rest without friction or resolution, and with a range of which nothing rests."""
    if file.value("stability.rest") is not True or file.servo:
        return
    needed = {"device.friction": "dry friction, N", "device.velocity.resolution": "step of the encoder, m"}
    for key, what in needed.items():
        if file.value(key) is None:
            message = f"needs {key}, the {file.units.translated(what)}; state it, or leave rest out"
            yield "stability.rest", message
    if file("device.friction") == 0 and file.impedance:
        yield "device.friction", "0 holds no step of the encoder, so that no wall rests; raise it, or leave rest out"
    key = "coupling.stiffness" if file.impedance else "gains.position"
    stiffest = 2 * file("device.friction") / file("device.velocity.resolution", nan)
    if (least := file(f"{key}.min")) > stiffest:
        message = f"min = {least:g} is above 2 friction/resolution = {stiffest:g}, the greatest that rests; lower it"
        yield key, message


def _damping(file: Stated) -> Found:
    """Yield why a damping ratio cannot be demanded: without a box of environments, or of what has no proof."""
    key = "stability.damping_ratio"
    if file.value(key) is None:
        return
    rigid = file.impedance and file.value("environment.stiffness") == inf
    if not file.servo and not rigid:
        yield (
            key,
            "is proved of a [device.servo], and of a wall (environment.stiffness = inf) of an impedance display; leave "
            "it out",
        )
    elif rigid and file.value("stability.criterion") != "hands":
        yield key, 'in any passive hand one rings for ever; write stability.criterion = "hands", or leave it out'
    elif file.servo and not isinstance(file.value("environment"), dict):
        yield (
            key,
            "with every passive environment one rings for ever; state those that you render in [environment], for "
            "nothing mass.max = 0 and stiffness.max = 0",
        )
    if file.value("environment.walls") is True:
        yield key, "is not proved with walls, which are met and left; leave one of them out"
    if file.value("uncertainty.unmodelled"):
        yield "uncertainty.unmodelled", "is not proved with stability.damping_ratio; leave one of them out"
    if not file.servo or not file.table("environment"):
        return
    least, most = file("environment.mass.min"), file("environment.mass.max")
    if not (file("environment.mass") >= 0 or most == 0 or (least > 0 and most > 0)):
        yield (
            "environment.mass",
            "may be next to nothing or without limit, which rings at half the sampling rate or on a spring for ever: "
            "with stability.damping_ratio write max = 0, or a min above 0 and a max",
        )
    if isnan(file("environment.stiffness")) and isnan(file("environment.stiffness.max")):
        yield "environment.stiffness", "has no greatest value, which stability.damping_ratio needs; write max"


def _calm(file: Stated) -> Found:
    """Yield why kicks cannot be demanded to come to rest: of another display than a wall, or where nothing rubs."""
    if file.value("stability.calm") is not True:
        return
    if not (file.impedance and file.value("environment.stiffness") == inf):
        yield "stability.calm", "is of a wall (environment.stiffness = inf) of an impedance display; leave it out"
    elif file.value("device.friction") is None and file.value("device.velocity.resolution") is None:
        yield "stability.calm", "needs device.friction and device.velocity.resolution, without which nothing buzzes"


def _hands_of_servo(file: Stated) -> Found:
    """Yield a criterion of any passive hand, and a box whose only hand has no impedance and meets no spring."""
    if (criterion := file.value("stability.criterion")) in ("passive", "both"):
        yield (
            "stability.criterion",
            f'"{criterion}" asks for any passive hand, and no servo is stable in a hand of unlimited stiffness, since '
            'it follows late; write "hands", or leave it out, and state the stiffest contact in [operator]',
        )
    toolless = not any(file(f"{key}{end}") > 0 for key in TOOL for end in ("", ".max"))
    handless = all(0 in (file(key), file(f"{key}.max")) for key in HAND)
    if handless and toolless and not file("device.servo.stiffness", 0.0) > 0:
        yield "operator", "no hand of it pushes, so that nothing is fed back; give one of its ranges a positive max"


def _names(file: Stated) -> Found:
    names = [table.get("name") for table in file.tables("experiment")]
    for index, name in enumerate(names):
        if isinstance(name, str) and name in names[:index]:
            yield ("experiment", index, "name"), f"{name!r} is the name of another experiment; choose its own"


def _motion(file: Stated) -> Found:
    """Yield a hand that is not connected or does not move, and strokes that are too short or too long."""
    usual = _defaults(MovingHand)
    start, end, speed, cycles, damping, stiffness = (file(f"experiment.operator.{key}", usual[key]) for key in MOTION)
    motion = file.value("experiment.operator.motion")
    if motion == "kick" and speed == 0 and start == end:
        yield (
            "experiment.operator",
            f"from and to are both {start:g}, and speed is 0: nothing moves; change one of them",
        )
    if motion in ("kick", "hold"):
        start = nan  # there is no stroke
    samples = abs(end - start) / (speed if speed > 0 else nan) / file.T
    if file.servo and motion == "kick":
        yield "experiment.operator.motion", f'"kick" means nothing with [device.servo]: {_UNMOVED}; write "hold"'
    if damping == 0 and stiffness == 0:
        message = "damping and stiffness are both 0: the hand does not move the handle; give it one of them"
        yield "experiment.operator", message
    elif speed == 0 and motion not in ("kick", "hold"):
        yield "experiment.operator.speed", '0: the hand does not move; write a speed, or motion = "kick" for a release'
    if start == end:
        yield "experiment.operator", f"from and to are both {start:g}: nothing moves; give them different places"
    elif 0 < samples < LEAST_STROKE:
        message = f"a stroke takes {samples:.3g} sample times; move slower or further: at least {LEAST_STROKE}"
        yield "experiment.operator.speed", message
    if (longest := pi * cycles * samples) > MOST_SAMPLES:
        message = f"about {longest:.3g} samples; at most {MOST_SAMPLES}: fewer cycles, faster or less far"
        yield "experiment.operator", message


def _rendering(file: Stated) -> Found:
    """Yield the environments and baselines that the simulation does not allow."""
    stated, world = file.raw["experiment"].get("environment", {}), "experiment.environment"
    if not isinstance(stated, dict):
        return
    wall, late, rule = stated.get("wall") is True, stated.get("late"), stated.get("rule")
    if wall and file(f"{world}.stiffness", 0.0) == 0:
        yield f"{world}.wall", "a wall needs a stiffness"
    if wall and (rule == "explicit" or (rule == "trapezoid" and file.value("environment.walls") is not True)):
        yield f"{world}.rule", "a wall is passive by backward Euler alone; leave the rule out"
    if stated.get("stiffness") == inf:
        if not file.impedance:
            message = "what an admittance display renders must move; write a number, such as 1e6"
            yield f"{world}.stiffness", message
        for key in ("mass", "damping", "late", "rule"):
            if stated.get(key):
                yield f"{world}.{key}", "means nothing of a rigid environment; leave it out"
    if wall and late:
        yield f"{world}.late", "a wall is simulated on time alone; leave it out, or write wall = false"
    if file.value("experiment.baseline") and (late or rule == "explicit"):
        message = "the regular PID renders environments on time alone, and not by explicit Euler; leave it out"
        yield "experiment.baseline", message
    free = wall or not any(file(f"{world}.{key}", 0.0) > 0 for key in ("mass", "damping", "stiffness"))
    if free and file("experiment.baseline.mass") == 0 == file("experiment.baseline.damping"):
        message = "mass and damping are both 0: a free handle would have no limit to its speed; give one of them"
        yield "experiment.baseline", message


def _hardware(file: Stated) -> Found:
    coulomb, stiction = (file(f"experiment.friction.{key}") for key in ("coulomb", "stiction"))
    if stiction < coulomb:
        yield "experiment.friction.stiction", f"{stiction:g} is below coulomb = {coulomb:g}; swap them"
    for key, reason in MEANINGLESS_IN_EXPERIMENT.items():
        if file.servo and file.value(key) not in (None, 0):
            yield key, f"means nothing with [device.servo]: {file.units.translated(reason)}; leave it out"


def _rotary_hands(file: Stated) -> Found:
    """Yield the missing ranges of the hands, if a rotary problem requires a box of them."""
    criterion = file.value("stability.criterion")
    required = criterion == "hands" or (criterion in ("both", None) and not file.impedance)
    lacking = [key for key in HAND if file.value(key) is None and isinstance(file.raw.get("operator", {}), dict)]
    if file.units is not ROTARY or not (required and lacking):
        return
    greatest, has_a_choice = HUMAN_HANDS.high.by_key, not file.servo and file.value("environment") is None
    written = ", ".join(f"{key.partition('.')[2]} = {{ min = 0, max = {greatest[key]:g} r^2 }}" for key in lacking)
    otherwise = ', or ask for stability.criterion = "passive"' if has_a_choice else ""
    yield (
        "operator",
        f"a rotary device has no default hands, since they depend on how far from its axis it is held: write {written} "
        f"for a hand that holds it r metres from the axis{otherwise}",
    )


def _defaults(table: type) -> dict[str, Any]:
    """Return the defaults of a table by its keys."""
    keys = keys_of_table(table)
    return {keys[each.name]: each.default for each in fields(table) if each.name in keys}


def _rotary_defaults(file: Stated) -> Found:
    """Yield those absent keys of a rotary experiment whose defaults are in the units of a linear device."""
    for name, usual, model in (("operator", {}, MovingHand), ("friction", None, Friction)):
        stated = file.raw["experiment"].get(name, usual)
        for key, default in _defaults(model).items() if isinstance(stated, dict) and file.units is ROTARY else ():
            unit, of_rotary = (unit_of(("experiment", name, key), units) for units in (LINEAR, ROTARY))
            if key not in stated and isinstance(default, float) and default and unit != of_rotary:
                message = f"is missing; a rotary device has no default for it: write a number of {of_rotary}"
                yield f"experiment.{name}.{key}", message
