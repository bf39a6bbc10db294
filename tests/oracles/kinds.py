"""Random problems next to their limit, one function for each kind of claim; the limit is that of the oracles.

Each returns a problem's tables as a function of the side: a positive one is to be proved, a negative one is to fail.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf, pi
from typing import Any

import frequency
import numpy as np
from arithmetic import DIGITS, DOUBLES
from loop import NOTHING, Loop, matrix, offered, radius, seen, sensitivity, turn
from worst import worst

Tables = dict[str, Any]
Rng = np.random.Generator
NUMBERS = ("mass", "damping", "stiffness")
UNCERTAIN = (
    "mass", "damping", "delay", "velocity.filter_hz", "actuator.bandwidth_hz", "force_sensor.bandwidth_hz",
    "structure.frequency_hz", "structure.handle_mass", "force_sensor.delay", "structure.damping_ratio",
)  # fmt: skip
"""Numbers of an admittance display that may be uncertain; the last two only without hands."""
LEAST = 1e-3
"""Least angle of a scan, rad."""


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
    loop : of a side and a hand, for what moves in time; None where the claim is about frequencies alone
    """

    claim: str
    tables: Callable[[float], Tables]
    missed: Callable[[Tables, Witness], bool]
    loop: Callable[[Tables, tuple[float, float, float]], Loop] | None = None


def decimal(x: float) -> float:
    """Return a number with six digits, as a file has it."""
    return float(f"{x:.6g}")


def decades(rng: Rng, low: float, high: float) -> float:
    """Return a random number between two powers of 10."""
    return decimal(10 ** rng.uniform(low, high))


def late(rng: Rng, most: float) -> float:
    """Return samples of delay that are not next to a whole number: there a proof covers other delays as well."""
    return float(rng.integers(0, int(most) + 1) + rng.choice([0.0, 0.0, rng.uniform(0.1, 0.9)]))


def sums_are_clear(device: Tables) -> bool:
    """Return whether the sum of both delays is not next to a whole number of samples either, or is one."""
    own = device.get("servo", device).get("delay", 0.0) + device.get("force_sensor", {}).get("delay", 0.0)
    part = own / device["sample_time"] % 1
    return 0.06 < part < 0.94 or (own == 0)


def admittance(rng: Rng, *, flexible: bool = True) -> Tables:
    """Return a device with about half of the parts, as they are built."""
    while True:
        T, mass = decades(rng, -4, -2.7), decades(rng, -1.3, 1)
        device: Tables = {"mass": mass, "sample_time": T, "damping": decimal(mass / T * 10 ** rng.uniform(-4, -1))}
        device["delay"] = decimal(T * late(rng, 2)) if rng.random() < 0.6 else 0.0
        if rng.random() < 0.4:
            device["velocity"] = {"from": str(rng.choice(["measured", "difference"]))}
            if rng.random() < 0.5:
                device["velocity"] |= {
                    "filter_hz": decades(rng, -1.7, -0.4) / T,
                    "filter_order": int(rng.integers(1, 3)),
                }
        if rng.random() < 0.3:
            device["actuator"] = {"bandwidth_hz": decades(rng, -1.4, 0.3) / T, "order": int(rng.integers(1, 3))}
        if rng.random() < 0.4:
            device["force_sensor"] = {"bandwidth_hz": decades(rng, -1.4, 0.3) / T, "order": int(rng.integers(1, 3))}
        if rng.random() < 0.3:
            device.setdefault("force_sensor", {})["delay"] = decimal(T * late(rng, 2))
        if flexible and rng.random() < 0.3:
            device["structure"] = {"handle_mass": decimal(mass * rng.uniform(0.05, 0.6))}
            device["structure"] |= {
                "frequency_hz": decades(rng, -1.7, -0.5) / T,
                "damping_ratio": decades(rng, -2.2, -0.7),
            }
        if sums_are_clear(device):
            return device


