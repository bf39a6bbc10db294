"""Find contradictions in the tables of a device's parts between values that are valid on their own."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from math import inf, isfinite
from typing import Any

from vctune.document.schema.number_units import units_stated
from vctune.document.schema.validation import Contradiction
from vctune.document.text.raw import number_at
from vctune.model.parts import DELAYS, LOOP_DELAYS, NUMBERS, PARTS, PartNumber

# Greatest permitted delay of the device or the servo, and of its force sensor, each with its uncertainty, in samples
MAX_DELAY_SAMPLES = 200
SENSED_DELAYS = set(DELAYS) - set(LOOP_DELAYS)  # Keys of the delays of the sensed force
FASTEST, SLOWEST = 1e3, 1e-6  # Greatest and least bandwidth or resonance, as a share of the sampling rate


def impossible_parts(raw: dict[str, Any]) -> Iterator[Contradiction]:
    """Yield the contradictions in the parts of a device and in the uncertainty of the device."""
    device = raw.get("device")
    if not isinstance(device, dict):
        return
    sample_time = number_at(raw, "device", "sample_time")
    if sample_time and sample_time > 0 and isfinite(sample_time):
        yield from _rates(raw, sample_time)
    yield from _filters(device)
    yield from _resolution(device)
    yield from _masses(raw)
    yield from _uncertain(raw, device)
    yield from _unmodelled(raw)


def _rates(raw: dict[str, Any], sample_time: float) -> Iterator[Contradiction]:
    """Yield the bandwidths and resonances that are too high or too low for the sample time, and too long delays of the
    sensed force."""
    nyquist = 0.5 / sample_time
    for part, number_of_part in _numbers_of_parts():
        path, number = ("device", part, number_of_part.name), number_at(raw, "device", part, number_of_part.name)
        if number is None or number <= 0:
            continue
        if number_of_part.quantity == "rate" and number_of_part.sampled:
            if number > nyquist:
                message = f"{number:g} Hz is above the Nyquist frequency {nyquist:g} Hz; lower it, or leave it out"
                yield path, message
        elif number_of_part.quantity == "rate":
            if number * sample_time > FASTEST:
                most = f"{FASTEST / sample_time:g}"
                remedy = "lower it" if part == "servo" else "leave the table out"
                yield path, f"{number:g} Hz is above {most} Hz, where it does nothing; {remedy}"
            if number * sample_time < SLOWEST:
                yield path, f"{number:g} Hz is below {SLOWEST / sample_time:g} Hz; raise it"
        elif f"{part}.{number_of_part.name}" in SENSED_DELAYS and isfinite(number):
            share = number_at(raw, "uncertainty", f"{part}.{number_of_part.name}") or 0.0
            samples = number / sample_time * (1 + share)
            if samples > MAX_DELAY_SAMPLES:
                most = f"at most {MAX_DELAY_SAMPLES} are supported"
                yield path, f"{number:.12g} s is up to {samples:.12g} sample times; {most}"


def _numbers_of_parts() -> Iterator[tuple[str, PartNumber]]:
    return ((key, number_of_part) for key, part in PARTS.items() for number_of_part in part.numbers)


def _filters(device: dict[str, Any]) -> Iterator[Contradiction]:
    """Yield the orders of low-passes, of the velocity and of the force sensor, whose corner frequency is absent."""
    for part, number_of_part in _numbers_of_parts():
        table = device.get(part)
        if (
            number_of_part.order_key
            and isinstance(table, dict)
            and number_of_part.order_key in table
            and number_of_part.name not in table
        ):
            yield (
                ("device", part, number_of_part.order_key),
                f"is of a low-pass; write {number_of_part.name} too, or leave it out",
            )


def _resolution(device: dict[str, Any]) -> Iterator[Contradiction]:
    """Yield the resolution of a position whose difference is not the velocity."""
    table = device.get("velocity")
    usual = "difference" if device.get("display") == "impedance" else "measured"
    if isinstance(table, dict) and "resolution" in table and table.get("from", usual) == "measured":
        yield ("device", "velocity", "resolution"), 'is of a position that is differenced; write from = "difference"'


def _masses(raw: dict[str, Any]) -> Iterator[Contradiction]:
    """Yield the fault of a handle that is not lighter than the whole device, both with their uncertainty."""
    mass, handle = number_at(raw, "device", "mass"), number_at(raw, "device", "structure", "handle_mass")
    if not (mass and handle and mass > 0 and handle > 0):
        return
    unit = units_stated(raw).mass
    if handle >= mass:
        yield (
            ("device", "structure", "handle_mass"),
            f"{handle:g} {unit} is not less than device.mass = {mass:g} {unit}, of which it is a part",
        )
        return
    less, more = (number_at(raw, "uncertainty", key) or 0.0 for key in ("mass", "structure.handle_mass"))
    if less < 1 and handle * (1 + more) >= mass * (1 - less):
        yield (
            ("uncertainty", "structure.handle_mass" if more else "mass"),
            f"lets the handle, {handle * (1 + more):g} {unit}, be as heavy as the device, {mass * (1 - less):g} {unit}",
        )


def _uncertain(raw: dict[str, Any], device: dict[str, Any]) -> Iterator[Contradiction]:
    """Yield the uncertainties that are in the wrong place, and the uncertainties of numbers that the device lacks."""
    table = raw.get("uncertainty")
    if not isinstance(table, dict):
        return
    for key in NUMBERS:
        part, _, name = key.rpartition(".")
        nested = table.get(part)
        if part and isinstance(nested, dict) and name in nested:
            yield ("uncertainty", part, name), f'belongs in quotes: "{key}" = {nested[name]}'
        owner = device.get(part)
        if part and table.get(key) and not (isinstance(owner, dict) and name in owner):
            yield (
                ("uncertainty", key),
                f"there is no device.{key} to be uncertain; write it, or leave this out",
            )


def _unmodelled(raw: dict[str, Any]) -> Iterator[Contradiction]:
    """Yield the faults of unmodelled dynamics: frequencies that do not increase, and a stability band from 0 or to
    inf."""
    table = raw.get("uncertainty")
    rows = table.get("unmodelled") if isinstance(table, dict) else None
    if not isinstance(rows, list) or not rows:
        return
    path = ("uncertainty", "unmodelled")
    points = [(number_at(raw, *path, k, 0), number_at(raw, *path, k, 1)) for k in range(len(rows))]
    hz = [at for at, _ in points]
    if all(at is not None for at in hz) and any(b <= a for a, b in pairwise(hz)):  # type: ignore[operator]
        yield path, "the frequencies do not increase; put them in order"
    if number_at(raw, "stability", "band_hz", 0) == 0:
        yield ("stability", "band_hz"), "a band from 0 cannot be proved of a response that is not known; raise the edge"
    band = raw.get("stability", {}).get("band_hz") if isinstance(raw.get("stability"), dict) else None
    if isinstance(band, list) and inf in band[1:]:
        yield ("stability", "band_hz"), "a band to inf cannot be proved of a response that is not known; lower the edge"
