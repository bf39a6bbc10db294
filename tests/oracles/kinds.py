"""Random problems next to their limit, one function for each kind of claim; the limit is that of the oracles.

Each returns a problem's tables as a function of the side: a positive one is to be proved, a negative one is to fail.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from math import inf, pi
from typing import Any

import frequency
import numpy as np
from arithmetic import DIGITS, DOUBLES
from draws import (
    LEAST,
    Rng,
    Tables,
    admittance,
    angles,
    built,
    coupling_for,
    decades,
    decimal,
    delays_are_clear,
    ends_of,
    gains_for,
    hands_for,
    impedance,
    number_of,
    scaled,
    servo,
    spring_for,
    stable_in,
    stated,
    triple,
    widths_of,
    with_numbers,
)
from loop import Loop, matrix, offered, radius, seen, sensitivity, turn
from worst import worst


@dataclass(frozen=True)
class Witness:
    """Where a proof says that a demand is missed: frequency, rad/s, hand, and the numbers of a device."""

    omega: float
    hand: tuple[float, float, float] | None
    device: Tables | None


@dataclass(frozen=True)
class Drawn:
    """A problem at its limit.

    Attributes
    ----------
    claim : its identifier
    tables : of a side, relative to the limit
    missed : whether the oracles agree, in 50 digits, that the demand is missed at a witness
    """

    claim: str
    tables: Callable[[float], Tables]
    missed: Callable[[Tables, Witness], bool]


# ------------------------------------------------------------------ in continuous time


def frequencies(device: Tables, low: float, high: float, count: int = 2000) -> np.ndarray:
    """Return frequencies of a band, rad/s, denser around a resonance."""
    grids = [np.geomspace(low, high, count), np.array([low, high])]
    if "structure" in device:
        grids += [w * np.geomspace(0.5, 2, count // 5) for w in np.concatenate(frequency.resonances(device))]
    grid = np.unique(np.concatenate(grids))
    return grid[(grid >= low) & (grid <= high)]


def needed(tables: Tables, gains: tuple[float, float], coupling: Any, omega: Any, delta: Any = 0) -> Any:
    """Return R/Re Z_c in doubles, inf where the resistance is not positive."""
    s = 1j * np.asarray(omega)
    with np.errstate(all="ignore"):
        found = frequency.demanded(tables, gains, s, DOUBLES, delta)
        ratio = found.required / frequency.offered(coupling, s, DOUBLES).real
    return np.where(found.resistance > 0, ratio, inf)


def exactly_needed(
    tables: Tables, gains: tuple[float, float], coupling: Any, omega: float, delta: complex = 0
) -> float:
    """Return R/Re Z_c in 50 digits."""
    num = DIGITS
    s = num.i * num.number(omega)
    found = frequency.demanded(tables, gains, s, num, num.context.mpc(delta))
    return float(found.required / frequency.offered(coupling, s, num).real) if found.resistance > 0 else inf


def band_of(rng: Rng, device: Tables) -> tuple[float, float]:
    """Return a stability band, Hz."""
    nyquist = 0.5 / device["sample_time"]
    return decimal(nyquist * 10 ** rng.uniform(-3.5, -2)), decimal(nyquist * 10 ** rng.uniform(-1.3, -0.1))


POINT = np.zeros(0), np.zeros(0)
UNCERTAIN = (
    "mass", "damping", "delay", "velocity.filter_hz", "actuator.bandwidth_hz", "force_sensor.bandwidth_hz",
    "structure.frequency_hz", "structure.handle_mass", "servo.delay", "servo.bandwidth_hz",
)  # fmt: skip
"""Numbers that may be uncertain in hands."""
ALONE = (*UNCERTAIN[:8], "force_sensor.delay", "structure.damping_ratio")


@dataclass(frozen=True)
class OnBand:
    """Llewellyn's condition at a place: numbers of a device, or turn and share of a response of a disc."""

    device: Tables
    gains: tuple[float, float]
    operator: Tables
    keys: list[str]
    radii: list[list[float]]

    def tables(self, place: Any) -> Tables:
        device = with_numbers(self.device, self.keys, place) if self.keys and place is not None else self.device
        return {"device": device, "operator": self.operator}

    def delta(self, omega: Any, place: Any) -> Any:
        if not self.radii:
            return 0
        r = np.exp(np.interp(np.log(np.asarray(omega) / (2 * pi)), *np.log(np.array(self.radii)).T))
        return r * min(place[1], 1.0) * np.exp(2j * pi * place[0])

    def need(self, coupling: Any, omega: Any, place: Any) -> Any:
        return needed(self.tables(place), self.gains, coupling, omega, self.delta(omega, place))

    def exact(self, coupling: Any, omega: float, place: Any) -> float:
        return exactly_needed(self.tables(place), self.gains, coupling, omega, complex(self.delta(omega, place)))


