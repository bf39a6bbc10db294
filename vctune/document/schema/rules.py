"""Find contradictions between values of a problem file that are valid on their own."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from itertools import pairwise
from math import floor, inf, pi
from typing import Any

from vctune.document.schema.number_units import unit_of, units_stated
from vctune.document.schema.validation import Contradiction
from vctune.document.text.hints import LONGEST_SAMPLE, in_finer_unit, seconds_meant
from vctune.document.text.toml import number_at
from vctune.model.experiment import Environment, Friction, Operator
from vctune.model.fields import keys_of_table
from vctune.model.hands import HAND
from vctune.model.numbers.units import KEYS, LINEAR, ROTARY, SPRING_KEYS
from vctune.model.parts import DELAYS, LOOP_DELAYS, NUMBERS, PARTS
from vctune.model.problem import HUMAN_HANDS

Found = Iterator[Contradiction]
MAX_DECADES = 12  # Greatest width of a band, in decades of frequency
# Greatest permitted delay of the device or the servo, and of its force sensor, each with its uncertainty, in samples
MAX_DELAY_SAMPLES = 200
FASTEST, SLOWEST = 1e3, 1e-6  # Greatest and least bandwidth or resonance, as a share of the sampling rate
LEAST_STROKE = 4  # Least duration of a stroke at the greatest speed of the hand, sample times
MOST_SAMPLES = 5_000_000  # Greatest number of samples of an experiment
_UNMOVED = "the hand does not move it: its motion follows the command alone"
_PARALLEL = "its coupling is coupling.damping beside coupling.stiffness"
# Keys without a meaning for a kind of display, each with the reason
MEANINGLESS: dict[str, dict[tuple[str, ...], str]] = {
    "impedance": {
        ("device", "force_sensor"): "it senses no force",
        ("gains", "position"): "it has no velocity loop, whose error an integrator would add up",
        ("coupling", "mass"): _PARALLEL,
        ("coupling", "drag"): _PARALLEL,
        ("stability", "band_hz"): "its demands are proved at every frequency up to the Nyquist frequency",
        ("uncertainty", "unmodelled"): "its demands are not proved of a response that is not known",
    },
    "servo": {
        ("device", "mass"): _UNMOVED,
        ("device", "damping"): _UNMOVED,
        ("device", "delay"): "the delay is device.servo.delay",
        ("device", "hold"): "its command is held over a sample, or interpolated",
        ("device", "display"): "a servo is an admittance display",
        ("device", "velocity"): "no gain of this file acts on its velocity",
        ("device", "actuator"): "its lag is device.servo.bandwidth_hz and order",
        ("device", "structure"): "a spring behind its loop is not modelled",
        ("gains",): "its loop is the vendor's; only the coupling is designed",
        ("coupling", "stiffness"): "its coupling is damping and mass in series, beside drag",
        ("stability", "band_hz"): "its requirements are proved at every frequency up to the Nyquist frequency",
        ("uncertainty", "mass"): _UNMOVED,
        ("uncertainty", "damping"): _UNMOVED,
        ("uncertainty", "delay"): 'the delay is "servo.delay"',
        ("stability", "max_sensitivity"): "the file closes no loop of its own that could be too sensitive",
    },
}
# Keys of an experiment without a meaning for a servo; a number of 0 says the same as no number
MEANINGLESS_IN_EXPERIMENT: dict[tuple[str, ...], str] = {
    ("friction",): "the hand does not move it, and its motion follows the command whatever rubs",
    ("sensors", "position_resolution"): "the firmware reads no position of it",
    ("actuator", "limit"): "the firmware commands no force",
    ("baseline",): "a regular PID commands a force, which it does not take",
}


def contradictions(raw: dict[str, Any]) -> list[Contradiction]:
    """Return the contradictions in the valid parts of a problem's tables."""
    rules = (_ranges, _bands, _constraints, _environments, _long_delays, impossible_parts, _display, _experiments)
    found = [each for rule in (*rules, _missing_of_rotary) for each in rule(raw)]
    if found and (T := _sample_time(raw) or 0.0) >= LONGEST_SAMPLE:  # the others may follow from it
        return [(("device", "sample_time"), f"is {T:g} s; {seconds_meant(T)}")]
    return found


