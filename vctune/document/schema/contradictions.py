"""Find contradictions in a problem file between values that are valid on their own."""

from __future__ import annotations

from collections.abc import Iterator
from math import floor, inf, isfinite, pi
from typing import Any

from vctune.document.schema.device_contradictions import MAX_DELAY_SAMPLES, impossible_parts
from vctune.document.schema.display_contradictions import impossible_display
from vctune.document.schema.experiment_contradictions import impossible_experiments
from vctune.document.schema.plausibility import in_finer_unit
from vctune.document.schema.rotary_contradictions import missing_of_rotary
from vctune.document.schema.validation import Contradiction
from vctune.document.text.raw import number_at
from vctune.model.hands import HAND
from vctune.model.numbers.keys import KEYS, SPRING_KEYS
from vctune.model.parts import PARTS

MAX_DECADES = 12  # Greatest width of a band, in decades of frequency


def contradictions(raw: dict[str, Any]) -> list[Contradiction]:
    """Return contradictions between values that are valid on their own."""
    return [
        *_empty_ranges(raw),
        *_impossible_bands(raw),
        *_impossible_numbers(raw),
        *_impossible_criterion(raw),
        *_unproved_worlds(raw),
        *impossible_display(raw),
        *impossible_experiments(raw),
        *missing_of_rotary(raw),
    ]


def _empty_ranges(raw: dict[str, Any]) -> Iterator[Contradiction]:
    """Yield the ranges whose least value is above the greatest."""
    for key in (*KEYS, *SPRING_KEYS[3:], *HAND, "environment.mass", "environment.stiffness"):
        path = tuple(key.split("."))
        low, high = number_at(raw, *path, "min"), number_at(raw, *path, "max")
        if low is not None and high is not None and low > high:
            yield path, f"min = {low:g} is above max = {high:g}; swap them"


def _impossible_bands(raw: dict[str, Any]) -> Iterator[Contradiction]:
    """Yield the bands without a width, with too many decades, or with an edge that the device does not permit."""
    sample_time, delay = number_at(raw, "device", "sample_time"), number_at(raw, "device", "delay") or 0.0
    to_infinity = raw.get("device", {}).get("hold") == "lag" if isinstance(raw.get("device"), dict) else False
    to_infinity = to_infinity and delay == 0 and not any(part in raw["device"] for part in PARTS)
    for table in ("transparency", "stability"):
        path = (table, "band_hz")
        low, high = number_at(raw, *path, 0), number_at(raw, *path, 1)
        endless = _is_infinite(raw, table, 1)
        if low is not None and high is not None and low >= high:
            yield path, f"the lower edge {low:g} Hz is not below the upper edge {high:g} Hz; a band needs a width"
        if _is_infinite(raw, table, 0):
            yield path, "the lower edge is infinite; use a finite one"
        if low and high and high > low * 10.0**MAX_DECADES > 0:
            yield path, f"from {low:g} to {high:g} Hz are more than {MAX_DECADES} decades; narrow it"
        if high is not None and sample_time and sample_time > 0 and high > 0.5 / sample_time * (1 + 1e-12):
            nyquist = 0.5 / sample_time
            yield path, f"the upper edge {high:g} Hz is above the Nyquist frequency {nyquist:g} Hz; lower it"
        if table == "stability" and endless and not to_infinity:
            yield path, 'the upper edge inf needs hold = "lag", delay = 0 and no parts of the device; use a finite one'


def _impossible_criterion(raw: dict[str, Any]) -> Iterator[Contradiction]:
    """Yield the fault of unmodelled dynamics that the stated criterion does not cover."""
    stability, uncertainty = raw.get("stability"), raw.get("uncertainty")
    criterion = stability.get("criterion") if isinstance(stability, dict) else None
    device = raw.get("device")
    servo = isinstance(device, dict) and "servo" in device
    if criterion == "hands" and not servo and isinstance(uncertainty, dict) and uncertainty.get("unmodelled"):
        yield (
            ("uncertainty", "unmodelled"),
            'is not covered by the proof in hands; leave it out, or write stability.criterion = "both" or "passive"',
        )