def passive(rng: Rng, kind: str = "held", *filters: str) -> Drawn:
    """Llewellyn's condition: often in the hand of a least operator, of a box of devices, or of a disc of responses."""
    while True:
        device = built(rng, *filters) if filters else admittance(rng)
        device |= {"hold": str(rng.choice(["zoh", "zoh", "lag"]))} if kind == "held" else {}
        gains, band, factor = gains_for(rng, device), band_of(rng, device), float(rng.choice([1.0, 1.05, 1.3]))
        coupling, (low, high) = coupling_for(rng, device, gains[0], 0.5 if kind == "held" else 1.0), POINT
        operator: Tables = {}
        widths: Tables = {}
        radii: list[list[float]] = []
        if kind == "held" and rng.random() < 0.4:
            operator = {"mass": decimal(device["mass"] * decades(rng, -2, 0))}
            operator["damping"] = decimal(device["mass"] / device["sample_time"] * decades(rng, -5, -2))
        elif kind == "box":
            widths = widths_of(rng, device, ALONE, int(rng.integers(1, 4)))
            low, high = ends_of(device, widths)
        elif kind == "disc":
            radii = [[decimal(f), decades(rng, -2, -0.7)] for f in np.sort(10 ** rng.uniform(*np.log10(band), 3))]
            low, high = np.array([0.0, 1.0]), np.ones(2)
        posed = OnBand(device, gains, operator, [*widths], radii)
        need = partial(posed.need, coupling)
        omega = frequencies(device, 2 * pi * band[0], 2 * pi * band[1], 2000 if kind == "held" else 600)
        some = rng.integers(0, 2, (8, len(low))) if kind == "box" else np.linspace(0, 1, 60)[:, None]
        places = [low + (high - low) * share for share in some] if len(low) else [low]
        if not all(np.isfinite(need(omega, place)).all() for place in places):
            continue
        if any(abs(frequency.unstable_poles(posed.tables(place), gains)) > 0.1 for place in places[:2]):
            continue
        _, at, place = worst(need, low, high, omega, rng)
        most = posed.exact(coupling, at := min(max(at, omega[0]), omega[-1]), place)
        if 0 < most < 1e6:
            break

    def of(side: float) -> Tables:
        stability = {"criterion": "passive", "band_hz": list(band), "safety_factor": factor, "max_sensitivity": 1e3}
        more = {"operator": operator} if operator else {}
        if widths or radii:
            more["uncertainty"] = widths or {"unmodelled": radii}
        return stated(device, gains, scaled(coupling, most * factor * (1 + side)), stability, more=more)

    def missed(tables: Tables, witness: Witness) -> bool:
        own, w = tuple(tables["coupling"].values()), witness.omega
        if not radii:
            place = None if witness.device is None else [witness.device[key] for key in widths]
            return posed.exact(own, w, place) * factor > 1
        turns = np.linspace(0, 1, 1001)
        for _ in range(2):  # the second time 1000 times as close
            shares = [np.array([turned, share]) for turned in turns for share in (0.3, 0.7, 1.0)]
            best = max(shares, key=lambda place: float(posed.need(own, w, place)))
            turns = best[0] + np.linspace(-1e-3, 1e-3, 1001)
        return posed.exact(own, w, best) * factor > 1 - 1e-6

    return Drawn("passive", of, missed)