def impossible_parts(raw: dict[str, Any]) -> Found:
    """Yield the contradictions in the parts of a device and in its uncertainty."""
    if isinstance(raw.get("device"), dict):
        for rule in (_rates, _low_passes, _masses, _uncertain, _unmodelled):
            yield from rule(raw)


def _table(raw: Any, *path: str) -> dict[str, Any]:
    """Return the table at a path; empty if there is none."""
    for key in path:
        raw = raw.get(key) if isinstance(raw, dict) else None
    return raw if isinstance(raw, dict) else {}


def _stated(raw: dict[str, Any], path: tuple[str, ...]) -> bool:
    return path[-1] in _table(raw, *path[:-1])


def _sample_time(raw: dict[str, Any]) -> float | None:
    T = number_at(raw, "device", "sample_time")
    return T if T and T > 0 else None


def _ranges(raw: dict[str, Any]) -> Found:
    for key in (*KEYS, *SPRING_KEYS[3:], *HAND, "environment.mass", "environment.stiffness"):
        path = tuple(key.split("."))
        low, high = number_at(raw, *path, "min"), number_at(raw, *path, "max")
        if low is not None and high is not None and low > high:
            yield path, f"min = {low:g} is above max = {high:g}; swap them"


def _bands(raw: dict[str, Any]) -> Found:
    """Yield the bands without a width, with too many decades, or with an edge that the device does not permit."""
    T, device = _sample_time(raw), _table(raw, "device")
    to_infinity = device.get("hold") == "lag" and not number_at(raw, "device", "delay") and not set(PARTS) & set(device)
    for table in ("transparency", "stability"):
        path, edges = (table, "band_hz"), _table(raw, table).get("band_hz")
        low, high = number_at(raw, *path, 0), number_at(raw, *path, 1)
        endless = [edge == inf for edge in edges[:2]] if isinstance(edges, list) else []
        if low is not None and high is not None and low >= high:
            yield path, f"the lower edge {low:g} Hz is not below the upper edge {high:g} Hz; a band needs a width"
        if endless[:1] == [True]:
            yield path, "the lower edge is infinite; use a finite one"
        if low and high and high > low * 10.0**MAX_DECADES > 0:
            yield path, f"from {low:g} to {high:g} Hz are more than {MAX_DECADES} decades; narrow it"
        if high is not None and T and high > 0.5 / T * (1 + 1e-12):
            yield path, f"the upper edge {high:g} Hz is above the Nyquist frequency {0.5 / T:g} Hz; lower it"
        if table == "stability" and endless[1:] == [True] and not to_infinity:
            yield path, 'the upper edge inf needs hold = "lag", delay = 0 and no parts of the device; use a finite one'


def _constraints(raw: dict[str, Any]) -> Found:
    """Yield an impossible safety factor, weights that are all 0, and a criterion that does not cover the device."""
    factor = number_at(raw, "stability", "safety_factor")
    if factor is not None and 0 < factor < 1:
        yield ("stability", "safety_factor"), f"{factor:g} is below 1, where the handle is not absolutely stable"
    if all(number_at(raw, "transparency", "weights", term) == 0 for term in ("admittance", "tracking", "coupling")):
        yield ("transparency", "weights"), "all three are 0: nothing is left to optimise; give one a positive weight"
    in_hands = _table(raw, "stability").get("criterion") == "hands" and "servo" not in _table(raw, "device")
    if in_hands and _table(raw, "uncertainty").get("unmodelled"):
        yield (
            ("uncertainty", "unmodelled"),
            'is not covered by the proof in hands; leave it out, or write stability.criterion = "both" or "passive"',
        )


