"""Contradictions in the tables of a device's parts between values that are valid on their own."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from math import inf, isfinite
from typing import Any

from vctune.document.schema.number_units import units_stated
from vctune.document.schema.validation import Contradiction
from vctune.document.text.raw import number_at
from vctune.model.device import NUMBERS

MAX_DELAY_SAMPLES = 200
"""Of the device's own delay and of its force sensor's."""
FASTEST, SLOWEST = 1e3, 1e-6
"""Between what shares of the sampling rate a bandwidth or a resonance may lie: beyond, it does nothing, or nothing else
does anything."""

RATES = (
    ("actuator", "bandwidth_hz"),
    ("force_sensor", "bandwidth_hz"),
    ("structure", "frequency_hz"),
    ("servo", "bandwidth_hz"),
)
"""Rates of a device's parts, Hz."""


def impossible_parts(raw: dict[str, Any]) -> Iterator[Contradiction]:
    """Return the contradictions in the parts of a device and in their uncertainty."""
    device = raw.get("device")
    if not isinstance(device, dict):
        return
    sample_time = number_at(raw, "device", "sample_time")
    if sample_time and sample_time > 0 and isfinite(sample_time):
        yield from _rates(raw, sample_time)
    yield from _filters(device)
    yield from _masses(raw)
    yield from _uncertain(raw, device)
    yield from _unmodelled(raw)


def _rates(raw: dict[str, Any], sample_time: float) -> Iterator[Contradiction]:
    corner, nyquist = number_at(raw, "device", "velocity", "filter_hz"), 0.5 / sample_time
    if corner is not None and corner > nyquist:
        yield (
            ("device", "velocity", "filter_hz"),
            f"{corner:g} Hz is above the Nyquist frequency {nyquist:g} Hz; lower it, or leave it out",
        )
    for part, key in RATES:
        rate = number_at(raw, "device", part, key)
        if rate is None or rate <= 0:
            continue
        if rate * sample_time > FASTEST:
            most = f"{FASTEST / sample_time:g}"
            remedy = "lower it" if part == "servo" else "leave the table out"
            yield ("device", part, key), f"{rate:g} Hz is above {most} Hz, where it does nothing; {remedy}"
        if rate * sample_time < SLOWEST:
            yield ("device", part, key), f"{rate:g} Hz is below {SLOWEST / sample_time:g} Hz; raise it"
    delay = number_at(raw, "device", "force_sensor", "delay")
    share = number_at(raw, "uncertainty", "force_sensor.delay") or 0.0
    if delay is not None and isfinite(delay) and delay / sample_time * (1 + share) > MAX_DELAY_SAMPLES:
        samples = delay / sample_time * (1 + share)
        yield (
            ("device", "force_sensor", "delay"),
            f"{delay:.12g} s is up to {samples:.12g} sample times; at most {MAX_DELAY_SAMPLES} are supported",
        )


def _filters(device: dict[str, Any]) -> Iterator[Contradiction]:
    for part, order, corner in (("velocity", "filter_order", "filter_hz"), ("force_sensor", "order", "bandwidth_hz")):
        table = device.get(part)
        if isinstance(table, dict) and order in table and corner not in table:
            yield ("device", part, order), f"is of a low-pass; write {corner} too, or leave it out"


def _masses(raw: dict[str, Any]) -> Iterator[Contradiction]:
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