# ------------------------------------------------------------------ in sampled time


def peak(loop: Loop, rng: Rng) -> float:
    """Return the greatest |S| up to Nyquist."""

    def size(theta: Any, _: Any) -> Any:
        return np.abs(sensitivity(loop, turn(loop, theta)))

    theta = np.union1d(angles(dict(loop.device), 400), np.linspace(0.9 * pi, pi * (1 - 1e-9), 50))
    return worst(size, *POINT, theta[theta < pi], rng)[0]


def loud(rng: Rng) -> Drawn:
    """The greatest |S| of the sampled loop."""
    device = admittance(rng)
    gains = gains_for(rng, device)
    greatest = peak(Loop(device, gains), rng)

    def of(side: float) -> Tables:
        stability = {"criterion": "passive", "max_sensitivity": greatest * (1 + side)}
        return stated(device, gains, coupling_for(rng, device, gains[0]), stability)

    def missed(posed: Tables, witness: Witness) -> bool:
        loop = Loop(device, gains, num=DIGITS)
        there = abs(sensitivity(loop, turn(loop, witness.omega * device["sample_time"])))
        return bool(there > posed["stability"]["max_sensitivity"])

    return Drawn("sensitivity", of, missed)


def unstable(rng: Rng) -> Drawn:
    """Poles of the sampled loop: gains at which one leaves the circle."""
    while True:
        device = admittance(rng)
        gains = gains_for(rng, device)
        low, high = 0.0, 2.0
        while radius(Loop(device, scaled(gains, 2**high)), at_rest=True) < 1 + 1e-9:  # type: ignore[arg-type]
            high += 2
        for _ in range(60):
            middle = (low + high) / 2
            stable = radius(Loop(device, scaled(gains, 2**middle)), at_rest=True) < 1  # type: ignore[arg-type]
            low, high = (middle, high) if stable else (low, middle)
        inside = radius(Loop(device, scaled(gains, 2**low * (1 - 1e-4))), at_rest=True) < 1 - 1e-7  # type: ignore[arg-type]
        if inside and low > 0:
            break
    limit = 2**low

    def of(side: float) -> Tables:
        law = scaled(gains, limit * (1 - side))
        stability = {"criterion": "passive", "max_sensitivity": 1e9}
        return stated(device, law, (1.0, 1.0, 1.0), stability)  # type: ignore[arg-type]

    def missed(posed: Tables, _: Witness) -> bool:
        return radius(Loop(device, tuple(posed["gains"].values())), at_rest=True) > 1

    return Drawn("stable", of, missed)


def small_gain(rng: Rng) -> Drawn:
    """|1 - S| r < 1 of the sampled loop."""
    device = admittance(rng)
    gains, nyquist = gains_for(rng, device), 0.5 / device["sample_time"]
    loop = Loop(device, gains)
    hz = np.sort(nyquist * 10 ** rng.uniform(-2, 0, 3))
    radii = [[decimal(f), decades(rng, -1, 0)] for f in hz]

    def size(theta: Any, _: Any) -> Any:
        theta = np.maximum(theta, 1e-6)  # at 0 the positions have no limit
        r = np.exp(np.interp(np.log(theta / (2 * pi * device["sample_time"])), *np.log(np.array(radii)).T))
        return r * np.abs(1 - sensitivity(loop, turn(loop, theta)))

    theta = angles(device, 400)
    knots = 2 * pi * np.array([f for f, _ in radii]) * device["sample_time"]
    most, _, _ = worst(size, *POINT, np.union1d(theta[theta < pi * (1 - 1e-9)], knots), rng)

    def of(side: float) -> Tables:
        known = [[f, r / most / (1 + side)] for f, r in radii]
        stability = {"criterion": "passive", "max_sensitivity": 1e9}
        return stated(device, gains, (1.0, 1.0, 1.0), stability, more={"uncertainty": {"unmodelled": known}})

    def missed(posed: Tables, witness: Witness) -> bool:
        own = max(r / q for (_, r), (_, q) in zip(posed["uncertainty"]["unmodelled"], radii, strict=True))
        return float(size(np.array([witness.omega * device["sample_time"]]), None)[0]) * own > 1 - 1e-9

    return Drawn("unmodelled", of, missed)