def _environments(raw: dict[str, Any]) -> Found:
    """Yield the claims that cannot be proved with a box of environments, and the keys that walls do not allow."""
    if not isinstance(raw.get("environment"), dict):
        return
    if _table(raw, "device").get("display") == "impedance":
        yield from _rigid_world(raw)
        return
    if _table(raw, "environment").get("stiffness") == inf:
        yield (
            ("environment", "stiffness"),
            "a rigid world is of an impedance display, whose coupling is then a wall; write the stiffest spring that "
            "the device renders, or leave it out",
        )
    criterion, corner = _table(raw, "stability").get("criterion"), number_at(raw, "environment", "corner_hz")
    if criterion in ("passive", "both") and "servo" not in _table(raw, "device"):  # a servo has no such criterion
        yield from _any_hand_alone(raw, criterion)
    if _table(raw, "uncertainty").get("unmodelled"):
        yield ("uncertainty", "unmodelled"), "is not proved with [environment]; leave one of them out"
    if raw["environment"].get("walls") is not True:
        if corner is not None:
            yield ("environment", "corner_hz"), "applies only to walls; write walls = true, or leave it out"
        return
    least, most = (number_at(raw, "environment", "stiffness", end) for end in ("min", "max"))
    if most is None:
        yield (
            ("environment", "walls"),
            "needs a stiffest wall; state stiffness.max, or leave out [environment]: the claim then covers every "
            "passive environment, including walls of any stiffness",
        )
    elif most == (least or 0.0):
        yield ("environment", "walls"), f"needs a range of stiffness, not {most:g} alone; a wall has two slopes"
    T = _sample_time(raw)
    if corner and T and corner * pi * T > 1:
        highest = float(f"{1 / (pi * T) * (1 - 5e-7):.6g}")  # rounded down to six digits
        yield ("environment", "corner_hz"), f"{corner:g} Hz is above 1/(pi sample_time); write at most {highest:g}"


def _any_hand_alone(raw: dict[str, Any], criterion: str) -> Found:
    """Yield why any passive hand cannot be asked for with a box of environments, or with nothing behind."""
    most = [number_at(raw, "environment", *path) for path in (("mass", "max"), ("stiffness", "max"), ("stiffness",))]
    if most[0] != 0 or 0 not in most[1:] or number_at(raw, "environment", "damping", "min"):
        yield (
            ("stability", "criterion"),
            f'"{criterion}" allows any passive hand, which is proved with every passive environment or with nothing '
            "behind (mass.max = 0, stiffness.max = 0), while [environment] states others; "
            'write "hands", or leave out the criterion or [environment]',
        )
        return
    band = _table(raw, "stability").get("band_hz")
    for edge, endless in enumerate((0.0, inf)):
        if isinstance(band, list) and band[edge : edge + 1] == [endless]:
            yield ("stability", "band_hz", edge), f"{endless:g} has no proof with nothing behind; state another edge"
    for path in (("gains", "velocity"), ("gains", "position")):
        if number_at(raw, *path) is None:
            yield path, f'must be one number: with nothing behind, "{criterion}" asks for mass and drag for given gains'
    if _table(raw, "coupling").get("damping") not in (None, inf):
        yield ("coupling", "damping"), "holds nothing with nothing behind; write inf, or leave it out"


def _rigid_world(raw: dict[str, Any]) -> Found:
    """Yield what a file with an impedance display states beside a rigid world, or instead of it."""
    stated = raw["environment"]
    if stated.get("stiffness") != inf:
        yield (
            ("environment",),
            'means nothing with device.display = "impedance", whose demands are proved with every passive environment: '
            "write stiffness = inf if its coupling is a wall, or leave it out",
        )
        return
    for key in (key for key in stated if key != "stiffness"):
        yield ("environment", key), "means nothing beside stiffness = inf: nothing moves behind a wall; leave it out"
    if _table(raw, "gains").get("velocity") not in (None, 0):
        yield ("gains", "velocity"), "adds to coupling.damping, which is the damping of the wall; leave it out"


