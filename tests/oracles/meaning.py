"""What every number of a design's record means, by functions that share nothing with vctune.

`DESIGN` maps each path of the schema to a function of a case and of the part of the record that holds the value. It
returns what is expected: a number (1e-6), `Near` one, `Within` an interval, `Said` a word or a flag, or `Holds`. A text
is the reason why there is no oracle, or the test that has one.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from itertools import product
from math import inf, pi
from typing import Any, NamedTuple

import frequency
import numpy as np
from arithmetic import DIGITS, DOUBLES
from draws import NUMBERS, angles, ends_of, with_numbers
from kinds import Box, OnBand, damping_asked, frequencies, need_of, peak
from loop import NOTHING, Loop, Memory, matrix, offered, radius, seen, sensitivity, slowest, step, turn
from pushed_handle import Stepped
from scipy import signal
from scipy.optimize import brentq
from sentences import disc_of_hands
from walls import condition
from worst import worst

Part = dict[str, Any]
IMMOVABLE = (0.0, 1e12, 0.0)
BESIDE = 1e-3
"""Relative distance from a limit on either side of which it is tried."""


class Near(NamedTuple):
    """A number, relatively."""

    value: float
    rel: float


class Within(NamedTuple):
    """An interval."""

    low: float
    high: float


class Said(NamedTuple):
    """A word, a flag, or null."""

    value: Any


class Holds(NamedTuple):
    """A condition."""

    value: bool


class Elsewhere(NamedTuple):
    """The file below tests/ with the oracle of a number, and what it calls it, if not by its key."""

    test: str
    called: str = ""


def ends(table: Any) -> tuple[float, float]:
    """Return the least and the greatest of a number or a range of a problem file."""
    if isinstance(table, dict):
        return table.get("min", 0.0), table.get("max", inf)
    return table, table


@dataclass(frozen=True)
class Case:
    """A problem's tables with the record of its answer."""

    tables: Part
    record: Part
    rng: np.random.Generator

    @cached_property
    def device(self) -> Part:
        return self.tables["device"]

    @property
    def T(self) -> float:
        return self.device["sample_time"]

    @property
    def dual(self) -> bool:
        return self.device.get("display") == "impedance"

    @property
    def servo(self) -> bool:
        return "servo" in self.device

    @property
    def rigid(self) -> bool:
        return self.dual and "environment" in self.tables

    @property
    def criterion(self) -> str:
        return self.tables["stability"]["criterion"]

    @property
    def factor(self) -> float:
        return self.tables["stability"].get("safety_factor", 1.05)

    @property
    def free(self) -> bool:
        """Whether the problem leaves something of its coupling free."""
        names = ("damping", "stiffness") if self.dual else ("damping", "mass", "drag")
        return any(not isinstance(self.tables.get("coupling", {}).get(name), float) for name in names)

    @cached_property
    def gains(self) -> tuple[float, float]:
        found = self.record["gains"]
        return found["velocity"], found["position"]

    @cached_property
    def euler(self) -> tuple[float, float] | None:
        """Mass and drag of M a + D v = F."""
        law = self.record["coupling"]
        return (law["mass"], law["drag"]) if self.record.get("rule") == "euler" else None

    @cached_property
    def coupling(self) -> tuple[float, ...]:
        """The coupling as the oracles have it; that of Euler's law by the trapezoidal rule."""
        law = {name: inf if value is None else value for name, value in self.record["coupling"].items()}
        if self.dual:
            return law["damping"], law["stiffness"]
        if self.euler:
            M, D = self.euler
            mass = M - D * self.T
            return 2 * mass / self.T, mass, D
        return law["damping"], law["mass"], law["drag"]

    @cached_property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """The hands with their tool."""
        of = [[ends(self.tables.get(table, {}).get(name, 0.0)) for name in NUMBERS] for table in ("operator", "tool")]
        low, high = np.sum(np.array(of), axis=0).T
        return low, high

    @cached_property
    def least_hand(self) -> Part:
        """The mass and the damping that a proof counts on in every passive hand."""
        low, _ = self.box
        counted = self.criterion != "hands" and ("environment" not in self.tables or self.rigid)
        flexible = self.dual and "structure" in self.device
        mass, damping = (float(low[0]), float(low[1])) if counted and not flexible else (0.0, 0.0)
        return {"mass": 0.0 if self.dual else mass, "damping": damping}

    @cached_property
    def held(self) -> tuple[np.ndarray, np.ndarray]:
        """The hands in which rings and chatter are taken: those of the box, or the least operator."""
        low, high = self.box
        if self.criterion != "passive":
            return low, high
        least = np.array([low[0], low[1], 0.0])
        return least, least

    @cached_property
    def widths(self) -> Part:
        stated = self.tables.get("uncertainty", {})
        return {key: value for key, value in stated.items() if key not in ("unmodelled", "objective")}

    @cached_property
    def radii(self) -> list[list[float]]:
        return self.tables.get("uncertainty", {}).get("unmodelled", [])

    @cached_property
    def devices(self) -> list[Part]:
        """The corners of the box of devices."""
        low, high = ends_of(self.device, self.widths)
        shares = product((0.0, 1.0), repeat=len(self.widths))
        return [with_numbers(self.device, [*self.widths], low + (high - low) * np.array(share)) for share in shares]

    @cached_property
    def met(self) -> tuple[np.ndarray, np.ndarray]:
        """The box of environments."""
        of = [ends(self.tables["environment"].get(name, {})) for name in NUMBERS]
        low, high = np.array(of).T
        return low, high

    def loop(self, hand: Any = NOTHING, share: float = 1.0, device: Part | None = None, **more: Any) -> Loop:
        """Return the loop with a share of its coupling in a hand."""
        own = self.coupling
        if self.euler:
            M, D = (share * number for number in self.euler)
            mass = M - D * self.T
            own = 2 * mass / self.T, mass, D
            more["rule"] = (M, D, 0.0)
        else:
            own = tuple(number * share for number in own)
        return Loop(device or self.device, self.gains, own, tuple(float(x) for x in hand), **more)

    def device_of(self, part: Part) -> Part:
        """Return the device of a record."""
        numbers = dict(part.get("parts", {}))
        numbers |= {key: part[key] for key in ("mass", "damping", "delay") if part.get(key) and key in self.widths}
        keys = [key for key in self.widths if key in numbers]
        return with_numbers(self.device, keys, [numbers[key] for key in keys])

    def some_hands(self, many: int = 40, held: bool = False) -> Iterator[tuple[float, ...]]:
        """Yield the corners of the box of hands and some within."""
        low, high = self.held if held else self.box
        shares = [*product((0.0, 1.0), repeat=3), *(self.rng.random(3) ** self.rng.choice([1, 3]) for _ in range(many))]
        for share in shares:
            yield tuple(float(x) for x in low + (high - low) * np.array(share))


def hand_of(part: Part) -> tuple[float, float, float]:
    """Return the hand of a record."""
    return part["mass"], part["damping"], part["stiffness"]


# ------------------------------------------------------------------ transparency


def interpolates(case: Case, device: Part) -> bool:
    """Return whether the trapezoidal rule averages a servo's command: of a position that Euler's law does not make."""
    return device["servo"].get("command") == "position" and case.euler is None


def late(response: Callable[[Any, Any], Any], T: float) -> float:
    """Return the lag of a response at rest, s."""
    num = DIGITS
    s = num.i * num.number(1e-15) / num.number(T)
    return float(-num.context.arg(response(s, num)) / abs(s))


def lag(case: Case) -> float:
    """Return the lag of the loop, s: of hold, delay, actuator or servo, and of the velocity estimate."""
    if case.servo:
        table = case.device["servo"]
        more = case.T / 2 if interpolates(case, case.device) else 0.0
        return case.T / 2 + more + late(lambda s, num: frequency.low_pass(table, s, num), case.T)
    velocity = case.device
    if case.dual:
        velocity = case.device | {"velocity": {"from": "difference"} | case.device.get("velocity", {})}
    drive = late(lambda s, num: frequency.low_pass(case.device.get("actuator", {}), s, num), case.T)
    estimate = late(lambda s, num: frequency.estimate(velocity, s, num), case.T)
    return case.T / 2 + case.device.get("delay", 0.0) + drive + max(0.0, estimate)


def yardstick(case: Case) -> tuple[tuple[float, float], float, Part, str]:
    """Return band, Hz, reference impedance, weights and norm of the error."""
    stated = case.tables.get("transparency", {})
    low, high = stated.get("band_hz", [x / lag(case) for x in ((5e-3, 0.1) if case.servo else (2.5e-4, 0.015))])
    Z_0 = stated.get("reference_impedance")
    if Z_0 is None and case.servo:
        _, (mass, damping, stiffness) = case.box
        Z_0 = max(stiffness * lag(case), damping, mass / lag(case))
    elif Z_0 is None:
        Z_0 = 2 * pi * np.sqrt(low * high) * case.device["mass"]
    weights = dict.fromkeys(("admittance", "tracking", "coupling"), 1.0) | stated.get("weights", {})
    return (low, high), Z_0, weights, stated.get("norm", "rms")