def servo(rng: Rng) -> Tables:
    """Return a vendor's servo."""
    while True:
        T = decades(rng, -3.3, -2.1)
        table = {"delay": decimal(T * late(rng, 20)), "bandwidth_hz": decimal(min(decades(rng, 0.3, 2.3), 0.45 / T))}
        table |= {"order": int(rng.integers(1, 3)), "command": str(rng.choice(["velocity", "velocity", "position"]))}
        device: Tables = {"sample_time": T, "servo": table}
        if rng.random() < 0.4:
            device["force_sensor"] = {"bandwidth_hz": decades(rng, 1, 2.7), "order": int(rng.integers(1, 3))}
        if rng.random() < 0.4:
            device.setdefault("force_sensor", {})["delay"] = decimal(T * late(rng, 3))
        if sums_are_clear(device):
            return device


def lag_of(device: Tables) -> float:
    """Return about how late a command acts, s."""
    return 1.5 * device["sample_time"] + device.get("delay", 0.0)


def gains_for(rng: Rng, device: Tables, share: float = 0.5) -> tuple[float, float]:
    """Return gains of a size that may be stable, with an integrator by chance."""
    velocity = decimal(device["mass"] / lag_of(device) * 10 ** rng.uniform(-1.5, -0.3))
    return velocity, decimal(velocity / lag_of(device) * 10 ** rng.uniform(-3, -1)) if rng.random() < share else 0.0


def coupling_for(rng: Rng, device: Tables, impedance: float, share: float = 0.5) -> tuple[float, float, float]:
    """Return b_c, m_c and b_0, the last with a chance."""
    b_c = decimal(impedance * 10 ** rng.uniform(-1, 1))
    drag = decimal(b_c * 10 ** rng.uniform(-3, -0.5)) if rng.random() < share else 0.0
    return b_c, decimal(b_c * lag_of(device) * 10 ** rng.uniform(0, 2)), drag