def _long_delays(raw: dict[str, Any]) -> Found:
    """Yield a delay that, with its uncertainty, has too many samples."""
    for key in LOOP_DELAYS:
        T, delay = _sample_time(raw), number_at(raw, "device", *key.split("."))
        if not (T and delay):
            continue
        samples, share, most = delay / T, number_at(raw, "uncertainty", key) or 0.0, MAX_DELAY_SAMPLES
        if samples > most:
            unit, instead = in_finer_unit(delay, most * T)
            hint = f"; is it in {unit}? Then write {instead:g}" if instead < most * T else ""
            yield (
                ("device", *key.split(".")),
                f"{delay:.12g} s is {samples:.12g} sample times; at most {most} are supported{hint}",
            )
        elif samples * (1 + share) > most and share < 1:
            greatest = floor((most / samples - 1) * 1e6) / 1e6
            yield (
                ("uncertainty", key),
                f"{share:.12g} lets device.{key} = {delay:.12g} s reach {samples * (1 + share):.12g} sample times; at "
                f"most {most} are supported: write at most {greatest:g}, or a shorter device.{key}",
            )


def _rates(raw: dict[str, Any]) -> Found:
    """Yield the bandwidths and resonances that do not fit the sample time, and too long delays of the sensed force."""
    T = _sample_time(raw)
    for part, each in ((key, each) for key, of in PARTS.items() for each in of.numbers):
        path, key = ("device", part, each.name), f"{part}.{each.name}"
        number = number_at(raw, *path)
        if not T or number is None or number <= 0:
            continue
        if each.quantity == "rate" and each.sampled:
            if number > 0.5 / T:
                yield path, f"{number:g} Hz is above the Nyquist frequency {0.5 / T:g} Hz; lower it, or leave it out"
        elif each.quantity == "rate":
            if number * T > FASTEST:
                remedy = "lower it" if part == "servo" else "leave the table out"
                yield path, f"{number:g} Hz is above {FASTEST / T:g} Hz, where it does nothing; {remedy}"
            if number * T < SLOWEST:
                yield path, f"{number:g} Hz is below {SLOWEST / T:g} Hz; raise it"
        elif key in DELAYS and key not in LOOP_DELAYS:
            samples = number / T * (1 + (number_at(raw, "uncertainty", key) or 0.0))
            if samples > MAX_DELAY_SAMPLES:
                most = f"at most {MAX_DELAY_SAMPLES} are supported"
                yield path, f"{number:.12g} s is up to {samples:.12g} sample times; {most}"


def _low_passes(raw: dict[str, Any]) -> Found:
    """Yield the order of a low-pass without its frequency, and the resolution of what is not differenced."""
    device = raw["device"]
    for part, each in ((key, each) for key, of in PARTS.items() for each in of.numbers if each.order_key):
        if each.order_key in _table(device, part) and each.name not in device[part]:
            yield ("device", part, each.order_key), f"is of a low-pass; write {each.name} too, or leave it out"
    velocity, usual = _table(device, "velocity"), "difference" if device.get("display") == "impedance" else "measured"
    if "resolution" in velocity and velocity.get("from", usual) == "measured":
        yield ("device", "velocity", "resolution"), 'is of a position that is differenced; write from = "difference"'


def _masses(raw: dict[str, Any]) -> Found:
    """Yield a handle that is not lighter than the whole device, both with their uncertainty."""
    mass, handle = number_at(raw, "device", "mass"), number_at(raw, "device", "structure", "handle_mass")
    if not (mass and handle and mass > 0 and handle > 0):
        return
    unit = units_stated(raw).mass
    less, more = (number_at(raw, "uncertainty", key) or 0.0 for key in ("mass", "structure.handle_mass"))
    if handle >= mass:
        yield (
            ("device", "structure", "handle_mass"),
            f"{handle:g} {unit} is not less than device.mass = {mass:g} {unit}, of which it is a part",
        )
    elif less < 1 and handle * (1 + more) >= mass * (1 - less):
        yield (
            ("uncertainty", "structure.handle_mass" if more else "mass"),
            f"lets the handle, {handle * (1 + more):g} {unit}, be as heavy as the device, {mass * (1 - less):g} {unit}",
        )