def squares(case: Case, device: Part, hz: np.ndarray, delta: Any = 0) -> dict[str, np.ndarray]:
    """Return the squares of the three terms of the error, of a device whose mechanism is multiplied by 1 + delta."""
    _, Z_0, _, _ = yardstick(case)
    s = 2j * pi * hz
    if case.servo:
        table = device["servo"]
        zoh = frequency.hold({"sample_time": case.T}, s, DOUBLES)
        led = (1 + np.exp(-s * case.T)) / 2 if interpolates(case, device) else 1.0
        followed = frequency.low_pass(table, s, DOUBLES) * zoh * led
        Z_c = behind_force(case.coupling, s) if case.euler is None else case.euler[1] + case.euler[0] * s
        return {"admittance": 0 * hz, "tracking": abs(1 - followed) ** 2, "coupling": abs(Z_c / Z_0) ** 2}
    if not case.dual:
        at = frequency.demanded({"device": device}, case.gains, s, DOUBLES, delta)
        Z_c = behind_force(case.coupling, s)
        return {
            "admittance": abs(Z_0 * at.G_hh) ** 2,
            "tracking": abs(at.tracking) ** 2,
            "coupling": abs(Z_c / Z_0) ** 2,
        }
    push = frequency.low_pass(device.get("actuator", {}), s, DOUBLES) * frequency.hold(device, s, DOUBLES)
    velocity = device | {"velocity": {"from": "difference"} | device.get("velocity", {})}
    P_hh, P_hu, P_mh, P_mu = frequency.mechanism(device, s, DOUBLES)
    C = push * case.gains[0] * frequency.estimate(velocity, s, DOUBLES)
    G_hh = P_hh - P_hu * C * P_mh / (1 + P_mu * C)
    G_hu = P_hu * push / (1 + P_mu * C)
    return {
        "admittance": abs(1 / G_hh / Z_0) ** 2,
        "tracking": abs(1 - G_hu / G_hh) ** 2,
        "coupling": abs(Z_0 * offered(case.loop(device=device), np.exp(s * case.T))) ** 2,
    }


def behind_force(coupling: tuple[float, ...], s: Any) -> Any:
    """Return Z_c = b_0 + b_c m_c s/(b_c + m_c s), b_c infinite or not."""
    b_c, m_c, b_0 = coupling
    return b_0 + (m_c * s if np.isinf(b_c) else b_c * m_c * s / (b_c + m_c * s))


def apart(case: Case) -> list[str]:
    """Return the terms that no gain of an impedance display changes."""
    if not case.dual:
        return []
    free = isinstance(case.tables.get("gains", {}).get("velocity", 0.0), dict)
    if not free:
        return ["admittance", "tracking"]
    return [] if "structure" in case.device else ["tracking"]


def errors(case: Case, device: Part | None = None, phase: float | None = None) -> Part:
    """Return the error and its three terms, of the nominal device or of another, on the edge of a disc or not."""
    (low, high), _, weights, norm = yardstick(case)
    hz = np.geomspace(low, high, 20_001)
    delta = 0 if phase is None else interpolated(case, 2 * pi * hz * case.T) * np.exp(1j * phase)
    of = squares(case, device or case.device, hz, delta)

    def mean(square: np.ndarray) -> float:
        if norm == "peak":
            return float(np.sqrt(square.max()))
        return float(np.sqrt(np.trapezoid(square, dx=1 / 20_000)))

    counted = sum(weights[name] ** 2 * square for name, square in of.items() if name not in apart(case))
    return {name: mean(square) for name, square in of.items()} | {"error": mean(counted)}


def term(name: str) -> Callable[[Case, Part], Any]:
    """Return the oracle of the error or of one of its terms."""
    return lambda case, _: Near(errors(case)[name], 1e-6)


# ------------------------------------------------------------------ the least ratios


def on_band(case: Case) -> OnBand:
    """Return Llewellyn's condition of a case."""
    device = case.device
    return OnBand(device, case.gains, case.least_hand, [*case.widths], case.radii)


def least_on_band(case: Case) -> float:
    """Return the least Re Z_c / R over band, devices and responses."""
    posed, low, high = on_band(case), *ends_of(case.device, case.widths)
    if case.radii:
        low, high = np.array([0.0, 1.0]), np.ones(2)
    band = case.tables["stability"]["band_hz"]
    omega = frequencies(case.device, 2 * pi * band[0], 2 * pi * band[1], 1500)
    most, _, _ = worst(lambda w, place: posed.need(case.coupling, w, place), low, high, omega, case.rng)
    return 1 / most if most > 0 else inf


def interpolated(case: Case, theta: Any) -> Any:
    """Return the radius of a disc at angles; a servo's goes to 0 with the frequency."""
    hz = np.asarray(theta) / (2 * pi * case.T)
    knots = np.log(np.array(case.radii)).T
    r = np.exp(np.interp(np.log(np.maximum(hz, 1e-300)), *knots))
    return r * np.minimum(1, hz / case.radii[0][0]) if case.servo else r


def need_in_hand(case: Case, place: Any, theta: Any, share: float = 1.0) -> Any:
    """Return R over what the coupling offers in a hand, of a device whose uncertain numbers follow."""
    device = with_numbers(case.device, [*case.widths], place[3:]) if len(place) > 3 else case.device
    loop = case.loop(place[:3], share, device)
    if not case.radii or not case.servo:
        return need_of(loop, theta)
    z = turn(loop, theta)
    Z_seen = seen(loop, z)
    return (interpolated(case, theta) * abs(Z_seen) - Z_seen.real) / offered(loop, z).real


def beside_whole(case: Case) -> list[Case]:
    """Return the case and, of a delay within 5 % of a sample of a whole number, those on both sides of it."""
    key = "servo.delay" if case.servo else "delay"
    own = case.device.get("servo", case.device).get("delay", 0.0)
    other = case.device.get("force_sensor", {}).get("delay", 0.0)
    samples = (own + other) / case.T
    whole = round(samples)
    if case.widths or whole == 0 or abs(samples - whole) > 0.05:
        return [case]
    late = ("force_sensor.delay", other) if not own else (key, own)
    at = late[1] + (whole - samples) * case.T
    return [case, *(
        replace(case, tables=case.tables | {"device": with_numbers(case.device, [late[0]], [at - less * case.T])})
        for less in (0.0, 1e-7)
    )]  # fmt: skip


def least_in_hands(case: Case) -> float:
    """Return the least ratio over hands, devices and angles."""
    found = []
    for each in beside_whole(case):
        low, high = (np.r_[a, b] for a, b in zip(each.box, ends_of(each.device, each.widths), strict=True))
        theta = np.r_[np.geomspace(1e-6, 1e-3, 10)[:-1] if case.servo else [], angles(each.device, 200)]
        most, _, _ = worst(
            lambda t, place, each=each: need_in_hand(each, place, t), low, high, theta[theta < pi * (1 - 1e-9)],
            case.rng,
        )  # fmt: skip
        found.append(1 / most if most > 0 else inf)
    return min(found)


def any_hand(case: Case, share: float, *, wall: bool) -> float:
    """Return what is left in the worst passive hand of an impedance display with a share of its coupling."""
    theta = np.union1d(np.geomspace(2e-3, 3.1415, 400), np.linspace(0.02, 3.1415, 800))
    low, _ = case.box
    device = case.device | {"damping": case.device["damping"] + float(low[1])}
    centre, around = disc_of_hands(device, theta)
    loop = case.loop(share=share)
    z = turn(loop, theta)
    F = frequency.firmware(case.device.get("velocity", {}), case.T, z)
    Y = offered(loop, z)
    if wall:
        law = 1 / Y
        return float(((abs(1 + law * centre) - abs(law) * around) / abs(1 + law * centre)).min())
    edge = np.exp(2j * pi * np.linspace(0, 1, 1441))
    disc = centre[:, None] + around[:, None] * edge
    worst_of = (disc / (1 + case.gains[0] * F[:, None] * disc)).real.min(axis=1)
    return float(((Y.real + worst_of) / theta**2).min())


def rest_of_wall(case: Case, hand: Any, share: float, device: Part | None = None) -> float:
    """Return 1 less the spectral radius of a wall in a hand, with a share of its coupling."""
    loop = case.loop(hand, share, device)
    if (device or case.device).get("velocity", {}).get("from") != "measured":
        loop = replace(loop, world=(0.0, 1e9 * (loop.coupling[0] + loop.coupling[1] * case.T), 0.0))
    return 1 - radius(loop)


def behind(case: Case, hand: Any, share: float) -> float:
    """Return how much more damping the least environments have than a share of the coupling asks in a hand."""
    low, high = case.met
    if not (high[0] or high[2] or low[1]):  # nothing, or a damper
        return 1 - radius(case.loop(hand, share))
    theta = np.union1d(np.geomspace(1e-4, 0.1, 150), angles(case.device, 400))
    theta = theta[theta < pi * (1 - 1e-9)]
    loop = case.loop(hand, share)
    box = Box((low[0], low[2]), (high[0], high[2]))
    asked = damping_asked(loop, box, theta)
    left = (low[1] - asked) / abs(offered(loop, np.exp(0.5j)))
    return -1.0 if grows_before_least(case, loop) else float(left)


def grows_before_least(case: Case, loop: Loop) -> bool:
    """Whether a loop before the least of the environments grows."""
    mass, damping, stiffness = map(float, case.met[0])
    return radius(replace(loop, world=(mass, damping, stiffness))) > 1 + 1e-9