def need_of(loop: Loop, theta: Any) -> Any:
    """Return R over what the coupling offers, at angles."""
    z = turn(loop, theta)
    with np.errstate(all="ignore"):
        return -seen(loop, z).real / offered(loop, z).real


def exact_need(loop: Loop, theta: float) -> float:
    """Return it in 50 digits; an angle of 0 is one next to it."""
    one = replace(loop, num=DIGITS)
    z = turn(one, max(theta, 1e-12))
    return float(-seen(one, z).real / offered(one, z).real)


def in_hands(
    rng: Rng,
    device: Tables,
    gains: tuple[float, float],
    coupling: tuple[float, ...],
    box: tuple[np.ndarray, np.ndarray],
    factor: float,
    widths: Tables | None = None,
) -> Drawn | None:
    """Return a problem in a box of hands, and of devices, at its limit; None where more of the coupling is no help."""
    widths = widths or {}
    keys = [*widths]
    low, high = (np.r_[hand, numbers] for hand, numbers in zip(box, ends_of(device, widths), strict=True))

    def loop(place: Any, coupling: tuple[float, ...] = coupling) -> Loop:
        return Loop(with_numbers(device, keys, place[3:]), gains, coupling, triple(place[:3]))

    def need(theta: Any, place: Any) -> Any:
        return need_of(loop(place), theta)

    theta = angles(device)
    value, at, place = worst(need, low, high, theta[theta < pi * (1 - 1e-9)], rng)
    most = max(exact_need(loop(place), angle) for angle in (at, 0.0, pi * (1 - 1e-9)))
    if not 0 < most < 1e6 or not 0.5 < value / most < 2:
        return None
    dual = device.get("display") == "impedance"

    def of(side: float) -> Tables:
        own = scaled(coupling, 1 / (most * factor * (1 + side)) if dual else most * factor * (1 + side))
        stability = {"criterion": "hands", "safety_factor": factor}
        if "servo" not in device:
            stability["max_sensitivity"] = 1e6
        posed = stated(device, None if "servo" in device else gains, own, stability, box)
        return posed | ({"uncertainty": widths} if widths else {})

    def missed(posed: Tables, witness: Witness) -> bool:
        assert witness.hand is not None
        known = device if witness.device is None else with_numbers(device, keys, [witness.device[key] for key in keys])
        assert all(a <= x <= b for a, x, b in zip(box[0], witness.hand, box[1], strict=True))
        near = 1e-12
        ends = zip(low[3:], keys, high[3:], strict=True)
        assert all(a * (1 - near) <= number_of(known, key) <= b * (1 + near) for a, key, b in ends)
        there = Loop(known, gains, tuple(posed["coupling"].values()), witness.hand)
        return exact_need(there, witness.omega * device["sample_time"]) * factor > 1

    return Drawn("hands", of, missed)


def hands(rng: Rng, *, integrator: bool = True) -> Drawn:
    """Every hand of a box on an admittance display."""
    while True:
        device = admittance(rng)
        gains = gains_for(rng, device, 1.0 if integrator else 0.0)
        box = hands_for(rng, device["mass"], device["sample_time"])
        coupling = coupling_for(rng, device, gains[0], 1.0 if box[0][1] == 0 else 0.5)
        if not integrator:
            box[0][2] = 0.0
        if stable_in(device, gains, box) and (
            found := in_hands(rng, device, gains, coupling, box, float(rng.choice([1.0, 1.05])))
        ):
            return found


