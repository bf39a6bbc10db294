"""Combine the estimates of several recordings and directions into one box around the device (README, section 4)."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import NormalDist

from vctune.document.recording import Recording
from vctune.document.records.identification_json import Bounded, Estimate, bounded
from vctune.document.schema.rules import MAX_DELAY_SAMPLES
from vctune.document.text.errors import InputError, Note, coded
from vctune.model.numbers.units import UNITS, Units

CONFIDENCE = 0.95  # Probability with which all intervals of a box hold at the same time
DELAY_FLOOR = 0.1  # Least half-width of a delay, in sample times
FLOORS = {"structure.frequency_hz": 0.005}  # Least relative half-widths by key, if not 0.01
COULOMB_SHARE = 0.1  # Share of the Coulomb friction that may in fact be viscous, because Coulomb's law is not exact
COULOMB_SHARE_MOVING = 0.01  # The same where only motion that keeps its direction is fitted
LIGHTER = 1 - 1e-3  # Greatest permitted mass of the handle, relative to the least mass of the device


def unexplained(recording: Recording, message: str, key: str = "") -> InputError:
    """Return the refusal of a log that no device explains."""
    return InputError.of(recording.source, "log-unexplained", message, key=key)


def left_to_the_hand(recording: Recording, stiffness: float, mass: float, *, held: bool) -> Note:
    """Return the remark on a spring that stays outside the device, as a hand does; refuse any other pull."""
    units = recording.units
    text = (
        f"the {units.force_name} follows the position by about {stiffness:.2g} {units.stiffness}: gravity, a return "
        f"spring or a cable pulls; without it the {units.mass_name} is about {mass:.2g} {units.mass}"
    )
    if not held or stiffness <= 0:
        remedy = "which no device here has; record where it is balanced, or without it"
        has = recording.channels
        header = next(has[role].header for role in ("position", "real", "gain") if role in has)
        raise unexplained(recording, f"{text}, {remedy}", header)
    where = (
        'the device in the file has no spring, because any passive hand may be one; for the criterion "hands", add it '
        "to operator.stiffness"
    )
    return Note("remark-spring", f"{recording.name}: {text}; {where}")


def joint_factor(count: int) -> float:
    """Return the number of standard deviations with which `count` intervals hold together."""
    return max(2.0, NormalDist().inv_cdf(0.5 + 0.5 * CONFIDENCE ** (1 / max(count, 1))))


def box(estimates: Sequence[Estimate], T: float, units: Units = UNITS["linear"]) -> list[Bounded]:
    """Return the least box that contains every interval of every estimate, without negative values and with least
    widths."""
    by_key: dict[str, list[Estimate]] = {}
    for each in estimates:
        by_key.setdefault(each.key, []).append(each)
    factor = joint_factor(len(by_key))
    return [_interval(key, found, factor, T, units) for key, found in by_key.items()]


def _interval(key: str, estimates: list[Estimate], factor: float, T: float, units: Units) -> Bounded:
    values, deviations = [each.value for each in estimates], [factor * each.sigma for each in estimates]
    low = max(0.0, min(e.value - factor * e.sigma - e.excess[0] for e in estimates))
    high = max(0.0, *(e.value + factor * e.sigma + e.excess[1] for e in estimates))
    widest = max(estimates, key=lambda each: max(each.excess))
    if all(each.stated for each in estimates):
        limit = coded("what was stated", "limit-stated")
    elif (max(values) - min(values)) / 2 > max(*deviations, *widest.excess):
        limit = coded("records, directions or models differ", "limit-differ")
    else:
        limit = widest.reason if max(widest.excess) > max(deviations) else coded("residuals", "limit-residuals")
    is_delay = key.endswith("delay")
    if high == 0 and not is_delay:  # the error of a negative value is at least its magnitude
        high = max(map(abs, values))
    middle = 0.5 * (low + high)
    least = DELAY_FLOOR * T if is_delay else FLOORS.get(key, 0.01) * middle
    if high - low < 2 * least:
        low, high, limit = max(middle - least, 0.0), middle + least, coded("floor", "limit-floor")
    limit += "; " + coded("may be 0", "limit-zero") if low == 0 else ""
    return bounded(key, low, high, limit, estimates, units)


def readable(bounds: Sequence[Bounded], recording: Recording, T: float) -> list[Bounded]:
    """Return a box that the reader of problem files accepts, or refuse the recording."""
    for each in bounds:
        if each.key.endswith("delay"):
            _check_delay(each, recording, T)
    by_key = {each.key: each for each in bounds}
    handle, mass, units = by_key.get("structure.handle_mass"), by_key.get("mass"), recording.units
    if handle is not None and mass is not None and handle.high >= (most := mass.low * LIGHTER):
        if 0.5 * (handle.low + handle.high) >= most:
            message = (
                f"the handle's {units.mass_name}, {handle.low:.3g} to {handle.high:.3g} {units.mass}, is not told from "
                f"the device's, {mass.low:.3g} to {mass.high:.3g}: record longer, or excite more lines around the "
                "resonance"
            )
            raise unexplained(recording, message)
        limit = f"{handle.limit}; {coded('lighter than the device', 'limit-handle')}"
        by_key[handle.key] = bounded(handle.key, handle.low, most, limit, handle.estimates, units)
    return list(by_key.values())


def _check_delay(delay: Bounded, recording: Recording, T: float) -> None:
    """Refuse a delay that is certainly negative, or greater than the greatest supported delay."""
    latest = max(each.value for each in delay.estimates)
    widest = 4 * max(each.sigma for each in delay.estimates)
    name = "command" if delay.key == "servo.delay" else recording.units.force_name
    remedy = f"the columns were not sampled together; shift the {name}'s column, or log both in the same interrupt"
    if delay.key in ("delay", "servo.delay") and latest + widest < -0.5 * T:
        raise unexplained(recording, f"the position is {-latest:.3g} s ahead of the {name}: {remedy}")
    if delay.high > MAX_DELAY_SAMPLES * T > latest:
        limits = f"{max(delay.low, 0):.3g} to {delay.high:.3g} s"
        raise unexplained(recording, f"{delay.key} is not determined: {limits}; move faster, or record longer")
    if delay.high > MAX_DELAY_SAMPLES * T:
        message = f"{delay.key} is up to {delay.high:.3g} s, {delay.high / T:.3g} sample times, and at most "
        raise unexplained(recording, f"{message}{MAX_DELAY_SAMPLES} are supported: {remedy}")