def walled(case: Case, hand: Any, share: float) -> float:
    """Return what the multiplier's condition leaves in a hand with a share of the coupling."""
    low, high = case.met
    corner = 2 * pi * case.record["certificate"]["hands"]["walls"]["corner_hz"]
    theta = np.union1d(np.geomspace(1e-3, 3.1415, 1500), np.linspace(0.01, 3.1415, 600))
    loop = case.loop(hand, share)
    left = condition(loop, theta, tuple(low), (high[0], high[2]), corner).min()
    return -1.0 if grows_before_least(case, loop) else float(left)


def alone(case: Case, share: float) -> float:
    """Return the least real part, relatively, of what a hand meets on the band with nothing behind."""
    band = case.tables["stability"]["band_hz"]
    s = 1j * frequencies(case.device, 2 * pi * band[0], 2 * pi * band[1], 4000)
    device = case.device
    at = frequency.demanded({"device": device}, case.gains, s, DOUBLES)
    sensor = device.get("force_sensor", {})
    F_s = frequency.low_pass(sensor, s, DOUBLES) * frequency.firmware(sensor, case.T, np.exp(s * case.T))
    Z_c = share * (case.coupling[2] + case.coupling[1] * s)
    Z = 1 / (at.G_hh + F_s * at.G_he / Z_c) + case.least_hand["damping"]
    return float((Z.real / abs(Z)).min())


def flips(left: Callable[[float], float], ratio: float | None, beside: float = BESIDE) -> Holds:
    """Return whether something is left above 1/ratio of the coupling, and nothing below."""
    if ratio is None:
        return Holds(left(1e-3) > 0)
    return Holds(left((1 + beside) / ratio) > 0 >= left((1 - beside) / ratio))


def hands_ratio(case: Case, part: Part) -> Any:
    """The least ratio in hands: at its hand by definition, and in no other hand less."""
    if "worlds" in part:
        hand, ratio = hand_of(part["worst_hand"]), part["min_ratio"]
        share = 1 / ((ratio or 1e3) * (1 - 0.01))
        worse = [other for other in case.some_hands(12) if behind(case, other, share) < 0]
        if case.widths or len(beside_whole(case)) > 1:
            return Holds(not worse)
        return Holds(flips(lambda share: behind(case, hand, share), ratio).value and not worse)
    return Near(least_in_hands(case), 2e-3)


def walls_ratio(case: Case, part: Part) -> Any:
    """The least ratio of the multiplier's condition."""
    hand, ratio = hand_of(part["worst_hand"]), part["min_ratio"]
    share = 1 / ((ratio or 1e3) * (1 - 0.01))
    worse = [other for other in case.some_hands(12) if walled(case, other, share) < 0]
    there = ratio is None or walled(case, hand, (1 + 4e-3) / ratio) > 0 > walled(case, hand, (1 - 0.02) / ratio)
    return Holds(there and not worse)


def wall_ratio(case: Case, part: Part) -> Any:
    """The least multiple of a wall that is unstable."""
    limit = part["min_ratio"]
    if "box" not in part:
        if limit is None:
            return Holds(any_hand(case, 1e3, wall=True) > 0)
        return Holds(any_hand(case, limit * 0.998, wall=True) > 0 > any_hand(case, limit * 1.002, wall=True))
    hand = hand_of(part["worst_hand"])
    some = case.devices if case.widths else [case.device]
    stable = all(
        rest_of_wall(case, other, (limit or 1e3) * 0.995, device) > -1e-9 for other in case.some_hands(30)
        for device in some
    )  # fmt: skip
    unstable = limit is None or any(rest_of_wall(case, hand, limit * (1 + 2.5e-2), device) < -1e-8 for device in some)
    return Holds(bool(stable and unstable))


def any_hand_ratio(case: Case, part: Part) -> Any:
    """The least Re 1/Z_c / R in any passive hand."""
    ratio = part["min_ratio"]
    if ratio is None:
        return Holds(any_hand(case, 1e3, wall=False) >= 0)
    return Holds(any_hand(case, ratio * 0.997, wall=False) > 0 > any_hand(case, ratio * 1.003, wall=False))


def least_ratio(case: Case, part: Part) -> Any:
    """The least of all ratios of a certificate."""
    found = [part[name]["min_ratio"] for name in ("hands", "any_hand", "wall") if part.get(name)]
    if walls := (part.get("hands") or {}).get("walls"):
        found.append(walls["min_ratio"])
    if "alone" in {claim["id"] for claim in part["claims"]}:
        ratio = part["min_ratio"]
        if ratio is None:
            return Holds(alone(case, 1e3) < 0 or alone(case, 1e-3) >= 0)
        if ratio in found:
            return Holds(alone(case, 1 / (ratio * (1 - BESIDE))) >= 0)
        return flips(lambda share: alone(case, share), ratio)
    if part["band_hz"] is not None:
        found.append(least_on_band(case))
    least = min(inf if each is None else each for each in found)
    return Near(least, 2e-3) if 1e-300 < least < inf else Said(None)  # 1e-300: where R overflows


def ratio_there(case: Case, part: Part, hz: float) -> float:
    """Return R over what the coupling offers at a frequency on the band, on the device of the least ratio."""
    device = (case.record.get("uncertainty") or {}).get("min_ratio_device")
    known = case.device if device is None or not case.widths else case.device_of(device)
    posed = OnBand(known, case.gains, case.least_hand, [], case.radii)
    turns = np.linspace(0, 1, 4001)
    if not case.radii:
        return float(posed.need(case.coupling, 2 * pi * hz, np.zeros(0)))
    return max(float(posed.need(case.coupling, 2 * pi * hz, (share, 1.0))) for share in turns)


def least_place(case: Case, part: Part) -> Any:
    """The frequency at which the least ratio is taken, of the claim that has it."""
    of = [part[name] for name in ("hands", "any_hand", "wall") if part.get(name)]
    of += [part["hands"]["walls"]] if (part.get("hands") or {}).get("walls") else []
    for claim in of:
        if claim["min_ratio"] == part["min_ratio"]:
            return Said(claim["worst_hz"])
    if "alone" in {claim["id"] for claim in part["claims"]}:
        low, high = part["band_hz"]
        return Within(low, high)
    there = ratio_there(case, part, part["worst_hz"])
    return Holds(there == inf if part["min_ratio"] is None else abs(there * part["min_ratio"] - 1) < 1e-4)


def hands_place(case: Case, part: Part) -> Any:
    """The frequency at which the ratio in the worst hand is the least one."""
    hz, ratio, hand = part["worst_hz"], part["min_ratio"], hand_of(part["worst_hand"])
    if ratio is None:
        return Holds(True)
    if "worlds" in part or case.widths or hz == 0 or len(beside_whole(case)) > 1:
        return Within(0.0, 0.5 / case.T * (1 + 1e-9))
    theta = np.clip(2 * pi * hz * case.T, 1e-9, pi * (1 - 1e-6))
    need = float(need_in_hand(case, np.array(hand), np.array([theta]))[0])
    return Holds(abs(need * ratio - 1) < 1e-3)


def wall_place(case: Case, part: Part) -> Any:
    """The frequency at which the wall of the least unstable multiple has a pole on the circle."""
    if part["min_ratio"] is None or "box" not in part or case.widths:
        return Holds(part["worst_hz"] is None or 0 <= part["worst_hz"] <= 0.5 / case.T * (1 + 1e-9))
    loop = case.loop(hand_of(part["worst_hand"]), part["min_ratio"])
    if case.device.get("velocity", {}).get("from") != "measured":
        loop = replace(loop, world=(0.0, 1e9 * (loop.coupling[0] + loop.coupling[1] * case.T), 0.0))
    z = np.exp(2j * pi * part["worst_hz"] * case.T)
    return Holds(bool(np.abs(np.linalg.eigvals(matrix(loop)) - z).min() < 2e-2))


def in_box(name: str) -> Callable[[Case, Part], Any]:
    """Return the oracle of a number of a hand: it is one of the box."""

    def oracle(case: Case, _: Part) -> Any:
        low, high = (end[NUMBERS.index(name)] for end in case.box)
        return Within(float(low), float(high))

    return oracle


def in_held(name: str) -> Callable[[Case, Part], Any]:
    """Return the oracle of a number of a hand in which rings or chatter are taken."""

    def oracle(case: Case, _: Part) -> Any:
        low, high = (end[NUMBERS.index(name)] for end in case.held)
        return Within(float(low), float(high))

    return oracle


def binding(name: str) -> Callable[[Case, Part], Any]:
    """Return the oracle of the binding environment: the spring or mass that takes away the reactance at its place."""

    def oracle(case: Case, part: Part) -> Any:
        if "environment" in case.tables:
            k = NUMBERS.index(name)
            return Within(float(case.met[0][k]), float(case.met[1][k]))
        if case.widths or len(beside_whole(case)) > 1:
            return Holds(True)
        found = case.record["certificate"]["hands"]
        theta = min(max(2 * pi * found["worst_hz"] * case.T, 1e-9), pi * (1 - 1e-9))
        loop = case.loop(hand_of(found["worst_hand"]), case.factor if case.dual else 1 / case.factor)
        z, u = np.exp(1j * theta), 2 / case.T * np.tan(theta / 2)
        rest = complex(offered(loop, z) + seen(loop, z)).imag
        reactance = 1 / rest if case.dual else -rest
        return Near(max(reactance / u, 0.0) if name == "mass" else max(-reactance * u, 0.0), 1e-3)

    return oracle