def limp(rng: Rng) -> Drawn:
    """The same without an integrator, where hands may have no stiffness."""
    return hands(rng, integrator=False)


def servos(rng: Rng) -> Drawn:
    """Every hand of a box on a vendor's servo."""
    while True:
        device = servo(rng)
        high = 10 ** rng.uniform([-2, 0, 0], [1.3, 2, 4.5])
        box = np.array([*map(decimal, high * rng.choice([0, 0, 0.3], 3))]), np.array([*map(decimal, high)])
        b_c = inf if rng.random() < 0.3 else decades(rng, 0, 4)
        coupling = (b_c, decades(rng, -1, 1.5), decades(rng, -1, 2))
        if found := in_hands(rng, device, (0.0, 0.0), coupling, box, float(rng.choice([1.0, 1.05]))):
            return found


def whole_sample(rng: Rng) -> Drawn:
    """A servo of order 1 within a twentieth of a whole sample of delay: the worst of both sides of it counts."""
    T, number = 2e-3, int(rng.integers(1, 6))
    beside = decimal((number + rng.uniform(-0.045, 0.045)) * T)
    known: Tables = {"sample_time": T, "servo": {"delay": beside, "bandwidth_hz": decades(rng, 1.3, 1.9)}}
    sides = [with_numbers(known, ["servo.delay"], [at]) for at in (beside, number * T, (number - 1e-7) * T)]
    box = np.zeros(3), np.array([decades(rng, 0, 1), 30.0, decades(rng, 2, 3.5)])
    coupling = (inf, 1.0, 50.0)
    found = []
    for device in sides:
        angle = angles(device)
        angle = angle[angle < pi * (1 - 1e-9)]

        def need(theta: Any, place: Any, d: Tables = device) -> Any:
            return need_of(Loop(d, (0.0, 0.0), coupling, triple(place)), theta)

        _, at, place = worst(need, *box, angle, rng, some=12, closer=2)
        loop = Loop(device, (0.0, 0.0), coupling, triple(place))
        found.append(max(exact_need(loop, angle) for angle in (at, 0.0, pi * (1 - 1e-9))))

    def of(side: float) -> Tables:
        own = scaled(coupling, max(found) * (1 + side))
        return stated(known, None, own, {"criterion": "hands", "safety_factor": 1.0}, box)

    def missed(posed: Tables, witness: Witness) -> bool:
        assert witness.hand is not None
        own = tuple(posed["coupling"].values())
        loops = [Loop(device, (0.0, 0.0), own, witness.hand) for device in sides]
        return max(exact_need(loop, witness.omega * T) for loop in loops) > 1

    return Drawn("hands", of, missed)


def uncertain(rng: Rng, *, dual: bool = False) -> Drawn:
    """Every hand of a box on every device of a box: parts, a flexible handle, a servo or a display."""
    while True:
        if dual:
            device = impedance(rng)
            gains, coupling = (decimal(device["damping"] * rng.choice([0.0, 0.5])), 0.0), spring_for(rng, device)
            box = hands_for(rng, device["mass"], device["sample_time"])
        elif rng.random() < 0.4:
            device, gains = servo(rng), (0.0, 0.0)
            high = 10 ** rng.uniform([-1, 0, 1], [1, 2, 3.5])
            box = np.array([0.0, 0.0, 0.0]), np.array([*map(decimal, high)])
            coupling = (decades(rng, 0, 4), decades(rng, -1, 1.5), decades(rng, -1, 2))
        else:
            device = admittance(rng)
            gains = gains_for(rng, device, 1.0)
            box = hands_for(rng, device["mass"], device["sample_time"])
            coupling = coupling_for(rng, device, gains[0], 1.0)
        widths = widths_of(rng, device, UNCERTAIN, int(rng.integers(1, 4)))
        if not delays_are_clear(device, widths) or ("servo" not in device and not stable_in(device, gains, box)):
            continue
        if found := in_hands(rng, device, gains, coupling, box, 1.05, widths):
            return found