def hands_for(rng: Rng, mass: float, T: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a box as human hands or of the device's own size; its least numbers are 0 half of the time."""
    high = np.array([0.5, 30.0, 3000.0]) * 10 ** rng.uniform(-1, 0.3, 3)
    if rng.random() < 0.5:
        high = np.array([mass, mass / T, mass / T**2]) * 10 ** rng.uniform([-2, -3, -5], [0.3, -0.7, -0.7])
    low = high * rng.uniform(0, 0.9, 3) * (rng.random(3) < 0.5)
    return np.array([*map(decimal, low)]), np.array([*map(decimal, high)])


def stated(
    device: Tables,
    gains: tuple[float, float] | None,
    coupling: tuple[float, ...],
    stability: Tables,
    box: tuple[np.ndarray, np.ndarray] | None = None,
    more: Tables | None = None,
) -> Tables:
    """Return a problem's tables."""
    names = ("damping", "stiffness") if device.get("display") == "impedance" else ("damping", "mass", "drag")
    found: Tables = {"device": device, "coupling": dict(zip(names, map(float, coupling), strict=True)), **(more or {})}
    if gains is not None:
        laws = ("velocity",) if device.get("display") == "impedance" else ("velocity", "position")
        found["gains"] = dict(zip(laws, gains, strict=False))
    if box is not None:
        ends = zip(NUMBERS, *box, strict=True)
        found["operator"] = {name: {"min": float(low), "max": float(high)} for name, low, high in ends}
    found["stability"] = stability
    return found


def scaled(coupling: tuple[float, ...], by: float) -> tuple[float, ...]:
    """Return a coupling whose impedance is so many times as great."""
    return tuple(number * by for number in coupling)


def angles(device: Tables, count: int = 160) -> np.ndarray:
    """Return angles omega T from `LEAST` to pi, logarithmic and even, more of them for a long delay."""
    own = device.get("servo", device).get("delay", 0.0) + device.get("force_sensor", {}).get("delay", 0.0)
    even = count + int(16 * own / device["sample_time"])
    found = [np.geomspace(LEAST, pi, count), np.linspace(0.01, pi, even)]
    if "structure" in device:
        resonance = 2 * pi * device["structure"]["frequency_hz"] * device["sample_time"]
        found += [resonance * (1 + np.geomspace(1e-3, 0.5, 20)), resonance * (1 - np.geomspace(1e-3, 0.5, 20))]
    together = np.unique(np.concatenate(found))
    return together[together <= pi]


def triple(numbers: Any) -> tuple[float, float, float]:
    """Return mass, damping and stiffness as plain numbers."""
    mass, damping, stiffness = (float(x) for x in numbers)
    return mass, damping, stiffness


# ------------------------------------------------------------------ in continuous time


def frequencies(device: Tables, low: float, high: float, count: int = 2000) -> np.ndarray:
    """Return frequencies of a band, rad/s, denser around a resonance."""
    grids = [np.geomspace(low, high, count), np.array([low, high])]
    if "structure" in device:
        free, share = 2 * pi * device["structure"]["frequency_hz"], device["structure"]["handle_mass"] / device["mass"]
        grids += [w * np.geomspace(0.5, 2, count // 5) for w in (free, free * (1 - share) ** 0.5, free * share**0.5)]
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


def passive(rng: Rng) -> Drawn:
    """Llewellyn's condition on a band, often in the hand of a least operator."""
    while True:
        device = admittance(rng) | {"hold": str(rng.choice(["zoh", "zoh", "lag"]))}
        gains, band, factor = gains_for(rng, device), band_of(rng, device), float(rng.choice([1.0, 1.05, 1.3]))
        coupling, more = coupling_for(rng, device, gains[0]), {}
        if rng.random() < 0.4:
            more = {
                "operator": {
                    "mass": decimal(device["mass"] * decades(rng, -2, 0)),
                    "damping": decimal(device["mass"] / device["sample_time"] * decades(rng, -5, -2)),
                }
            }
        tables = {"device": device} | more
        omega = frequencies(device, 2 * pi * band[0], 2 * pi * band[1])
        values = needed(tables, gains, coupling, omega)
        if (
            not np.isfinite(values).all()
            or not 0 < values.max() < 1e6
            or abs(frequency.unstable_poles(tables, gains)) > 0.1
        ):
            continue
        _, at, _ = worst(lambda w, _, t=tables, g=gains, c=coupling: needed(t, g, c, w), *_point(), omega, rng)
        at = min(max(at, omega[0]), omega[-1])
        need = exactly_needed(tables, gains, coupling, at)
        break

    def of(side: float) -> Tables:
        stability = {"criterion": "passive", "band_hz": list(band), "safety_factor": factor, "max_sensitivity": 1e3}
        return stated(device, gains, scaled(coupling, need * factor * (1 + side)), stability, more=more)

    def missed(posed: Tables, witness: Witness) -> bool:
        return exactly_needed(tables, gains, tuple(posed["coupling"].values()), witness.omega) * factor > 1

    return Drawn("passive", of, missed)


def _point() -> tuple[np.ndarray, np.ndarray]:
    return np.zeros(0), np.zeros(0)


def disc(rng: Rng) -> Drawn:
    """Llewellyn's condition for every response within a radius of the mechanism's."""
    while True:
        device = admittance(rng)
        gains, band = gains_for(rng, device), band_of(rng, device)
        coupling, hz = coupling_for(rng, device, gains[0], 1.0), np.sort(10 ** rng.uniform(*np.log10(band), 3))
        radii = [[decimal(f), decades(rng, -2, -0.7)] for f in hz]
        tables = {"device": device}
        omega = frequencies(device, 2 * pi * band[0], 2 * pi * band[1], 1000)

        def delta(w: Any, place: np.ndarray, radii: Any = radii) -> Any:
            r = np.exp(np.interp(np.log(np.asarray(w) / (2 * pi)), *np.log(np.array(radii)).T))
            return r * min(place[1], 1.0) * np.exp(2j * pi * place[0])

        def need(w: Any, place: np.ndarray, d: Any = device, g: Any = gains, c: Any = coupling, x: Any = delta) -> Any:
            return needed({"device": d}, g, c, w, x(w, place))

        low, high = np.array([0.0, 1.0]), np.array([1.0, 1.0])
        around = np.linspace(0, 1, 60)
        if not all(np.isfinite(need(omega, np.array([turned, 1.0]))).all() for turned in around):
            continue
        if abs(frequency.unstable_poles(tables, gains)) > 0.1:
            continue
        _, at, place = worst(need, low, high, omega, rng, some=40)
        at = min(max(at, omega[0]), omega[-1])
        most = exactly_needed(tables, gains, coupling, at, complex(delta(at, place)))
        if 0 < most < 1e6:
            break

    def of(side: float) -> Tables:
        stability = {"criterion": "passive", "band_hz": list(band), "safety_factor": 1.05, "max_sensitivity": 1e3}
        return stated(
            device,
            gains,
            scaled(coupling, most * 1.05 * (1 + side)),
            stability,
            more={"uncertainty": {"unmodelled": radii}},
        )

    def missed(posed: Tables, witness: Witness) -> bool:
        own, w = tuple(posed["coupling"].values()), witness.omega
        turns = np.linspace(0, 1, 1001)
        for _ in range(2):  # the second time 1000 times as close
            shares = [np.array([turned, share]) for turned in turns for share in (0.3, 0.7, 1.0)]
            best = max(shares, key=lambda place: float(needed(tables, gains, own, w, delta(w, place))))
            turns = best[0] + np.linspace(-1e-3, 1e-3, 1001)
        return exactly_needed(tables, gains, own, w, complex(delta(w, best))) * 1.05 > 1 - 1e-6

    return Drawn("passive", of, missed)


# ------------------------------------------------------------------ in sampled time


def peak(loop: Loop, rng: Rng) -> float:
    """Return the greatest |S| up to Nyquist."""

    def size(theta: Any, _: Any) -> Any:
        return np.abs(sensitivity(loop, turn(loop, theta)))

    theta = np.union1d(angles(dict(loop.device), 400), np.linspace(0.9 * pi, pi * (1 - 1e-9), 50))
    return worst(size, *_point(), theta[theta < pi], rng)[0]


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
    most, _, _ = worst(size, *_point(), np.union1d(theta[theta < pi * (1 - 1e-9)], knots), rng)

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


def with_numbers(device: Tables, keys: list[str], numbers: Any) -> Tables:
    """Return a device with other numbers at dotted keys."""
    found = {key: dict(value) if isinstance(value, dict) else value for key, value in device.items()}
    for key, number in zip(keys, numbers, strict=True):
        table, _, name = key.rpartition(".")
        (found[table] if table else found)[name] = float(number)
    return found


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
    middle = np.array([_number(device, key) for key in keys])
    spread = middle * np.array([*widths.values()])
    low, high = np.r_[box[0], middle - spread], np.r_[box[1], middle + spread]

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
        assert all(a * (1 - near) <= _number(known, key) <= b * (1 + near) for a, key, b in ends)
        there = Loop(known, gains, tuple(posed["coupling"].values()), witness.hand)
        return exact_need(there, witness.omega * device["sample_time"]) * factor > 1

    def moving(posed: Tables, hand: tuple[float, float, float]) -> Loop:
        return Loop(device, gains, tuple(posed["coupling"].values()), hand)

    return Drawn("hands", of, missed, None if widths else moving)


def _number(device: Tables, key: str) -> float:
    table, _, name = key.rpartition(".")
    return float((device[table] if table else device)[name])


def stable_in(device: Tables, gains: tuple[float, float], box: tuple[np.ndarray, np.ndarray]) -> bool:
    """Return whether the loop before an environment at rest is stable without a hand, in corners and in the middle."""
    low, high = box
    shares = [(0, 0, 0), (1, 1, 1), (0.5, 0.5, 0.5), (0, 0, 1), (1, 0, 0), (1, 0, 1)]
    some = [NOTHING, *(triple(low + (high - low) * np.array(share)) for share in shares)]
    return all(radius(Loop(device, gains, hand=hand), at_rest=True) < 1 - 1e-9 for hand in some)


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

        _, at, place = worst(need, *box, angle, rng)
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


def uncertain(rng: Rng) -> Drawn:
    """Every hand of a box on every device of a box: parts, a flexible handle or a servo, up to three numbers."""
    while True:
        if rng.random() < 0.4:
            device, gains = servo(rng), (0.0, 0.0)
            high = 10 ** rng.uniform([-1, 0, 1], [1, 2, 3.5])
            box = np.array([0.0, 0.0, 0.0]), np.array([*map(decimal, high)])
            coupling = (decades(rng, 0, 4), decades(rng, -1, 1.5), decades(rng, -1, 2))
            keys = ["servo.delay", "servo.bandwidth_hz", "force_sensor.bandwidth_hz", "force_sensor.delay"]
        else:
            device = admittance(rng)
            gains = gains_for(rng, device, 1.0)
            box = hands_for(rng, device["mass"], device["sample_time"])
            coupling = coupling_for(rng, device, gains[0], 1.0)
            keys = [*UNCERTAIN[:-2]]
        there = [key for key in keys if _has(device, key)]
        some = rng.permutation(there)[: int(rng.integers(1, 4))].tolist()
        widths = {key: decimal(rng.uniform(0.02, 0.2)) for key in some}
        if not delays_are_clear(device, widths) or ("servo" not in device and not stable_in(device, gains, box)):
            continue
        if found := in_hands(rng, device, gains, coupling, box, 1.05, widths):
            return found


def _has(device: Tables, key: str) -> bool:
    table, _, name = key.rpartition(".")
    return bool((device.get(table, {}) if table else device).get(name))


def delays_are_clear(device: Tables, widths: Tables) -> bool:
    """Return whether no end of a range of delays is next to a whole number of samples."""
    T, own = device["sample_time"], device.get("servo", device).get("delay", 0.0)
    name = "servo.delay" if "servo" in device else "delay"
    sensor, ends = device.get("force_sensor", {}).get("delay", 0.0), (-1, 1)
    sums = [
        own * (1 + a * widths.get(name, 0)) + sensor * (1 + b * widths.get("force_sensor.delay", 0))
        for a in ends
        for b in ends
    ]
    if name not in widths and "force_sensor.delay" not in widths:
        return True
    return all(0.06 < each / T % 1 < 0.94 for each in sums)


def uncertain_passive(rng: Rng) -> Drawn:
    """Llewellyn's condition on a band for every device of a box."""
    while True:
        device = admittance(rng)
        gains, band = gains_for(rng, device), band_of(rng, device)
        coupling = coupling_for(rng, device, gains[0], 1.0)
        keys = UNCERTAIN
        some = rng.permutation([key for key in keys if _has(device, key)])[: int(rng.integers(1, 4))].tolist()
        widths = {key: decimal(rng.uniform(0.02, 0.2)) for key in some}
        middle = np.array([_number(device, key) for key in some])
        low, high = middle * (1 - np.array([*widths.values()])), middle * (1 + np.array([*widths.values()]))
        omega = frequencies(device, 2 * pi * band[0], 2 * pi * band[1], 500)

        def need(w: Any, place: Any, d: Any = device, k: Any = some, g: Any = gains, c: Any = coupling) -> Any:
            return needed({"device": with_numbers(d, k, place)}, g, c, w)

        corners = [low + (high - low) * rng.integers(0, 2, len(low)) for _ in range(8)]
        if not all(np.isfinite(need(omega, place)).all() for place in corners):
            continue
        if any(
            abs(frequency.unstable_poles({"device": with_numbers(device, some, place)}, gains)) > 0.1
            for place in corners[:2]
        ):
            continue
        _, at, place = worst(need, low, high, omega, rng, some=30)
        at = min(max(at, omega[0]), omega[-1])
        most = exactly_needed({"device": with_numbers(device, some, place)}, gains, coupling, at)
        if 0 < most < 1e6:
            break

    def of(side: float) -> Tables:
        stability = {"criterion": "passive", "band_hz": list(band), "safety_factor": 1.05, "max_sensitivity": 1e3}
        return stated(
            device, gains, scaled(coupling, most * 1.05 * (1 + side)), stability, more={"uncertainty": widths}
        )

    def missed(posed: Tables, witness: Witness) -> bool:
        known = device if witness.device is None else with_numbers(device, some, [witness.device[key] for key in some])
        return exactly_needed({"device": known}, gains, tuple(posed["coupling"].values()), witness.omega) * 1.05 > 1

    return Drawn("passive", of, missed)


def impedance(rng: Rng, *, parts: bool = True) -> Tables:
    """Return an impedance display."""
    T, mass = decades(rng, -4, -2.7), decades(rng, -1.5, 0.5)
    device: Tables = {"display": "impedance", "mass": mass, "sample_time": T}
    device |= {"damping": decimal(mass / T * 10 ** rng.uniform(-3.5, -1.5)), "delay": decimal(T * late(rng, 2))}
    if rng.random() < 0.5:
        device["velocity"] = {"filter_hz": decades(rng, -1.5, -0.5) / T, "filter_order": int(rng.integers(1, 3))}
    if parts and rng.random() < 0.3:
        device["actuator"] = {"bandwidth_hz": decades(rng, -1.2, 0) / T}
    if parts and rng.random() < 0.3:
        device["structure"] = {"handle_mass": decimal(mass * rng.uniform(0.05, 0.6))}
        device["structure"] |= {"frequency_hz": decades(rng, -1.5, -0.5) / T, "damping_ratio": decades(rng, -2, -0.7)}
    return device


def spring_for(rng: Rng, device: Tables) -> tuple[float, float]:
    """Return b_c and k_c whose limit is about what the device's damping allows."""
    T, b = device["sample_time"], device["damping"]
    k = decimal(2 * b / T / (1 + device["delay"] / T) ** 2)
    return decimal(k * T * decades(rng, -2, 0)) if rng.random() < 0.6 else 0.0, k


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
        most, _, _ = worst(need, *_point(), theta, rng)
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


def worlds(rng: Rng) -> Drawn:
    """Every hand of a box before every environment of a box; what is next to its limit is the environments' damping."""
    while True:
        if rng.random() < 0.5:
            device, gains, scale = servo(rng), (0.0, 0.0), 10 ** rng.uniform(-0.5, 1.5)
        else:
            device = admittance(rng)
            gains = gains_for(rng, device, 0.8)
            scale = gains[0]
        T = device["sample_time"]
        high = np.array(
            [
                scale * T * 10 ** rng.uniform(-1, 1),
                scale * 10 ** rng.uniform(-2, 0),
                scale / T / 10 ** rng.uniform(0.5, 2.5),
            ]
        )
        share = rng.choice([0.0, rng.uniform(0, 1)], 3)
        box = np.array([*map(decimal, share * high)]), np.array([*map(decimal, high)])
        b_c = inf if rng.random() < 0.2 else decimal(scale * 10 ** rng.uniform(-1.5, 0.5))
        m_c = decimal((scale if b_c == inf else b_c) * T * 10 ** rng.uniform(-0.5, 1.5))
        coupling = (b_c, m_c, decimal(scale * 10 ** rng.uniform(-3, -1)))
        mass, stiff = decimal(scale * T * 10 ** rng.uniform(-1, 2)), decimal(scale / T * 10 ** rng.uniform(-3, 0))
        met = Box(
            (decimal(mass * rng.choice([0.0, 10 ** rng.uniform(-3, 0)])), decimal(stiff * rng.choice([0.0, 0.3]))),
            (float(rng.choice([mass, mass, inf])), float(rng.choice([stiff, stiff, inf]))),
        )
        if "servo" not in device and not stable_in(device, gains, box):
            continue
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


def nothing(rng: Rng) -> Drawn:
    """Every hand of a box on an arm with nothing behind its coupling but any damper: the stiffest contact."""
    met = Box((0.0, 0.0), (0.0, 0.0))
    while True:
        device, scale = servo(rng), 10 ** rng.uniform(0, 2)
        T = device["sample_time"]
        coupling = (inf, decimal(scale * 0.1 * 10 ** rng.uniform(-1, 1)), decimal(scale * 10 ** rng.uniform(-0.5, 0.5)))
        heavy, damping = decimal(coupling[1] * 10 ** rng.uniform(-1.5, -0.3)), decimal(scale * rng.choice([0.0, 0.03]))
        theta = angles(device)
        theta = theta[theta < pi * (1 - 1e-9)]

        def asked(
            stiffness: float, d: Any = device, c: Any = coupling, m: float = heavy, b: float = damping, t: Any = theta
        ) -> float:
            loops = (Loop(d, (0.0, 0.0), c, (m * share, b, stiffness)) for share in np.linspace(0, 1, 5))
            return max(damping_asked(loop, met, t) for loop in loops)

        low, high = scale / T * 1e-5, scale / T
        if asked(low) > 0 or asked(high) <= 0:
            continue
        for _ in range(30):
            middle = (low * high) ** 0.5
            low, high = (low, middle) if asked(middle) > 0 else (middle, high)
        break

    def of(side: float) -> Tables:
        box = np.array([0.0, damping, 0.0]), np.array([heavy, damping, high * (1 - side)])
        stability = {"criterion": "hands", "safety_factor": 1.0}
        return stated(device, None, coupling, stability, box, {"environment": met.table(0.0)})

    def missed(posed: Tables, witness: Witness) -> bool:
        assert witness.hand is not None and witness.hand[2] <= posed["operator"]["stiffness"]["max"]
        loop, angle = Loop(device, (0.0, 0.0), coupling, witness.hand), witness.omega * T
        if radius(loop) > 1 + 1e-9:
            return True
        Y = complex(port_of(loop, np.array([angle]))[0])  # the damper that holds a pole there
        poles = np.linalg.eigvals(matrix(replace(loop, world=(0.0, max(-Y.real, 0.0), 0.0))))
        return Y.real < 0 and np.abs(poles - np.exp(1j * angle)).min() < 1e-5

    return Drawn("worlds", of, missed)


def walled(rng: Rng) -> tuple[Tables, Loop] | None:
    """Return a problem with walls, a stated corner and about the coupling that they need, and its loop in no hand."""
    if rng.random() < 0.5:
        device, gains, scale = servo(rng), (0.0, 0.0), 10 ** rng.uniform(-0.5, 1.5)
    else:
        device = admittance(rng, flexible=False)
        gains = gains_for(rng, device, 1.0)
        scale = gains[0]
    T = device["sample_time"]
    high = scale * np.array(
        [T * 10 ** rng.uniform(-1, 1), 10 ** rng.uniform(-2, 0), 1 / T / 10 ** rng.uniform(0.5, 2.5)]
    )
    box = np.array([*map(decimal, rng.choice([0.0, rng.uniform(0, 1)], 3) * high)]), np.array([*map(decimal, high)])
    if "servo" not in device and not stable_in(device, gains, box):
        return None
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
    "disc": disc,
    "uncertain passive": uncertain_passive,
    "loud": loud,
    "unstable": unstable,
    "small gain": small_gain,
    "hands": hands,
    "limp hands": limp,
    "servo": servos,
    "whole sample": whole_sample,
    "uncertain hands": uncertain,
    "display": display,
    "any hand": any_hand,
    "worlds": worlds,
    "nothing": nothing,
}