def least_held(case: Case) -> Loop:
    """Return the loop of a wall on the nominal device in the least of its hands."""
    low, _ = case.box
    return case.loop(low if case.criterion == "hands" else (low[0], low[1], 0.0))


def wall_opened(case: Case, theta: Any) -> Any:
    """Return L of the loop that a wall closes: what the firmware answers, opened at the motor's force."""
    loop = least_held(case)
    z = turn(loop, theta)
    open_ = replace(loop, coupling=(0.0, 0.0))
    law = 1 / offered(loop, z)
    if case.device.get("velocity", {}).get("from") == "measured":
        return measured_wall(loop, z)
    return law * seen(open_, z)


def measured_wall(loop: Loop, z: Any) -> Any:
    """Return L of a wall whose damper acts on the measured velocity."""
    size, at = Memory(loop).size, Memory(loop).at
    one, still = np.eye(size), replace(loop, coupling=(0.0, 0.0))
    after, _ = step(still, one)
    pushed = np.zeros(size)
    pushed[at["commands"].stop - 1] = 1.0
    if loop.late[0] == 0:
        pushed[at["body"]] = loop.spans["new"][1]
    x = np.linalg.solve(z[:, None, None] * np.eye(size) - after, pushed[:, None])[..., 0]
    F = frequency.firmware(loop.device.get("velocity", {}), loop.T, z)
    b_c, k_c = loop.coupling
    return k_c * x[:, at["body"].start] + b_c * F * x[:, at["body"].start + 1]


def crossed(L: Callable[[Any], Any], theta: np.ndarray) -> list[float]:
    """Return the distances, deg, from -1 of an open loop where its modulus is 1."""
    size, found = np.log(abs(L(theta))), []
    for k in np.flatnonzero(np.sign(size[1:]) != np.sign(size[:-1])):
        at = brentq(lambda t: float(np.log(abs(L(np.array([t]))[0]))), theta[k], theta[k + 1], xtol=1e-13)
        found.append(float(np.degrees(abs(np.angle(-L(np.array([at]))[0])))))
    return found


def wall_peak(case: Case, part: Part) -> Any:
    """The greatest |S| of the loop that a wall closes."""
    if part["peak_sensitivity"] is None:
        return Holds(part["verdict"] != "proved")
    theta = np.union1d(angles(case.device, 2000), np.geomspace(1e-6, 1e-3, 200))
    theta = theta[theta < pi * (1 - 1e-9)]
    most, _, _ = worst(lambda t, _: 1 / abs(1 + wall_opened(case, t)), np.zeros(0), np.zeros(0), theta, case.rng)
    return Near(most, 1e-3)


def wall_loud_at(case: Case, part: Part) -> Any:
    """Where |S| of the loop that a wall closes has its peak."""
    theta = np.array([2 * pi * part["peak_sensitivity_hz"] * case.T])
    return Holds(abs(float(1 / abs(1 + wall_opened(case, theta))[0]) / part["peak_sensitivity"] - 1) < 1e-3)


def wall_phase(case: Case, part: Part) -> Any:
    """The least turn of the loop that a wall closes to -1."""
    if part["phase_margin_deg"] is None:
        return Holds(True)
    theta = np.union1d(angles(case.device, 3000), np.geomspace(1e-6, 1e-3, 300))
    found = crossed(lambda t: wall_opened(case, t), theta[theta < pi * (1 - 1e-9)])
    return Near(min(found), 1e-4)


# ------------------------------------------------------------------ the velocity loop


def largest(case: Case, _: Part) -> Any:
    """The peak of |S| over all devices."""
    some = case.devices if case.widths else [case.device]
    return Near(max(peak(Loop(device, case.gains), case.rng) for device in some), 1e-3)


def loud_at(case: Case, part: Part) -> Any:
    """Where |S| has its peak, on some device of the box."""
    if case.widths:
        return Within(0.0, 0.5 / case.T * (1 + 1e-9))
    loop, theta = Loop(case.device, case.gains), min(2 * pi * part["peak_sensitivity_hz"] * case.T, pi * (1 - 1e-9))
    return Holds(abs(abs(sensitivity(loop, np.exp(1j * theta))) / part["peak_sensitivity"] - 1) < 1e-3)


def gain_margin(case: Case, part: Part) -> Any:
    """The factor of the gains at which the loop's stability changes."""
    if part["gain_margin_db"] is None:
        return Holds(all(
            (radius(Loop(case.device, tuple(x * by for x in case.gains)), at_rest=True) < 1) == part["stable"]
            for by in np.geomspace(1, 1e3, 30)
        ))  # fmt: skip
    by = 10 ** (part["gain_margin_db"] / 20)

    def grown(factor: float) -> float:
        return radius(Loop(case.device, tuple(x * factor for x in case.gains)), at_rest=True) - 1

    return Holds(
        min(grown(by * (1 - 1e-4)), grown(by * (1 + 1e-4))) < 0 < max(grown(by * (1 - 1e-4)), grown(by * (1 + 1e-4)))
    )


def open_loop(case: Case, theta: Any) -> Any:
    """Return L at angles."""
    loop = Loop(case.device, case.gains)
    return 1 / sensitivity(loop, turn(loop, theta)) - 1


def phase_margin(case: Case, part: Part) -> Any:
    """The least turn of L to -1 where |L| is 1."""
    theta = angles(case.device, 1500)
    crossings = crossed(lambda t: open_loop(case, t), theta[theta < pi * (1 - 1e-9)])
    if not crossings:
        return Said(None)
    found = part["phase_margin_deg"]
    return Holds(found is not None and abs(abs(found) - min(crossings)) < 1e-4 * min(crossings) + 1e-6)


def delay_margin(case: Case, part: Part) -> Any:
    """The delay more at which the loop becomes unstable."""
    more = part["delay_margin_s"]
    if more is None or not part["stable"]:
        return Holds(True)
    own = case.device.get("delay", 0.0)

    def grown(extra: float) -> float:
        return radius(Loop(case.device | {"delay": float(f"{own + extra:.12g}")}, case.gains), at_rest=True) - 1

    shorter = [grown(more * share) for share in (0.1, 0.3, 0.5, 0.7, 0.9, 1 - 1e-3)]
    return Holds(max(shorter) < 1e-9 and grown(more * (1 + 1e-3)) > 0)


def spectral(case: Case, _: Part) -> Any:
    """The greatest modulus of a pole of the sampled loop, without a hand and with the environment at rest."""
    return Near(radius(Loop(case.device, case.gains), at_rest=True), 1e-6)


def poles_outside(case: Case, _: Part) -> Any:
    """How many poles of the closed loop are outside the circle."""
    z = np.linalg.eigvals(matrix(Loop(case.device, case.gains), at_rest=True).astype(float))
    return Said(int((abs(z) > 1).sum()))


# ------------------------------------------------------------------ what the hand feels


def felt(case: Case, hz: float, gains: tuple[float, float] | None = None, world: Any = NOTHING) -> complex:
    """Return force over velocity of the handle that is pushed at a frequency."""
    own: tuple[float, ...] = case.euler or case.coupling
    law = (0.0, 0.0) if gains is not None else case.gains
    if gains is not None:
        own = (0.0, 0.0) if case.dual else (1.0, 1.0, 1.0)
    if case.rigid and gains is None:
        world = (0.0, 0.0, 0.0)
    return Stepped(dict(case.device), law, own, tuple(float(x) for x in world), 2 * pi * hz).felt()


def least_world(case: Case) -> tuple[float, ...]:
    """Return the environment with which free motion is felt."""
    if "environment" not in case.tables or case.rigid:
        return NOTHING
    return tuple(float(x) for x in case.met[0])


def felt_free(of: Callable[[complex], float], unit: float, *, bare: bool = False) -> Callable[[Case, Part], Any]:
    """Return the oracle of mass or damping of free motion at 1 Hz, to 3e-6 of the impedance."""

    def oracle(case: Case, _: Part) -> Any:
        Z = felt(case, 1.0, (0.0, 0.0)) if bare else felt(case, 1.0, world=least_world(case))
        return Within(of(Z) - 3e-6 * abs(Z) / unit, of(Z) + 3e-6 * abs(Z) / unit)

    return oracle


def felt_wall(case: Case, _: Part) -> Any:
    """The stiffness at 10 Hz of the stiffest wall of the box, the least tool's inertia apart."""
    (mass, damping, _), (_, _, stiffness) = case.met
    w, Z = 20 * pi, felt(case, 10.0, world=(mass, damping, stiffness))
    return Near(float(w * (w * mass - Z.imag)), 1e-5)


def first_speed(case: Case) -> float:
    """Return the command of a servo at rest in the first sample of 1 N."""
    loop = case.loop()
    memory = np.zeros(Memory(loop).size)
    _, out = step(loop, memory, misheard=1.0)
    return float(out)


def count(case: Case, _: Part) -> Any:
    """The force of a step of the position in its sample, without filters."""
    q, (K_v, K_p) = case.device["velocity"]["resolution"], case.gains
    if case.dual:
        b_c, k_c = case.coupling
        return q * (k_c + (b_c + K_v) / case.T)
    return q * (K_p + K_v / case.T)