def display(rng: Rng) -> Drawn:
    """Every hand of a box on an impedance display."""
    while True:
        device = impedance(rng)
        gains, coupling = (decimal(device["damping"] * rng.choice([0.0, 0.5])), 0.0), spring_for(rng, device)
        box = hands_for(rng, device["mass"], device["sample_time"])
        if stable_in(device, gains, box) and (
            found := in_hands(rng, device, gains, coupling, box, float(rng.choice([1.0, 1.05])))
        ):
            return found


def any_hand(rng: Rng) -> Drawn:
    """Any passive hand on an impedance display."""
    while True:
        device = impedance(rng, parts=False)
        K_v, coupling = decimal(device["damping"] * rng.choice([0.0, 0.3])), spring_for(rng, device)
        loop = Loop(device, (K_v, 0.0), coupling)

        def need(theta: Any, _: Any, d: Any = device, k: float = K_v, x: Loop = loop) -> Any:
            return frequency.impedance_in_any_hand(d, k, theta) / offered(x, turn(x, np.atleast_1d(theta))).real

        theta = np.union1d(np.geomspace(LEAST, pi * (1 - 1e-9), 60), np.linspace(0.2, pi * (1 - 1e-9), 40))
        if (offered(loop, turn(loop, theta)).real <= 0).any():
            continue
        most, _, _ = worst(need, *POINT, theta, rng)
        if 0 < most < 1e6:
            break

    def of(side: float) -> Tables:
        own = scaled(coupling, 1 / (most * 1.05 * (1 + side)))
        return stated(device, (K_v, 0.0), own, {"criterion": "passive", "safety_factor": 1.05, "max_sensitivity": 1e6})

    def missed(posed: Tables, witness: Witness) -> bool:
        own = tuple(posed["coupling"].values())
        theta = max(witness.omega * device["sample_time"], LEAST)  # below it doubles have too few digits
        there = frequency.impedance_in_any_hand(device, K_v, theta)
        return bool(there[0] / offered(replace(loop, coupling=own), turn(loop, theta)).real * 1.05 > 1 - 5e-6)

    return Drawn("any_hand", of, missed)


# ------------------------------------------------------------------ before environments of a box


@dataclass(frozen=True)
class Box:
    """Environments: mass and stiffness from low to high, inf for any."""

    low: tuple[float, float]
    high: tuple[float, float]

    def reactances(self, u: Any) -> tuple[Any, Any]:
        """Return the least and the greatest reactance at u = (2/T) tan(theta/2)."""
        (m_1, k_1), (m_2, k_2) = self.low, self.high
        return m_1 * u - k_2 / u, m_2 * u - k_1 / u

    def balanced(self, reactance: float, u: float) -> list[tuple[float, float]]:
        """Return masses and stiffnesses of the box with m u - k/u = reactance, as far as its edges have them."""
        (m_1, k_1), (m_2, k_2), more = self.low, self.high, 1e-9
        found = [(m, (m * u - reactance) * u) for m in (m_1, m_2) if m < inf]
        found += [((reactance + k / u) / u, k) for k in (k_1, k_2) if k < inf]
        return [
            (min(max(m, m_1), m_2), min(max(k, k_1), k_2))
            for m, k in found
            if m_1 - more <= m <= m_2 * (1 + more) + more and k_1 * (1 - more) - more <= k <= k_2 * (1 + more) + more
        ]

    def table(self, damping: float) -> Tables:
        """Return the table of a problem file."""
        (m_1, k_1), (m_2, k_2) = self.low, self.high
        found: Tables = {"mass": {"min": m_1}, "damping": {"min": damping}, "stiffness": {"min": k_1}}
        for name, most in (("mass", m_2), ("stiffness", k_2)):
            if most < inf:
                found[name]["max"] = most
        return found