def _uncertain(raw: dict[str, Any]) -> Found:
    """Yield the uncertainties in the wrong place, and those of numbers that the device lacks."""
    table = _table(raw, "uncertainty")
    for key in NUMBERS:
        part, _, name = key.rpartition(".")
        if part and name in _table(table, part):
            yield ("uncertainty", part, name), f'belongs in quotes: "{key}" = {table[part][name]}'
        if key == "servo.delay" and table.get(key) and name in (servo := _table(raw, "device", part)):
            if "bandwidth_hz" not in servo:
                text = "of a latency whose bandwidth is unknown; state the greatest delay instead, or the bandwidth_hz"
                yield ("uncertainty", key), text
        elif part and table.get(key) and name not in _table(raw, "device", part):
            yield ("uncertainty", key), f"there is no device.{key} to be uncertain; write it, or leave this out"


def _unmodelled(raw: dict[str, Any]) -> Found:
    """Yield frequencies of the disc that do not increase, and a stability band from 0 or to inf."""
    rows, path = _table(raw, "uncertainty").get("unmodelled"), ("uncertainty", "unmodelled")
    if not isinstance(rows, list) or not rows:
        return
    hz = [number_at(raw, *path, k, 0) for k in range(len(rows))]
    if any(b <= a for a, b in pairwise(at for at in hz if at is not None)) and None not in hz:
        yield path, "the frequencies do not increase; put them in order"
    T, last = _sample_time(raw), max((at for at in hz if at is not None), default=0.0)
    if T and last > 0.5 / T * (1 + 1e-12):
        yield (
            path,
            f"{last:g} Hz is above the Nyquist frequency {0.5 / T:g} Hz: the disc is of the sampled response, in which "
            "a higher frequency shows below it; state the radius there, and leave this row out",
        )
    band, unknown = _table(raw, "stability").get("band_hz"), "cannot be proved of a response that is not known"
    if number_at(raw, "stability", "band_hz", 0) == 0:
        yield ("stability", "band_hz"), f"a band from 0 {unknown}; raise the edge"
    if isinstance(band, list) and inf in band[1:]:
        yield ("stability", "band_hz"), f"a band to inf {unknown}; lower the edge"


def _display(raw: dict[str, Any]) -> Found:
    """Yield the keys without a meaning for the display, and the values that it does not permit."""
    device = raw.get("device")
    if not isinstance(device, dict):
        return
    kind = "servo" if "servo" in device else "impedance" if device.get("display") == "impedance" else "admittance"
    display = {"servo": "[device.servo]", "impedance": 'device.display = "impedance"'}.get(kind, "")
    for path, reason in MEANINGLESS.get(kind, {}).items():
        if _stated(raw, path):
            yield path, f"means nothing with {display}: {units_stated(raw).translated(reason)}; leave it out"
    if kind == "servo":
        yield from _hands_of_servo(raw)
    elif kind == "impedance":
        if _table(device, "velocity").get("from") == "measured":
            yield (
                ("device", "velocity", "from"),
                '"measured" is not what an impedance display\'s coupling runs on; write "difference", or leave it out',
            )
        if device.get("hold") == "lag":
            yield ("device", "hold"), '"lag" is not proved on an impedance display; write "zoh", or leave it out'
    else:
        if _stated(raw, ("coupling", "stiffness")):
            yield (
                ("coupling", "stiffness"),
                'is of an impedance display; write device.display = "impedance", or leave it out',
            )
        for end in ((), ("min",)):
            if number_at(raw, "coupling", "damping", *end) == 0:
                yield (
                    ("coupling", "damping", *end),
                    "0 is too small on an admittance display, whose coupling it would open; write a positive one",
                )