def limp(case: Case, _: Part) -> Any:
    """Whether K_p is less than Z_0 times the lower edge of the band, and a force is met behind it."""
    (low, _), Z_0, _, _ = yardstick(case)
    met = case.tables.get("environment", {})
    nothing = "mass" in met and met["mass"].get("max") == 0 == met["stiffness"].get("max")
    return Said(case.gains[1] < Z_0 * 2 * pi * low and not nothing)


def numbers_in(text: str) -> list[float]:
    """Return the numbers of a text."""
    found = []
    for word in text.replace(",", " ").split():
        try:
            found.append(float(word))
        except ValueError:
            continue
    return found


def told_world(case: Case, part: Part) -> Any:
    """The words of the least environment have its numbers."""
    stated = [x for x in least_world(case) if x]
    told = numbers_in(part["behind"])
    return Holds(np.allclose(told, stated, rtol=1e-3))


# ------------------------------------------------------------------ rest, chatter, rings


def step_of_damper(case: Case, device: Part) -> tuple[float, float]:
    """Return b q/T times the peak of the filter's impulse response, and times half of its rises and falls."""
    table = device.get("velocity", {})
    if table.get("from", "difference" if case.dual else "measured") == "measured":
        return 0.0, 0.0
    z = np.exp(2j * pi * (np.arange(20_000) + 0.5) / 20_000)
    # the samples of the response from its values between the roots of unity
    h = np.fft.ifft(frequency.firmware(table, case.T, z))
    h = (h * np.exp(1j * pi * np.arange(20_000) / 20_000)).real
    b = case.gains[0] + (case.coupling[0] if case.dual else 0.0)
    force = b * table["resolution"] / case.T
    return float(force * np.abs(h).max()), float(force * np.abs(np.diff(np.r_[0.0, h, 0.0])).sum() / 2)


def spring_step(case: Case) -> float:
    """Return the force of a step of the position by the spring."""
    return (case.coupling[1] if case.dual else case.gains[1]) * case.device["velocity"]["resolution"]


def rests(case: Case, _: Part) -> Any:
    """Whether the step of the spring is at most twice the friction, in decimals."""
    k = case.coupling[1] if case.dual else case.gains[1]
    q, f = case.device["velocity"]["resolution"], case.device.get("friction")
    return Said(None if f is None else Fraction(repr(k)) * Fraction(repr(q)) <= 2 * Fraction(repr(f)))


def settles(case: Case, part: Part) -> Any:
    """Proved of a wall in any passive hand whose friction holds spring and damper; false if a kick keeps moving."""
    proved = {claim["id"]: claim["verdict"] == "proved" for claim in case.record["certificate"]["claims"]}
    if (
        case.device.get("friction") is None
        or "velocity" not in case.device
        or "resolution" not in case.device["velocity"]
    ):
        return Said(None)
    moves = spring_step(case) / 2 + max(step_of_damper(case, device)[1] for device in case.devices)
    if case.device.get("actuator", {}).get("order", 1) == 2:  # whose force overshoots
        _, force = signal.step(([1.0], [1.0, np.sqrt(2), 1.0]), T=np.linspace(0, 60, 60_001))
        moves *= np.abs(np.diff(force)).sum()
    holds = moves <= case.device["friction"]
    bare = not case.box[0].any()
    if proved.get("wall_in_any_hand") and holds and bare and "structure" not in case.device:
        return Said(True)
    return Said(False if case.record["buzz"] and case.record["buzz"]["moving"] else None)


def swung(case: Case, part: Part, reading: str, hand: Any) -> list[tuple[float, float]]:
    """Return half a step times the sums of absolute responses of motion and force, before each environment."""
    boxed = "environment" in case.tables and not case.rigid
    worlds: list[Any] = (
        [None, NOTHING] if not boxed else [(float(end[0]), float(case.met[0][1]), float(end[2])) for end in case.met]
    )
    worlds = [None] if case.rigid else worlds
    found = []
    for world in worlds:
        loop = case.loop(hand, world=world or NOTHING)
        at, memory = Memory(loop).at, np.zeros(Memory(loop).size)
        given = 0.0 if world is None and not case.rigid and not case.dual else None
        if case.dual:
            loop = replace(loop, world=IMMOVABLE) if world is None else loop
            given = 0.0 if world == NOTHING else None
        memory, _ = step(loop, memory, given, **{"misread" if reading == "encoder" else "misheard": 1.0})
        each, _ = step(loop, np.eye(len(memory)), None if given is None else 0.0 * np.zeros(len(memory)))
        motion = force = before = 0.0
        for k in range(400_000):
            x = memory[at["body"]][0]
            motion += abs(x) if reading == "encoder" else abs(x - before) / case.T
            force += abs(memory[at["commands"]][-1])
            before, memory = x, each @ memory
            if k % 1000 == 999 and abs(memory[at["body"]]).max() < 1e-9 * motion:
                break
        found.append((part["step"] / 2 * motion, part["step"] / 2 * force))
    return found


def chatter(reading: str, k: int) -> Callable[[Case, Part], Any]:
    """Return the oracle of the chatter: at the hand of the record the motion, at any hand the force."""

    def oracle(case: Case, part: Part) -> Any:
        name = ("chatter_m" if reading == "encoder" else "chatter_m_s", "chatter_N")[k]
        if part[name] is None or case.widths:
            return Holds(True)
        there = max(found[k] for found in swung(case, part, reading, hand_of(part["hand"])))
        if k == 0:
            return Near(there, 5e-3)
        return Holds(there <= part[name] * 1.005)

    return oracle


def unfiltered(loop: Loop, used: bool) -> Loop:
    """Return the loop without the filters of a velocity that nothing uses: they ring unheard."""
    kept = {key: value for key, value in loop.device.get("velocity", {}).items() if key == "from"}
    return loop if used else replace(loop, device={**loop.device, "velocity": kept})


def rung(case: Case, hand: Any, device: Part | None = None) -> list[tuple[float, float, float]]:
    """Return the least damped oscillation of a hand before each environment."""
    loop = case.loop(hand, 1.0, device)
    free, held = (unfiltered(loop, used) for used in (case.gains[0] > 0, case.gains[0] + case.coupling[0] > 0))
    if case.dual:
        loop = held
    if case.rigid:
        measured = case.device.get("velocity", {}).get("from") == "measured"
        return [slowest(loop if measured else replace(loop, world=IMMOVABLE), at_rest=False)]
    if "environment" in case.tables:
        low, high = case.met
        wide = [(a, b if np.isfinite(b) else a) for a, b in zip(low, high, strict=True)]
        return [slowest(replace(loop, world=tuple(map(float, world))), at_rest=False) for world in product(*wide)]
    if case.dual:
        return [slowest(free, at_rest=True), slowest(replace(held, world=IMMOVABLE), at_rest=False)]
    return [slowest(loop, at_rest=rigid) for rigid in (False, True)]


def ringing(k: int) -> Callable[[Case, Part], Any]:
    """Return the oracle of damping ratio, frequency or time constant of what rings most."""

    def oracle(case: Case, part: Part) -> Any:
        some = case.devices if case.widths else [each.device for each in beside_whole(case)]
        there = [found for device in [case.device, *some] for found in rung(case, hand_of(part["hand"]), device)]
        name = ("damping_ratio", "frequency_hz", "time_constant_s")[k]
        if k == 0:
            least = min(found[0] for hand in case.some_hands(held=True) for found in rung(case, hand))
            if part[name] > least + 1e-6 + 0.005 * abs(least):
                return Near(least, 0.005)
        return Holds(case.widths != {} or any(abs(found[k] / part[name] - 1) < 2e-3 for found in there))

    return oracle


# ------------------------------------------------------------------ contact of a servo


def parts_of_latency(case: Case, device: Part | None = None) -> dict[str, float]:
    """Return the parts of a servo's latency, s."""
    known = device or case.device
    table, sensor, T = known["servo"], known.get("force_sensor", {}), case.T
    return {
        "hold": T / 2,
        "delay": table["delay"],
        "interpolation": T / 2 if interpolates(case, known) else 0.0,
        "lag": late(lambda s, num: frequency.low_pass({**table, "delay": 0.0}, s, num), T),
        "force sensor": late(lambda s, num: frequency.low_pass(sensor, s, num), T),
        "filter": late(lambda s, num: frequency.firmware(sensor, num.number(T), num.exp(s * num.number(T)), num), T),
    }


def latency(case: Case) -> float:
    """Return the latency of the slowest device."""
    return max(sum(parts_of_latency(case, device).values()) for device in case.devices)


def drags(case: Case, theta: np.ndarray) -> list[tuple[float, float, Any]]:
    """Return the resistance that each hand of a corner asks of a servo at angles, with its place."""
    found = []
    for device in case.devices:
        for each in beside_whole(replace(case, tables=case.tables | {"device": device, "uncertainty": {}})):
            for hand in list(case.some_hands(0)):
                loop = each.loop(hand)
                Z = seen(loop, turn(loop, theta))
                asked = -Z.real + (interpolated(case, theta) * abs(Z) if case.radii else 0.0)
                k = int(np.argmax(asked))
                found.append((float(asked[k]), float(theta[k]), hand))
    return found


def rest_drag(case: Case, _: Part) -> Any:
    """The least drag at rest: at a small angle, extrapolated."""
    most = max(0.0, *(asked for asked, _, _ in drags(case, np.array([1e-4]))))
    return Near(case.factor * most, 1e-3)


