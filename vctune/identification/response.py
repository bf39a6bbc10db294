"""Study a measured response of a servo or of a mechanism: the same numbers as those of a log, fitted over frequency
(README, section 9)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from math import exp, log, pi

import numpy as np

from vctune.document.recording import Floats, Recording
from vctune.document.records.identification_json import Estimate
from vctune.document.text.errors import InputError
from vctune.identification.box import left_to_the_hand, unexplained
from vctune.identification.fit import SCALED, in_units, moved
from vctune.identification.stepped import LAGS, Complex, Drive, Numbers, response
from vctune.identification.study import KEYS, SERVO_KEYS, Lines, Study, number, of_orders, record_of

LEAST_LINES = 10  # Least number of frequencies
MAX_SHARE, GAINS = 0.25, (0.8, 1.25)  # Of the response that is left, and of a servo; beyond these it is refused
LAGS_TRIED = 8  # Lags from which a servo is sought
ROUNDED = 1e-6  # Relative error of each response at least
FAR = 0.1  # Relative error from which a line counts less
BLOCK = 4  # Neighbouring frequencies whose errors may be one
CLEAR_GAIN = 15.0  # Least gain of a part, or of an order, that stays
SIGNIFICANT = 4.0  # Deviations from which a lag, a spring and a second mass are there
HIGHEST = 0.499  # Highest frequency that is used, as a share of the sampling rate
SPRINGS = 12  # Resonances from which a second mass is sought


@dataclass(frozen=True, slots=True)
class Match:
    """The numbers whose response is nearest to a measured one."""

    drive: Drive
    numbers: dict[str, float]
    sigmas: dict[str, float]
    cost: float
    made: Complex


def measured_response(recording: Recording, highest: float) -> tuple[Floats, Complex]:
    """Return the frequencies in their order, Hz, up to a highest, and the response there."""
    has = recording.channels
    if "real" in has:
        values = has["real"].values + 1j * has["imag"].values
    else:
        values = 10 ** (has["gain"].values / 20) * np.exp(1j * has["phase"].values)
    hertz = has["frequency"].values
    order = np.argsort(hertz)[: np.sum(hertz <= highest)]
    return hertz[order], np.asarray(values[order])


def matched(drive: Drive, hertz: Floats, measured: Complex, start: Numbers, fixed: Numbers) -> Match:
    """Return the nearest response from a start, by relative errors."""
    from scipy.optimize import least_squares

    typical = {"delay": drive.T, "damping": 2 * pi * float(np.median(hertz)) * start.get("mass", 1.0)}
    typical |= {"stiffness": abs(start.get("stiffness", 1.0)) or 1.0} | dict.fromkeys(SCALED, 1.0)
    steps = {name: typical.get(name, 1.0) for name in start}

    def at(change: Floats) -> dict[str, float]:
        return {**fixed, **moved(start, dict(zip(start, change * list(steps.values()), strict=True)))}

    def left(change: Floats) -> Floats:
        off = response(drive, at(change), hertz) / measured - 1
        return np.stack([off.real, off.imag], 1).ravel()

    found = least_squares(left, np.zeros(len(start)), loss="soft_l1", f_scale=FAR, x_scale=0.1, max_nfev=200)
    slopes, residual = found.jac, left(found.x)
    inverse = np.linalg.pinv(slopes.T @ slopes, hermitian=True)
    blocks = np.arange(0, residual.size, 2 * BLOCK)
    scores = np.add.reduceat(slopes * residual[:, None], blocks) @ inverse
    plain = np.diag(inverse) * max(float(np.mean(residual**2)), ROUNDED**2)
    sigma = np.sqrt(np.maximum(np.sum(scores**2, axis=0), plain * residual.size / max(residual.size - len(start), 1)))
    numbers = at(found.x)
    sigmas = in_units(numbers, steps, sigma)
    cost = 2 * float(found.cost) + residual.size * ROUNDED**2
    return Match(drive, numbers, sigmas, cost, response(drive, numbers, hertz))


def gain_of(less: Match, more: Match, lines: int) -> float:
    """Return by how much a match with more numbers is likelier, beyond what they cost."""
    return 2 * lines * log(less.cost / more.cost) - (len(more.numbers) - len(less.numbers)) * log(2 * lines)


def nearest(
    drive: Drive, hertz: Floats, measured: Complex, starts: Iterable[dict[str, float]], fixed: Numbers
) -> Match:
    """Return the nearest response from several starts, whose delay is the slope of the phase that they leave."""
    found = list[Match]()
    for start in starts:
        rest = measured / response(drive, {**start, **fixed, "delay": 0.0}, hertz)
        delay = float(-np.polyfit(2 * pi * hertz, np.unwrap(np.angle(rest)), 1)[0])
        found.append(matched(drive, hertz, measured, start | ({} if "delay" in fixed else {"delay": delay}), fixed))
    return min(found, key=lambda each: each.cost)


def servo_matches(T: float, hertz: Floats, measured: Complex) -> list[Match]:
    """Return the matches of both orders, the nearer first."""
    lags = np.geomspace(0.1, 10.0 * hertz[-1] / hertz[0], LAGS_TRIED) / (2 * pi * hertz[-1])
    starts = [{"gain": float(np.abs(measured[0])), "lag": float(lag)} for lag in lags]
    drives = [Drive(T, np.zeros(1), ramp=True, servo=order) for order in LAGS]
    return sorted((nearest(each, hertz, measured, starts, {}) for each in drives), key=lambda each: each.cost)


def mechanism_match(T: float, hertz: Floats, measured: Complex, fixed: Numbers) -> Match:
    """Return the match with all parts that it needs: a lag, a spring, a second mass."""
    drive, w, size = Drive(T, np.zeros(1), ramp=True), 2 * pi * hertz, np.abs(measured)
    high, low = hertz >= np.quantile(hertz, 0.7), hertz <= np.quantile(hertz, 0.3)
    start = {"mass": float(np.median(1 / (w**2 * size)[high])), "damping": float(np.median(1 / (w * size)[low]))}
    one = nearest(drive, hertz, measured, [start], fixed)
    while True:
        tried = [nearest(drive, hertz, measured, starts, fixed) for starts in _more_parts(one, hertz, measured, fixed)]
        more = max(filter(_clear, tried), key=lambda each: gain_of(one, each, hertz.size), default=one)
        if more is one or gain_of(one, more, hertz.size) < CLEAR_GAIN:
            return one
        one = more


def _clear(one: Match) -> bool:
    """Return whether the parts of a mechanism are there, and not only possible."""
    parts = {"lag", "handle_mass", "frequency_hz", "stiffness"} & set(one.sigmas)
    return all(SIGNIFICANT * one.sigmas[name] < abs(one.numbers[name]) for name in parts)


def _more_parts(one: Match, hertz: Floats, measured: Complex, fixed: Numbers) -> Iterator[list[dict[str, float]]]:
    """Yield the starts of each part that a match has not, the simplest first."""
    numbers = {name: value for name, value in one.numbers.items() if name not in fixed}
    if "lag" not in one.numbers and "delay" in numbers:
        yield [numbers | {"lag": share * one.drive.T} for share in (0.3, 1.0, 3.0)]
    if "stiffness" not in numbers:
        yield [numbers | {"stiffness": share / float(np.abs(measured[0]))} for share in (0.1, 1.0)]
    if "handle_mass" not in numbers:
        spring, peak = {"handle_mass": 0.4 * numbers["mass"], "damping_ratio": 0.03}, hertz**2 * np.abs(measured)
        places = [hertz[np.argmax(peak)], *np.geomspace(hertz[0], hertz[-1], SPRINGS + 2)[1:-1]]
        yield [numbers | spring | {"frequency_hz": float(place)} for place in places]


def response_study(recording: Recording, T: float, fixed: Numbers, *, servo: bool, held: bool) -> Study:
    """Study a measured response; the commands of a servo and of a mechanism are those of its logs."""
    name = recording.name
    hertz, measured = measured_response(recording, HIGHEST / T)
    header = recording.channels["real" if "real" in recording.channels else "gain"].header
    if (fault := _fault(hertz, measured)) is not None:
        raise InputError.of(recording.source, "log-samples", fault, key=recording.channels["frequency"].header)
    matches = servo_matches(T, hertz, measured) if servo else [mechanism_match(T, hertz, measured, fixed)]
    one = matches[0]
    share, *others = (
        float(np.sqrt(np.mean(np.minimum(np.abs(each.made / measured - 1), 1.0) ** 2))) for each in matches
    )
    kind = f"a servo's response, order {one.drive.servo}" if servo else "a mechanism's response"
    _refuse(recording, one, share, header, kind)
    known = len(matches) == 1 or 2 * hertz.size * log(matches[1].cost / one.cost) > CLEAR_GAIN
    fits = [(each.drive.servo, each.cost, left) for each, left in zip(matches, (share, *others), strict=True)]
    candidates, remarks = of_orders(name, fits, known=known) if servo else ([], [])
    if (stiffness := one.numbers.get("stiffness")) is not None:
        remarks.append(left_to_the_hand(recording, stiffness, one.numbers["mass"], held=held))
    record = record_of(
        recording, T, kind=kind, used=hertz.size, residual_share=share, chi2=None,
        numbers=[number(key, value) for key, value in one.numbers.items()],
        candidates=candidates,
    )  # fmt: skip
    estimates = [each for match in (matches[:1] if known else matches) for each in _estimates(name, match)]
    free = 1 + one.numbers.get("stiffness", 0.0) * one.made
    made = response(one.drive, one.numbers | {"stiffness": 0.0}, hertz)
    lines = Lines(hertz, made * (1 + (measured / one.made - 1) * free), np.full(hertz.size, share), made, one.drive)
    orders = {each.drive.servo: 2 * hertz.size * log(each.cost) for each in matches}
    return Study(recording, record, estimates, [lines], remarks=remarks, servo_orders=orders)


def _fault(hertz: Floats, measured: Complex) -> str | None:
    """Return why a response cannot be fitted; None if it can."""
    if np.unique(hertz).size < LEAST_LINES:
        return f"has {np.unique(hertz).size} frequencies up to half the sampling rate; {LEAST_LINES} are needed"
    if hertz[0] <= 0:
        return f"has a frequency of {hertz[0]:g} Hz; leave out its row, all must be above 0"
    if np.any(measured == 0):
        return f"has a response of 0 at {hertz[np.argmax(measured == 0)]:g} Hz; leave out its row"
    return None


def _estimates(source: str, one: Match) -> Iterator[Estimate]:
    """Yield the estimates of the keys that a problem file states."""
    order = one.drive.servo
    for name in (name for name in KEYS if name in one.sigmas):
        value, sigma, beyond = one.numbers[name], one.sigmas[name], (0.0, 0.0)
        if name == "lag":
            share, value = sigma / value, LAGS[order or 1] / (2 * pi * value)
            low, high = (value * exp(2 * side * min(share, 2.0)) for side in (-1, 1))
            sigma = min(share, 0.2) * value
            beyond = max(value - low - 2 * sigma, 0.0), max(high - value - 2 * sigma, 0.0)
        yield Estimate(SERVO_KEYS[name] if order else KEYS[name], value, sigma, f"{source}: response", beyond)


def _refuse(recording: Recording, one: Match, share: float, header: str, kind: str) -> None:
    """Refuse a response that is of no such device."""
    gain, late = one.numbers.get("gain", 1.0), one.numbers["delay"] + one.numbers.get("lag", 0.0)
    if share > MAX_SHARE:
        message = (
            f"{share:.0%} of {header} is not {kind}: is it position over force, or motion over command of a servo "
            "(--servo), and the phase of a lag negative?"
        )
    elif not GAINS[0] < gain < GAINS[1]:
        message = f"moves {gain:.4g} times as far as it is told; write the scale of a column"
    elif late < -0.25 * one.drive.T:
        message = f"is {-late:.3g} s ahead of its command; is the sign of the phase turned?"
    else:
        return
    raise unexplained(recording, message, header)