def _hands_of_servo(raw: dict[str, Any]) -> Found:
    """Yield a criterion of any passive hand, and a box whose only hand has no impedance and meets no spring."""
    criterion = _table(raw, "stability").get("criterion")
    if criterion in ("passive", "both"):
        yield (
            ("stability", "criterion"),
            f'"{criterion}" asks for any passive hand, and no servo is stable in a hand of unlimited stiffness, since '
            'it follows late; write "hands", or leave it out, and state the stiffest contact in [operator]',
        )
    ends = [(number_at(raw, *key.split(".")), number_at(raw, *key.split("."), "max")) for key in HAND]
    if all(0.0 in pair for pair in ends) and not number_at(raw, "device", "servo", "stiffness"):
        yield ("operator",), "no hand of it pushes, so that nothing is fed back; give one of its ranges a positive max"


def _experiments(raw: dict[str, Any]) -> Found:
    tables, names = raw.get("experiment"), list[object]()
    for index, table in enumerate(tables if isinstance(tables, list) else []):
        if not isinstance(table, dict):
            continue
        if isinstance(table.get("name"), str) and table["name"] in names:
            yield ("experiment", index, "name"), f"{table['name']!r} is the name of another experiment; choose its own"
        names.append(table.get("name"))
        for rule in (_motion, _rendering, _hardware):
            for path, message in rule(raw, table):
                yield ("experiment", index, *path), message


def _default(table: type, key: str) -> Any:
    keys = keys_of_table(table)
    return next(field.default for field in fields(table) if keys[field.name] == key)


def _value(table: dict[str, Any], model: type, group: str, key: str) -> float | None:
    """Return a number in a sub-table, or its default if it is absent; None if it is not a number."""
    values = table.get(group, {})
    if not isinstance(values, dict) or key in values:
        return number_at(table, group, key)
    return float(_default(model, key))


def _motion(raw: dict[str, Any], table: dict[str, Any]) -> Found:
    """Yield a hand that is not connected or does not move, and strokes that are too short or too long."""
    keys = ("from", "to", "speed", "cycles", "damping", "stiffness")
    start, end, speed, cycles, damping, stiffness = (_value(table, Operator, "operator", key) for key in keys)
    if damping == 0 and stiffness == 0:
        yield ("operator",), "damping and stiffness are both 0: the hand does not move the handle; give it one of them"
    if start is not None and start == end:
        yield ("operator",), f"from and to are both {start:g}: nothing moves; give them different places"
    elif start is not None and end is not None and (T := _sample_time(raw)) and speed and speed > 0:
        samples = abs(end - start) / speed / T
        if samples < LEAST_STROKE:
            yield (
                ("operator", "speed"),
                f"a stroke takes {samples:.3g} sample times; move slower or further: at least {LEAST_STROKE}",
            )
        if cycles and pi * cycles * samples > MOST_SAMPLES:
            yield (
                ("operator",),
                f"about {pi * cycles * samples:.3g} samples; at most {MOST_SAMPLES}: fewer cycles, faster or less far",
            )