def drag_alone_at(case: Case, part: Part) -> Any:
    """Where that is asked, in its hand on some device."""
    theta = np.array([min(max(2 * pi * part["drag_alone_hz"] * case.T, 1e-6), pi * (1 - 1e-9))])
    hand, most = hand_of(part["drag_alone_hand"]), -inf
    for device in case.devices:
        for each in beside_whole(replace(case, tables=case.tables | {"device": device, "uncertainty": {}})):
            Z = seen(each.loop(hand), turn(each.loop(hand), theta))
            most = max(most, float((-Z.real + (interpolated(case, theta) * abs(Z) if case.radii else 0.0))[0]))
    return Holds(bool(case.widths) or abs(case.factor * most / part["drag_alone"] - 1) < 2e-3)


def own_spring(case: Case, _: Part) -> Any:
    """The drag at rest that the firmware's spring asks for: its stiffness times the latency without the sensor."""
    spring = case.device["servo"].get("stiffness", 0.0)
    least = max(sum(parts_of_latency(case, device | {"force_sensor": {}}).values()) for device in case.devices)
    return Near(case.factor * spring * least, 1e-5) if spring else Said(0.0)


def latency_key(case: Case, part: Part) -> Any:
    """The key that states a part of the latency."""
    keys = {
        "hold": "device.sample_time", "delay": "device.servo.delay", "interpolation": "device.sample_time",
        "lag": "device.servo.bandwidth_hz", "force sensor": "device.force_sensor",
        "filter": "device.force_sensor.filter_coefficient",
    }  # fmt: skip
    sections = "sections" in case.device.get("force_sensor", {}) and part["part"] == "filter"
    return Said(
        "device.force_sensor.sections"
        if sections and "filter_coefficient" not in case.device["force_sensor"]
        else keys[part["part"]]
    )


def drag_alone(case: Case, _: Part) -> Any:
    """The greatest resistance of all hands and angles."""
    theta = np.union1d(np.geomspace(1e-4, pi * (1 - 1e-9), 800), np.linspace(0.01, pi * (1 - 1e-9), 800))
    most = max(asked for asked, _, _ in drags(case, theta))
    if case.widths:  # the worst device may lie inside the box
        low, high = (np.r_[a, b] for a, b in zip(case.box, ends_of(case.device, case.widths), strict=True))
        rigid = replace(case, record=case.record | {"coupling": {"damping": None, "mass": 1.0, "drag": 1.0}})
        found, _, _ = worst(
            lambda t, place: need_in_hand(rigid, place, t), low, high, theta, case.rng, some=60, closer=6
        )
        most = max(most, found)
    return Near(case.factor * most, 2e-3)


def stiffest(case: Case, part: Part) -> Any:
    """The stiffest contact, at most a thousandth and four digits below the limit of the oracle."""
    if "environment" in case.tables or part["stiffest_contact"] is None or case.widths or case.radii:
        return Holds(True)
    low, high = case.box

    def left(stiffness: float) -> float:
        hands = replace(case, tables=case.tables | {
            "operator": {name: {"min": float(a), "max": float(b)} for name, a, b in zip(
                NUMBERS, low, (high[0], high[1], stiffness), strict=True)}, "tool": {},
        })  # fmt: skip
        return least_in_hands(hands) / case.factor - 1

    limit = part["stiffest_contact"]
    if limit == float(high[2]):
        return Holds(left(limit) > -1e-3)
    return Holds(left(limit) > -1e-4 and left(limit * 1.004) < 1e-4)


# ------------------------------------------------------------------ uncertain devices


def worst_error(case: Case, _: Part) -> Any:
    """The greatest error at the corners of the box of devices, or on the edge of a disc at one of its phases."""
    if case.radii and not case.servo:
        phase = np.radians(case.record["uncertainty"]["worst_device"]["unmodelled"]["phase_deg"])
        return Near(errors(case, phase=phase)["error"], 1e-6)
    return Near(max(errors(case, device)["error"] for device in case.devices), 1e-6)


def worst_device(case: Case, part: Part) -> Any:
    """A device whose error is the greatest one."""
    found = case.record["uncertainty"]
    return Holds(abs(errors(case, case.device_of(found["worst_device"]))["error"] / found["worst_error"] - 1) < 1e-6)


def in_devices(name: str) -> Callable[[Case, Part], Any]:
    """Return the oracle of a number of a device of the box."""

    def oracle(case: Case, _: Part) -> Any:
        if name in case.widths:
            low, high = ends_of(case.device, {name: case.widths[name]})
            return Within(float(low[0]) * (1 - 1e-9), float(high[0]) * (1 + 1e-9))
        own = [each.device.get(name, 0.0) for each in beside_whole(case)]
        return Within(min(own), max(own))

    return oracle


def device_parts(case: Case, part: Part) -> Any:
    """The parts of a device of the box lie in it; a delay without a box beside the stated one, at whole samples."""
    low, high = ends_of(case.device, case.widths)
    box = dict(zip(case.widths, zip(low, high, strict=True), strict=True))
    for key in part["parts"].keys() - box.keys():
        table, _, name = key.partition(".")
        beside = [each.device[table][name] for each in beside_whole(case)]
        box[key] = min(beside), max(beside)
    return Holds(all(box[key][0] * (1 - 1e-9) <= x <= box[key][1] * (1 + 1e-9) for key, x in part["parts"].items()))


def box_ends(name: str) -> Callable[[Case, Part], Any]:
    """Return the oracle of a box of hands, tools or environments."""

    def oracle(case: Case, part: Part) -> Any:
        if name == "worlds":
            low, high = case.met
        elif name == "tool":
            of = [ends(case.tables["tool"].get(each, 0.0)) for each in ("mass", "damping")] + [(0.0, 0.0)]
            low, high = np.array(of).T
        else:
            low, high = case.box
        told = {key: [x if np.isfinite(x) else None for x in map(float, pair)] for key, pair in zip(
            NUMBERS, zip(low, high, strict=True), strict=True)}  # fmt: skip
        return Holds(all(np.allclose(
            [inf if x is None else x for x in pair], [inf if x is None else x for x in told[key]], rtol=1e-9, atol=0
        ) for key, pair in part[name].items()))  # fmt: skip

    return oracle


def uncertain_box(case: Case, part: Part) -> Any:
    """The ends of the uncertain numbers."""
    low, high = ends_of(case.device, case.widths)
    wanted = dict(zip(case.widths, np.array([low, high]).T, strict=True))
    return Holds(
        part["box"].keys() == wanted.keys()
        and all(np.allclose(part["box"][key], wanted[key], rtol=1e-9) for key in wanted)
    )


# ------------------------------------------------------------------ claims


def claims_of(case: Case) -> set[str]:
    """Return the claims that a problem asks for."""
    if case.rigid:
        return {"wall_in_hands" if case.criterion == "hands" else "wall_in_any_hand"}
    found = set() if case.servo else {"sensitivity", "stable"}
    nothing = "environment" in case.tables and case.met[1][0] == 0 and case.met[1][2] == 0
    if case.criterion != "hands" and not case.dual and not case.servo:
        found |= {"stable_model", "alone" if nothing else "passive"}
    if case.criterion != "hands" and case.dual:
        found.add("any_hand")
    if case.criterion != "passive" and not (case.dual and case.criterion == "both"):
        found.add("worlds" if "environment" in case.tables else "hands")
    if case.tables.get("environment", {}).get("walls"):
        found.add("walls")
    if case.radii and not case.servo:
        found.add("unmodelled")
    if case.tables["stability"].get("rest"):
        found.add("rests")
    return found


def claim_id(case: Case, _: Part) -> Any:
    """The claims of a certificate are those that the problem asks for."""
    return Holds({claim["id"] for claim in case.record["certificate"]["claims"]} == claims_of(case))


def claim_verdict(case: Case, part: Part) -> Any:
    """A claim is proved where its limit is met, refuted where it is missed."""
    if part["verdict"] == "undecided":
        return Holds(True)
    proof, loop = case.record["certificate"], case.record["inner_loop"]
    hands = proof.get("hands") or {}
    ratios = {
        "hands": hands.get("min_ratio"), "worlds": hands.get("min_ratio"),
        "walls": (hands.get("walls") or {}).get("min_ratio"),
        "any_hand": (proof.get("any_hand") or {}).get("min_ratio"),
        "wall_in_hands": (proof.get("wall") or {}).get("min_ratio"),
        "wall_in_any_hand": (proof.get("wall") or {}).get("min_ratio"),
        "passive": least_on_band(case) if part["id"] == "passive" else None,
    }  # fmt: skip
    if part["id"] == "stable":
        met = all(radius(Loop(device, case.gains), at_rest=True) < 1 for device in case.devices)
    elif part["id"] == "sensitivity":
        met = (1.0 if loop is None else loop["peak_sensitivity"]) <= case.tables["stability"].get(
            "max_sensitivity", 2.0
        )
    elif part["id"] == "alone":
        met = alone(case, 1 / case.factor) >= -1e-9
    elif part["id"] in ratios:
        ratio = ratios[part["id"]]
        met = ratio is None or ratio >= case.factor * (1 - 1e-3)
    else:
        return Holds(True)
    return Holds(met == (part["verdict"] == "proved"))