def port_of(loop: Loop, theta: Any) -> Any:
    """Return Z_c + Z_seen at angles."""
    z = turn(loop, theta)
    return offered(loop, z) + seen(loop, z)


def damping_asked(loop: Loop, box: Box, theta: np.ndarray) -> float:
    """Return the greatest -Re Y where -Im Y is a reactance of the box: as little damping holds a pole on the circle."""
    T, exact = loop.device["sample_time"], box.low == box.high

    def at(angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Whether the reactance is one of the box, or of a box of one whether it is at least that one's; -Re Y."""
        Y = port_of(loop, angle)
        least, most = box.reactances(2 / T * np.tan(angle / 2))
        return (-Y.imag >= least) & (exact | (-Y.imag <= most)), -Y.real

    inside, asked = at(theta)
    best = -inf if exact else float(np.where(inside, asked, -inf).max())
    edges = np.flatnonzero(inside[1:] != inside[:-1])
    if len(edges):
        first = inside[edges]
        kept, left = np.where(first, theta[edges], theta[edges + 1]), np.where(first, theta[edges + 1], theta[edges])
        for _ in range(45):
            middle = (kept + left) / 2
            within, _ = at(middle)
            kept, left = np.where(within, middle, kept), np.where(within, left, middle)
        best = max(best, float(at(kept)[1].max()))
    peaks = (asked[1:-1] >= asked[:-2]) & (asked[1:-1] >= asked[2:]) & inside[1:-1]
    for k in [] if exact else np.flatnonzero(peaks) + 1:
        low, high = theta[k - 1], theta[k + 1]
        for _ in range(9):
            near = np.linspace(low, high, 9)
            ok, value = at(near)
            value = np.where(ok, value, -inf)
            n = int(np.argmax(value))
            best, low, high = max(best, float(value[n])), near[max(n - 1, 0)], near[min(n + 1, 8)]
    return best


def held(rng: Rng, integrator: float, *, flexible: bool = True) -> tuple[Tables, Any, float, Any]:
    """Return a servo or an own loop that is stable in its hands, its gains, about its impedance, and the hands."""
    while True:
        if rng.random() < 0.5:
            device, gains, scale = servo(rng), (0.0, 0.0), float(10 ** rng.uniform(-0.5, 1.5))
        else:
            device = admittance(rng, flexible=flexible)
            gains = gains_for(rng, device, integrator)
            scale = gains[0]
        T = device["sample_time"]
        high = scale * np.array([T, 1, 1 / T]) * 10 ** rng.uniform((-1, -2, -2.5), (1, 0, -0.5))
        share = rng.choice([0.0, rng.uniform(0, 1)], 3)
        box = np.array([*map(decimal, share * high)]), np.array([*map(decimal, high)])
        if "servo" in device or stable_in(device, gains, box):
            return device, gains, scale, box


def worlds(rng: Rng) -> Drawn:
    """Every hand of a box before every environment of a box; what is next to its limit is the environments' damping."""
    while True:
        device, gains, scale, box = held(rng, 0.8)
        T = device["sample_time"]
        b_c = inf if rng.random() < 0.2 else decimal(scale * 10 ** rng.uniform(-1.5, 0.5))
        m_c = decimal((scale if b_c == inf else b_c) * T * 10 ** rng.uniform(-0.5, 1.5))
        coupling = (b_c, m_c, decimal(scale * 10 ** rng.uniform(-3, -1)))
        mass, stiff = decimal(scale * T * 10 ** rng.uniform(-1, 2)), decimal(scale / T * 10 ** rng.uniform(-3, 0))
        met = Box(
            (decimal(mass * rng.choice([0.0, 10 ** rng.uniform(-3, 0)])), decimal(stiff * rng.choice([0.0, 0.3]))),
            (float(rng.choice([mass, mass, inf])), float(rng.choice([stiff, stiff, inf]))),
        )
        theta = np.union1d(np.geomspace(1e-4, 0.1, 150), angles(device, 300))
        theta = theta[theta < pi * (1 - 1e-9)]

        def asked(
            _: Any, place: Any, d: Any = device, g: Any = gains, c: Any = coupling, m: Box = met, t: Any = theta
        ) -> Any:
            return np.array([damping_asked(Loop(d, g, c, triple(place)), m, t)])

        limit, _, _ = worst(asked, *box, np.array([1.0]), rng, some=12, closer=1)
        if 1e-3 < limit / abs(offered(Loop(device, gains, coupling), np.exp(0.5j))) < 1e3:
            break

    def of(side: float) -> Tables:
        stability: Tables = {"criterion": "hands", "safety_factor": 1.0}
        if "servo" not in device:
            stability["max_sensitivity"] = 1e6
        law = None if "servo" in device else gains
        return stated(device, law, coupling, stability, box, {"environment": met.table(limit * (1 + side))})

    def missed(posed: Tables, witness: Witness) -> bool:
        assert witness.hand is not None
        loop, least = Loop(device, gains, coupling, witness.hand), posed["environment"]["damping"]["min"]
        if radius(replace(loop, world=(met.low[0], least, met.low[1]))) > 1 + 1e-9:
            return True
        theta = min(max(witness.omega * T, 1e-7), pi * (1 - 1e-7))
        Y, u = complex(port_of(loop, np.array([theta]))[0]), 2 / T * np.tan(theta / 2)
        for m, k in met.balanced(-Y.imag, float(u)):
            poles = np.linalg.eigvals(matrix(replace(loop, world=(m, max(-Y.real, 0.0), k))))
            if -Y.real >= least - 1e-9 * abs(Y) and np.abs(poles - np.exp(1j * theta)).min() < 1e-5:
                return True
        return False

    return Drawn("worlds", of, missed)


def walled(rng: Rng) -> tuple[Tables, Loop]:
    """Return a problem with walls, a stated corner and about the coupling that they need, and its loop in no hand."""
    device, gains, scale, box = held(rng, 1.0, flexible=False)
    T = device["sample_time"]
    b_c = decimal(scale * 10 ** rng.uniform(-1, 1))
    coupling = (b_c, decimal(b_c * T * 10 ** rng.uniform(-0.5, 1.5)), decimal(scale * 10 ** rng.uniform(-2, 0)))
    mass, stiff = decimal(scale * T * 10 ** rng.uniform(0, 2)), decimal(scale / T * 10 ** rng.uniform(-3, -0.5))
    met = Box((decimal(mass * 10 ** rng.uniform(-3, 0)), decimal(stiff * rng.choice([0.0, 0.3]))), (mass, stiff))
    corner = decimal(float(rng.choice([0.03, 0.3, 0.7, 0.99])) / (pi * T))
    environment = met.table(0.0) | {"walls": True, "corner_hz": corner}
    stability: Tables = {"criterion": "hands", "safety_factor": float(rng.choice([1.0, 1.05]))}
    if "servo" not in device:
        stability["max_sensitivity"] = 1e6
    law = None if "servo" in device else gains
    tables = stated(device, law, coupling, stability, box, {"environment": environment})
    return tables, Loop(device, gains, coupling)


KINDS = {
    "passive": passive,
    "disc": partial(passive, kind="disc"),
    "uncertain passive": partial(passive, kind="box"),
    "loud": loud,
    "unstable": unstable,
    "small gain": small_gain,
    "hands": hands,
    "limp hands": limp,
    "servo": servos,
    "whole sample": whole_sample,
    "uncertain hands": uncertain,
    "uncertain display": partial(uncertain, dual=True),
    "display": display,
    "any hand": any_hand,
    "worlds": worlds,
    "passive, sections": lambda rng: passive(rng, "held", "sections", "felt sections", "part of a sample"),
    "passive, springs": lambda rng: passive(rng, "held", "springs", "difference"),
}
LONG = ("limp hands", "uncertain hands", "uncertain display", "worlds")
"""Kinds whose proofs take seconds, and next to their limit minutes."""