def _rendering(raw: dict[str, Any], table: dict[str, Any]) -> Found:
    """Yield the environments and baselines that the simulation does not allow."""
    environment = table.get("environment", {})
    if not isinstance(environment, dict):
        return
    wall = environment.get("wall") is True
    if wall and _value(table, Environment, "environment", "stiffness") == 0:
        yield ("environment", "wall"), "a wall needs a stiffness"
    walls = _table(raw, "environment").get("walls") is True
    if wall and environment.get("rule") in ("explicit", *(() if walls else ("trapezoid",))):
        yield ("environment", "rule"), "a wall is passive by backward Euler alone; leave the rule out"
    if environment.get("stiffness") == inf:
        if _table(raw, "device").get("display") != "impedance":
            text = "what an admittance display renders must move; write a number, such as 1e6"
            yield ("environment", "stiffness"), text
        for key in ("mass", "damping", "late", "rule"):
            if environment.get(key):
                yield ("environment", key), "means nothing of a rigid environment; leave it out"
    if wall and environment.get("late"):
        yield ("environment", "late"), "a wall is simulated on time alone; leave it out, or write wall = false"
    if table.get("baseline") and (environment.get("late") or environment.get("rule") == "explicit"):
        yield (
            ("baseline",),
            "the regular PID renders environments on time alone, and not by explicit Euler; leave it out",
        )
    free = wall or not any(number_at(environment, key) for key in ("mass", "damping", "stiffness"))
    if free and [number_at(table, "baseline", key) for key in ("mass", "damping")] == [0, 0]:
        yield (
            ("baseline",),
            "mass and damping are both 0: a free handle would have no limit to its speed; give one of them",
        )


def _hardware(raw: dict[str, Any], table: dict[str, Any]) -> Found:
    coulomb, stiction = number_at(table, "friction", "coulomb"), number_at(table, "friction", "stiction")
    if coulomb is not None and stiction is not None and stiction < coulomb:
        yield ("friction", "stiction"), f"{stiction:g} is below coulomb = {coulomb:g}; swap them"
    for path, reason in MEANINGLESS_IN_EXPERIMENT.items():
        stated = _table(table, *path[:-1]).get(path[-1])
        if "servo" in _table(raw, "device") and stated not in (None, 0):
            yield path, f"means nothing with [device.servo]: {units_stated(raw).translated(reason)}; leave it out"


def _missing_of_rotary(raw: dict[str, Any]) -> Found:
    """Yield the numbers that a rotary problem lacks, because their defaults assume a hand or a length."""
    if units_stated(raw) is not ROTARY:
        return
    yield from _rotary_hands(raw)
    tables = raw.get("experiment")
    for index, table in enumerate(tables if isinstance(tables, list) else []):
        stated = table if isinstance(table, dict) else {}
        for name, usual, model in (("operator", {}, Operator), ("friction", None, Friction)):
            yield from _rotary_defaults(("experiment", index, name), stated.get(name, usual), model)


def _rotary_hands(raw: dict[str, Any]) -> Found:
    """Yield the missing ranges of the hands, if the problem requires a box of them."""
    stability, operator, device = raw.get("stability", {}), raw.get("operator", {}), raw["device"]
    criterion = stability.get("criterion", "both") if isinstance(stability, dict) else "both"
    any_hand = device.get("display") == "impedance"
    required = criterion == "hands" or (criterion == "both" and not any_hand)
    lacking = [key for key in HAND if isinstance(operator, dict) and key.partition(".")[2] not in operator]
    if not (required and lacking):
        return
    greatest, has_a_choice = HUMAN_HANDS.high.by_key, "servo" not in device and "environment" not in raw
    written = ", ".join(f"{key.partition('.')[2]} = {{ min = 0, max = {greatest[key]:g} r^2 }}" for key in lacking)
    otherwise = ', or ask for stability.criterion = "passive"' if has_a_choice else ""
    yield (
        ("operator",),
        f"a rotary device has no default hands, since they depend on how far from its axis it is held: write {written} "
        f"for a hand that holds it r metres from the axis{otherwise}",
    )


def _rotary_defaults(path: tuple[str | int, ...], stated: Any, table: type) -> Found:
    """Yield those absent keys of a table whose defaults are in the units of a linear device."""
    for key in keys_of_table(table).values() if isinstance(stated, dict) else ():
        unit, of_rotary = (unit_of((*path, key), units) for units in (LINEAR, ROTARY))
        default = _default(table, key)
        if key not in stated and isinstance(default, float) and default and unit != of_rotary:
            yield (*path, key), f"is missing; a rotary device has no default for it: write a number of {of_rotary}"