def worst_of_claims(case: Case, part: Part) -> Any:
    """The verdict on a design is the worst of its claims."""
    verdicts = {claim["verdict"] for claim in case.record["certificate"]["claims"]}
    return Said(next(each for each in ("refuted", "undecided", "proved") if each in verdicts))


def verdict_of(*claims: str) -> Callable[[Case, Part], Any]:
    """Return the oracle of the verdict on some claims."""

    def oracle(case: Case, _: Part) -> Any:
        found = [claim["verdict"] for claim in case.record["certificate"]["claims"] if claim["id"] in claims]
        return Said(next(each for each in ("refuted", "undecided", "proved") if each in found))

    return oracle


def status(case: Case, _: Part) -> Any:
    """The status follows from the verdict."""
    if case.record["certificate"] is None:
        return Holds(case.record["status"] in ("infeasible", "undecided"))
    verdict = case.record["certificate"]["verdict"]
    return Said({"proved": "certified", "refuted": "violated", "undecided": "undecided"}[verdict])


def proved_ratio(case: Case, part: Part) -> Any:
    """Where everything is proved, the safety factor is; it never exceeds the least ratio."""
    ratio, proved = part["min_ratio"], part["proved_ratio"]
    if proved is None:
        return Said(None)
    if part["verdict"] == "proved":
        return case.factor
    return Holds(proved in (1.0, case.factor) and proved <= (ratio or inf) * (1 + 1e-3))


def boxes(case: Case, part: Part) -> Any:
    """A proof takes at least a box, and no part takes more than the whole."""
    return Within(0, case.record["certificate"]["boxes"])


def delay_of(case: Case) -> float:
    """Return the delay of command and sensor together, s."""
    own = case.device.get("servo", case.device).get("delay", 0.0)
    return float(own + case.device.get("force_sensor", {}).get("delay", 0.0))


def beside_verdict(case: Case, part: Part) -> Any:
    """Beside a whole sample the least ratio on both sides decides."""
    ratio = min(least_in_hands(each) for each in beside_whole(case)[1:])
    if part["verdict"] == "undecided" or abs(ratio / case.factor - 1) < 2e-3:
        return Holds(True)
    return Said("proved" if ratio > case.factor else "refuted")


def witness(case: Case, part: Part) -> Any:
    """A proved claim has no witness; another's lies up to Nyquist."""
    hz = part["witness_hz"]
    if part["verdict"] == "proved" or hz is None:
        return Said(None)
    return Within(0.0, 0.5 / case.T * (1 + 1e-9))


def idle(case: Case, _: Part) -> Any:
    """Whether a certified design hardly uses its velocity loop."""
    found = case.record["transparency"]
    tracks = case.record["status"] == "certified" and not case.servo and not case.dual
    return Said(tracks and found is not None and found["tracking"] > 0.5)


COUNTED = "a count of work, which no design has"
DIGEST = "a digest, checked where a record is read (tests/document/test_edited_records.py)"
NAME = "a name that the user gave"
WORDS = "words, compared in tests/test_answers.py"
SHAKES = Elsewhere("simulation/test_shakes.py")
NULL_IS_SAID = (
    "certificate.min_ratio", "certificate.proved_ratio", "certificate.hands.min_ratio", "rest.rests", "rest.settles",
    "certificate.hands.walls.min_ratio", "certificate.any_hand.min_ratio", "certificate.wall.min_ratio",
    "inner_loop.gain_margin_db", "inner_loop.phase_margin_deg", "coupling.damping",
)  # fmt: skip
"""Paths whose null means something: no limit, or not known."""

Oracle = Callable[[Case, Part], Any] | Elsewhere | str


def _hand(of: str, name: Callable[[str], Any] = in_box) -> dict[str, Oracle]:
    return {f"{of}.{number}": name(number) for number in NUMBERS}


def _device(of: str) -> dict[str, Oracle]:
    """Return the oracles of a device of a box."""
    share = "of the worst response of a disc, with which the ratio there is tried over all turns (`ratio_there`)"
    return {f"{of}.{name}": in_devices(name) for name in ("mass", "damping", "delay")} | {
        f"{of}.parts.{{}}": device_parts, f"{of}.unmodelled.share": share, f"{of}.unmodelled.phase_deg": share,
    }  # fmt: skip


def _world(of: str) -> dict[str, Oracle]:
    return {f"{of}.mass": binding("mass"), f"{of}.stiffness": binding("stiffness")}


def _chatter(of: str, reading: str) -> dict[str, Oracle]:
    def step_of(case: Case, _: Part) -> Any:
        return case.device["velocity" if reading == "encoder" else "force_sensor"]["resolution"]

    def before(case: Case, _: Part) -> Any:
        boxed = (
            "the least and the greatest environment" if "environment" in case.tables else "nothing and a rigid world"
        )
        return Said("a rigid world" if case.rigid else boxed)

    motion = "chatter_m" if reading == "encoder" else "chatter_m_s"
    other = "chatter_m_s" if reading == "encoder" else "chatter_m"
    return _hand(f"{of}.hand", in_held) | {
        f"{of}.step": step_of, f"{of}.before": before, f"{of}.{motion}": chatter(reading, 0),
        f"{of}.{other}": lambda *_: Said(None), f"{of}.chatter_N": chatter(reading, 1),
    }  # fmt: skip


def _given(table: str, name: str, default: Any = None) -> Callable[[Case, Part], Any]:
    """Return the oracle of a number that the problem states, or a range."""

    def oracle(case: Case, part: Part) -> Any:
        stated = case.tables.get(table, {}).get(name, default)
        if isinstance(stated, dict) or (stated is None and case.free):
            return Within(*ends(stated or {}))
        return Said(None) if stated == inf else stated

    return oracle


def misses(case: Case) -> float:
    """Return by which factor a design misses what is asked: below 1 it misses nothing."""
    found = []
    if not case.servo and not case.rigid:
        loops = [Loop(device, case.gains) for device in case.devices]
        found += [peak(loop, case.rng) / case.tables["stability"].get("max_sensitivity", 2.0) for loop in loops]
        found += [inf for loop in loops if radius(loop, at_rest=True) >= 1]
    if "band_hz" in case.tables["stability"] and not case.dual:
        found.append(case.factor / max(least_on_band(case), 1e-300))
    if (
        case.criterion != "passive"
        and "environment" not in case.tables
        and not (case.dual and case.criterion == "both")
    ):
        found.append(case.factor / least_in_hands(case))
    return max(found, default=1.0)


def nearest(case: Case, part: Part) -> Any:
    """The design that misses what is asked by least misses it, by less than one of a quarter more coupling."""
    there = replace(case, record=case.record | case.record["nearest"])
    return Holds(misses(there) > 1 - 1e-3)


def active(case: Case, part: Part) -> Any:
    """At an active constraint the design meets what is asked with equality."""
    demand, hz = part["demand"], part["hz"]
    if hz is None:
        return Holds(True)
    theta, device = min(2 * pi * hz * case.T, pi * (1 - 1e-9)), case.device_of(part.get("device") or {})
    if demand.startswith("|S|"):
        size = abs(sensitivity(Loop(device, case.gains), np.exp(1j * theta)))
        return Holds(abs(size / case.tables["stability"].get("max_sensitivity", 2.0) - 1) < 1e-2)
    return Holds(0 <= hz <= 0.5 / case.T * (1 + 1e-9))


def text_of(case: Case, part: Part) -> Any:
    """The text of a problem states its device and its coupling."""
    return Holds(tomllib.loads(part["text"])["device"] == case.device)


def display_of(case: Case, _: Part) -> Any:
    """The kind of display, where it is not an admittance display."""
    return Said("impedance" if case.dual else "servo" if case.servo else "admittance")


def latency_part(name: str) -> Callable[[Case, Part], Any]:
    """Return the oracle of a part of the latency, by its label."""

    def oracle(case: Case, part: Part) -> Any:
        if case.widths:
            return Holds(True)
        seconds = parts_of_latency(case)[part["part"]]
        return Near(seconds if name == "latency_s" else case.factor * float(case.box[1][2]) * seconds, 1e-5)

    return oracle