def _unproved_worlds(raw: dict[str, Any]) -> Iterator[Contradiction]:
    """Yield the claims that cannot be proved together with a box of environments."""
    if not isinstance(raw.get("environment"), dict):
        return
    stability, uncertainty = raw.get("stability"), raw.get("uncertainty")
    criterion = stability.get("criterion") if isinstance(stability, dict) else None
    if criterion in ("passive", "both"):
        yield (
            ("stability", "criterion"),
            f'"{criterion}" allows any passive hand with every passive environment, while [environment] states which '
            'there are; write "hands", or leave out the criterion or [environment]',
        )
    if isinstance(uncertainty, dict) and uncertainty.get("unmodelled"):
        yield ("uncertainty", "unmodelled"), "is not proved with [environment]; leave one of them out"
    yield from _unproved_walls(raw)


def _unproved_walls(raw: dict[str, Any]) -> Iterator[Contradiction]:
    """Yield the keys that the proof for walls does not allow, and a corner without walls."""
    table, corner = raw["environment"], number_at(raw, "environment", "corner_hz")
    if table.get("walls") is not True:
        if corner is not None:
            yield ("environment", "corner_hz"), "applies only to walls; write walls = true, or leave it out"
        return
    most, least = number_at(raw, "environment", "stiffness", "max"), number_at(raw, "environment", "stiffness", "min")
    if most is None or most == inf:
        yield (
            ("environment", "walls"),
            "needs a stiffest wall; state stiffness.max, or leave out [environment]: the claim then covers every "
            "passive environment, including walls of any stiffness",
        )
    elif most == (least or 0.0):
        yield ("environment", "walls"), f"needs a range of stiffness, not {most:g} alone; a wall has two slopes"
    sample_time = number_at(raw, "device", "sample_time")
    if corner and sample_time and sample_time > 0 and corner * pi * sample_time > 1:
        # rounded down to six digits
        highest = float(f"{1 / (pi * sample_time) * (1 - 5e-7):.6g}")
        yield ("environment", "corner_hz"), f"{corner:g} Hz is above 1/(pi sample_time); write at most {highest:g}"


def _is_infinite(raw: dict[str, Any], table: str, edge: int) -> bool:
    try:
        return bool(raw[table]["band_hz"][edge] == inf)
    except (KeyError, IndexError, TypeError):
        return False


def _impossible_numbers(raw: dict[str, Any]) -> Iterator[Contradiction]:
    """Yield impossible values of the safety factor, the weights, the delays and the parameters of parts."""
    factor = number_at(raw, "stability", "safety_factor")
    if factor is not None and isfinite(factor) and 0 < factor < 1:
        yield ("stability", "safety_factor"), f"{factor:g} is below 1, where the handle is not absolutely stable"
    weights = [number_at(raw, "transparency", "weights", term) for term in ("admittance", "tracking", "coupling")]
    if all(weight == 0 for weight in weights):
        yield ("transparency", "weights"), "all three are 0: nothing is left to optimise; give one a positive weight"
    yield from _long_delays(raw)
    yield from impossible_parts(raw)


def _long_delays(raw: dict[str, Any]) -> Iterator[Contradiction]:
    for path in (("delay",), ("servo", "delay")):
        yield from _long_delay(raw, path)


def _long_delay(raw: dict[str, Any], path: tuple[str, ...]) -> Iterator[Contradiction]:
    """Yield the fault of a delay that, with its uncertainty, has too many samples."""
    key, sample_time, delay = ".".join(path), number_at(raw, "device", "sample_time"), number_at(raw, "device", *path)
    if not (sample_time and delay and sample_time > 0 and isfinite(delay)):
        return
    samples, share = delay / sample_time, number_at(raw, "uncertainty", key) or 0.0
    if samples > MAX_DELAY_SAMPLES:
        unit, instead = in_finer_unit(delay, MAX_DELAY_SAMPLES * sample_time)
        hint = f"; is it in {unit}? Then write {instead:g}" if instead < MAX_DELAY_SAMPLES * sample_time else ""
        message = f"{delay:.12g} s is {samples:.12g} sample times; at most {MAX_DELAY_SAMPLES} are supported{hint}"
        yield ("device", *path), message
    elif samples * (1 + share) > MAX_DELAY_SAMPLES and share < 1:
        most = floor((MAX_DELAY_SAMPLES / samples - 1) * 1e6) / 1e6
        yield (
            ("uncertainty", key),
            f"{share:.12g} lets device.{key} = {delay:.12g} s reach {samples * (1 + share):.12g} sample times; at most "
            f"{MAX_DELAY_SAMPLES} are supported: write at most {most:g}, or a shorter device.{key}",
        )