DESIGN: dict[str, Oracle] = {
    "schema": lambda *_: Said("vctune/design/1"),
    "problem.name": NAME,
    "problem.sha256": DIGEST,
    "problem.text": text_of,
    "problem.source": NAME,
    "problem.units": lambda case, _: Said(case.device.get("units", "linear")),
    "status": status,
    "reason": WORDS,
    "proved": lambda case, _: Said(None if case.record["gains"] else case.record["proved"]),
    "idle": idle,
    "rule": lambda case, _: Said(case.tables["coupling"].get("rule")),
    "gains.velocity": _given("gains", "velocity", 0.0),
    "gains.position": _given("gains", "position", 0.0),
    "coupling.damping": _given("coupling", "damping", inf),
    "coupling.mass": _given("coupling", "mass"),
    "coupling.drag": _given("coupling", "drag"),
    "coupling.stiffness": _given("coupling", "stiffness"),
    "transparency.display": display_of,
    "transparency.error": term("error"),
    "transparency.admittance": term("admittance"),
    "transparency.tracking": term("tracking"),
    "transparency.coupling": term("coupling"),
    "transparency.apart[]": lambda case, part: Holds(part["apart"] == apart(case)),
    "certificate.display": display_of,
    "certificate.verdict": worst_of_claims,
    "certificate.band_hz[]": lambda case, part: Holds(part["band_hz"] == case.tables["stability"].get("band_hz")),
    "certificate.proved_ratio": proved_ratio,
    "certificate.min_ratio": least_ratio,
    "certificate.worst_hz": least_place,
    "certificate.boxes": COUNTED,
    "certificate.claims[].id": claim_id,
    "certificate.claims[].claim": WORDS,
    "certificate.claims[].verdict": claim_verdict,
    "certificate.claims[].cut": Elsewhere("design/test_time_limit.py"),
    "certificate.claims[].witness_hz": witness,
    **_device("certificate.claims[].witness_device"),
    **_hand("certificate.claims[].witness_hand"),
    "certificate.hands.display": display_of,
    "certificate.hands.verdict": verdict_of("hands", "worlds"),
    "certificate.hands.box.{}[]": box_ends("box"),
    "certificate.hands.tool.{}[]": box_ends("tool"),
    "certificate.hands.min_ratio": hands_ratio,
    "certificate.hands.worst_hz": hands_place,
    **_hand("certificate.hands.worst_hand"),
    "certificate.hands.boxes": boxes,
    "certificate.hands.worlds.{}[]": box_ends("worlds"),
    **_world("certificate.hands.worst_world"),
    "certificate.hands.walls.display": display_of,
    "certificate.hands.walls.verdict": verdict_of("walls"),
    "certificate.hands.walls.corner_hz": lambda case, part: (
        case.tables["environment"].get("corner_hz") or Within(0, 1 / pi / case.T)
    ),
    "certificate.hands.walls.min_ratio": walls_ratio,
    "certificate.hands.walls.worst_hz": lambda case, _: Within(0.0, 0.5 / case.T),
    **_hand("certificate.hands.walls.worst_hand"),
    "certificate.hands.walls.boxes": boxes,
    "certificate.any_hand.display": display_of,
    "certificate.any_hand.verdict": verdict_of("any_hand"),
    "certificate.any_hand.min_ratio": any_hand_ratio,
    "certificate.any_hand.worst_hz": lambda case, _: Within(0.0, 0.5 / case.T),
    "certificate.any_hand.boxes": boxes,
    "certificate.wall.verdict": verdict_of("wall_in_hands", "wall_in_any_hand"),
    "certificate.wall.box.{}[]": box_ends("box"),
    "certificate.wall.tool.{}[]": box_ends("tool"),
    "certificate.wall.min_ratio": wall_ratio,
    "certificate.wall.worst_hz": wall_place,
    **_hand("certificate.wall.worst_hand"),
    "certificate.wall.peak_sensitivity": wall_peak,
    "certificate.wall.peak_sensitivity_hz": wall_loud_at,
    "certificate.wall.phase_margin_deg": wall_phase,
    "certificate.wall.boxes": boxes,
    "certificate.whole_sample.samples": lambda case, _: round(delay_of(case) / case.T),
    "certificate.whole_sample.delay": lambda case, _: round(delay_of(case) / case.T) * case.T,
    "certificate.whole_sample.verdict": beside_verdict,
    **{
        f"certificate.least_hand.{name}": (lambda case, _, name=name: case.least_hand.get(name, 0.0))
        for name in NUMBERS
    },
    "inner_loop.stable": lambda case, _: Said(all(radius(Loop(d, case.gains), at_rest=True) < 1 for d in case.devices)),
    "inner_loop.spectral_radius": spectral,
    "inner_loop.peak_sensitivity": largest,
    "inner_loop.peak_sensitivity_hz": loud_at,
    "inner_loop.gain_margin_db": gain_margin,
    "inner_loop.phase_margin_deg": phase_margin,
    "inner_loop.delay_margin_s": delay_margin,
    "inner_loop.nyquist.N": poles_outside,
    "inner_loop.nyquist.P": lambda *_: 0,
    "inner_loop.nyquist.Z": poles_outside,
    "felt.limp": limp,
    "felt.mass_1hz": felt_free(lambda Z: Z.imag / (2 * pi), 2 * pi),
    "felt.damping_1hz": felt_free(lambda Z: Z.real, 1.0),
    "felt.bare_mass_1hz": felt_free(lambda Z: Z.imag / (2 * pi), 2 * pi, bare=True),
    "felt.behind": told_world,
    "felt.felt_wall_10hz": felt_wall,
    "felt.wall": lambda case, _: float(case.met[1][2]),
    "felt.count": count,
    "felt.first_speed": lambda case, _: first_speed(case),
    "felt.noise_speed": Elsewhere("design/test_tool.py"),
    "felt.noise_acceleration": Elsewhere("design/test_tool.py"),
    "felt.first_acceleration": lambda case, _: first_speed(case) / case.T,
    "rest.spring": lambda case, _: Said("k_c" if case.dual else "K_p"),
    "rest.step_N": lambda case, _: spring_step(case),
    "rest.damper_step_N": lambda case, _: Near(max(step_of_damper(case, device)[0] for device in case.devices), 1e-4),
    "rest.friction_N": lambda case, _: case.device["friction"],
    "rest.rests": rests,
    "rest.settles": settles,
    **_chatter("rest.encoder", "encoder"),
    **_chatter("rest.force_sensor", "force sensor"),
    "certificate.damping_ratio": lambda case, _: case.tables["stability"]["damping_ratio"],
    "ringing.damping_ratio": ringing(0),
    "ringing.frequency_hz": ringing(1),
    "ringing.time_constant_s": ringing(2),
    **_hand("ringing.hand", in_held),
    "ringing.world": WORDS,
    "buzz.kicks": lambda case, part: Holds(part["kicks"] >= 192 and 0 <= part["moving"] <= part["kicks"]),
    "buzz.moving": SHAKES,
    "buzz.amplitude_m": Elsewhere(SHAKES.test, "found.amplitude"),
    "buzz.force_N": Elsewhere(SHAKES.test, "found.force"),
    "buzz.frequency_hz": lambda case, _: Within(0.0, 0.5 / case.T),
    "buzz.step_m": lambda case, _: case.device["velocity"]["resolution"],
    "buzz.friction_N": lambda case, _: case.device["friction"],
    **_hand("buzz.hand", in_held),
    "buzz.world": WORDS,
    "contact.stiffness": lambda case, _: float(case.box[1][2]),
    "contact.safety_factor": lambda case, _: case.factor,
    "contact.parts[].part": lambda case, part: Holds(part["part"] in parts_of_latency(case)),
    "contact.parts[].key": latency_key,
    "contact.parts[].latency_s": latency_part("latency_s"),
    "contact.parts[].drag": latency_part("drag"),
    "contact.latency_s": lambda case, _: Near(latency(case), 1e-5),
    "contact.rest_drag": rest_drag,
    "contact.drag_alone": drag_alone,
    "contact.drag_alone_hz": drag_alone_at,
    **_hand("contact.drag_alone_hand"),
    "contact.stiffest_contact": stiffest,
    "contact.stiffest_contact_verdict": lambda case, part: Said(
        part["stiffest_contact"] and part["stiffest_contact_verdict"]
    ),
    "contact.own_spring": own_spring,
    "uncertainty.box.{}[]": uncertain_box,
    "uncertainty.unmodelled[][]": lambda case, part: Holds(part["unmodelled"] == case.radii),
    "uncertainty.objective": lambda case, _: Said(case.tables["uncertainty"].get("objective", "nominal")),
    "uncertainty.robust_error": term("error"),
    "uncertainty.worst_error": worst_error,
    **_device("uncertainty.worst_device"),
    **_device("uncertainty.min_ratio_device"),
    "warnings[]": WORDS,
    "versions.{}": NAME,
    "date": NAME,
    "sha256": DIGEST,
    "solver": "how a search went",
    "active[].demand": active,
    "active[].hz": active,
    "active[].multiplier": Elsewhere("report/test_report.py"),
    **_device("active[].device"),
    "at_bound[]": Elsewhere("report/test_report.py"),
    **{f"nearest.gains.{name}": nearest for name in ("velocity", "position")},
    **{f"nearest.coupling.{name}": nearest for name in ("damping", "mass", "drag", "stiffness")},
    **{f"optimality.{name}": Elsewhere("design/test_bound.py") for name in ("lower_bound", "gap", "error")},
    "optimality.verdict": lambda case, part: Holds((part["verdict"] == "proved") == (part["lower_bound"] is not None)),
    "optimality.both_sides": "whether a bound is of both sides of a whole sample, which the file says",
    "optimality.boxes": COUNTED,
    **{f"prices[].{name}": Elsewhere("design/test_prices.py") for name in ("key", "old", "new", "change", "free")},
    **{
        f"repairs[].{name}": Elsewhere("design/test_repairs.py")
        for name in ("key", "old", "new", "change", "needs", "assumes", "size", "error")
    },
    "repairs[].chooses": Elsewhere("design/test_ros.py"),
    **{f"{of}[].reference_impedance": Elsewhere("design/test_relaxations.py") for of in ("repairs", "together")},
    **{f"relaxations[].{name}": Elsewhere("design/test_relaxations.py") for name in ("needs", "error", "instead_of")},
    **_device("ringing.device"),
    **{
        f"together[].{name}": Elsewhere("design/test_pairs.py")
        for name in ("key", "old", "new", "change", "needs", "assumes", "chooses", "size", "error")
    },
    "tried[]": Elsewhere("design/test_repairs.py"),
}
