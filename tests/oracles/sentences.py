"""Random problems half a per cent beside the limit of their sentence: what a computer steps grows, or does not.

A limit is that of eigenvalues: of all places (a device, a hand, an environment of their boxes) one is sought at
which the stepped loop still grows while a number makes it more stable. Where an environment may be any passive
one, it is the spring or mass that takes away what is imaginary at some angle. Only the sum over aliases, of any passive
hand, is not one of eigenvalues.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from math import inf, pi, sqrt
from typing import Any

import numpy as np
from arithmetic import DIGITS
from draws import (
    NUMBERS,
    Floats,
    Rng,
    Tables,
    admittance,
    angles,
    built,
    built_servo,
    coupling_for,
    decades,
    decimal,
    delays_are_clear,
    ends_of,
    gains_for,
    hands_for,
    in_units,
    late,
    samples_of,
    scaled,
    short,
    spring_for,
    stable_in,
    stated,
    sums_are_clear,
    triple,
    widths_of,
    with_numbers,
)
from frequency import firmware
from loop import Loop, matrix, offered, radius, seen, sensitivity, slowest, turn

GROWS, SIMPLE = 1 + 1e-8, 1 + 1e-11
"""Greatest eigenvalue that may be a double or a simple pole on the circle, rounded."""
NEAR = 0.005
UNCERTAIN = (
    "servo.delay", "servo.bandwidth_hz", "mass", "damping", "delay", "actuator.bandwidth_hz",
    "force_sensor.bandwidth_hz", "velocity.filter_hz",
)  # fmt: skip


@dataclass(frozen=True)
class Sentence:
    """A problem at its limit.

    Attributes
    ----------
    claim : whose verdict counts; "" is all of them
    tables : of a number t relative to the limit: more of it is more stable
    grows : whether the stepped loop grows at t, in a hand, at the device's uncertain numbers, at a frequency, rad/s
    rule : of t the mass, stiffness and joint damping of an axis of ROS 2, and its filter's coefficient
    on_edge : whether what is outside has poles on the circle, which no proof can tell from both sides
    """

    claim: str
    tables: Callable[[float], Tables]
    grows: Callable[[float, Any, Any, float], bool]
    limit: float
    rule: Callable[[float], tuple[float, float, float, float]] | None = None
    on_edge: bool = False


# ------------------------------------------------------------------ what grows


def moved(loop: Loop, **changes: Any) -> Loop:
    """Return a loop of the same device and hand, which needs no matrix exponential again."""
    found = replace(loop, **changes)
    loop.spans  # noqa: B018
    found.__dict__.update({key: loop.__dict__[key] for key in ("plant", "spans", "late", "sensed")})
    return found


def turned(z: Any, phase: complex) -> tuple[float, float]:
    """Return the sign and a of the all-pass whose response at z is a number of modulus 1, up to that sign."""
    sign = 1.0 if phase.imag < 0 else -1.0
    w, u = sign * phase, 1 / z
    return sign, float(np.clip(((w - u) / (w * u - 1)).real, -1 + 1e-9, 1 - 1e-9))


def lowest(value: Callable[[Floats], Floats], theta: Floats, many: int = 3) -> list[float]:
    """Return the angles of the lowest minima, looked at more closely."""
    values = np.nan_to_num(value(theta), nan=inf)
    least = np.flatnonzero(np.r_[True, values[1:] <= values[:-1]] & np.r_[values[:-1] <= values[1:], True])
    found = []
    for k in least[np.argsort(values[least])][:many]:
        low, high = theta[max(k - 1, 0)], theta[min(k + 1, len(theta) - 1)]
        for _ in range(3):
            near = np.linspace(low, high, 9)
            n = int(np.argmin(np.nan_to_num(value(near), nan=inf)))
            low, high = near[max(n - 1, 0)], near[min(n + 1, 8)]
        found.append(float((low + high) / 2))
    return found


def grows_before_some(loop: Loop, r: float = 0.0, only: float | None = None) -> bool:
    """Return whether a loop grows before a spring or mass, behind an all-pass in a disc of radius r."""

    def left(theta: Any) -> Any:
        z = turn(loop, theta)
        Z_seen, Z_c = seen(loop, z), offered(loop, z)
        return (Z_c.real + Z_seen.real - r * abs(Z_seen)) / abs(Z_c.real)

    theta = np.union1d(np.geomspace(3e-5, 1e-3, 25), angles(dict(loop.device), 120))
    for at in lowest(left, theta[theta < pi * (1 - 1e-6)]) if only is None else [only]:
        z, u = turn(loop, at), 2 / loop.device["sample_time"] * np.tan(at / 2)
        Z_seen, delta = complex(seen(loop, z)), None
        if r and Z_seen:
            phase = -abs(Z_seen) / Z_seen
            sign, a = turned(z, phase)
            delta, Z_seen = (sign * r, a), Z_seen * (1 + r * phase)
        rest = (complex(offered(loop, z)) + Z_seen).imag
        reactance = 1 / rest if loop.kind == "impedance" else -rest
        world = (reactance / u, 0.0, 0.0) if reactance > 0 else (0.0, 0.0, -reactance * u)
        if only is not None and radius(replace(loop, world=world, delta=delta, num=DIGITS)) > 1:
            return True
        poles = np.linalg.eigvals(matrix(moved(loop, world=world, delta=delta)))
        own = np.abs(poles - np.exp(1j * at)) < 0.3 * at  # at low frequencies it grows slowly, and is a simple pole
        if (np.abs(poles) > np.where(own, SIMPLE, GROWS)).any():
            return True
    return False


def grows_in_disc(loop: Loop, r: float, only: float | None = None) -> bool:
    """Return whether the velocity loop grows behind an all-pass in a disc of radius r."""

    def size(theta: Any) -> Any:
        return -abs(1 - sensitivity(loop, turn(loop, theta)))

    theta = angles(dict(loop.device), 200)
    for at in lowest(size, theta[theta < pi * (1 - 1e-6)]) if only is None else [only]:
        z = turn(loop, at)
        asked = -1 / (1 - complex(sensitivity(loop, z)))
        sign, a = turned(z, asked / abs(asked))
        if radius(moved(loop, delta=(sign * r, a)), at_rest=True) > GROWS:
            return True
    return False


def limit_of(grows: Callable[[float, Floats], bool], size: int, rng: Rng, trials: int) -> float | None:
    """Return the greatest t at which a place grows; None where there is none, or it hardly grows below."""
    corners = [np.array(each, dtype=float) for each in product((0.0, 1.0), repeat=size)]
    some = [corners[k] for k in rng.permutation(len(corners))[:32]] + [rng.random(size) for _ in range(8 * (size > 0))]

    def own(place: Floats, low: float, high: float) -> float:
        for _ in range(16):
            middle = sqrt(low * high)
            low, high = (middle, high) if grows(middle, place) else (low, middle)
        return low

    t = 2.0**9
    while t > 2.0**-11 and not (found := [place for place in some if grows(t, place)]):
        t /= 4
    if t == 2.0**9 or not found:
        return None
    best, high = found[0], 4 * t
    limit = own(best, t, high)
    for trial in range(trials if size else 0):
        if trial < len(some):
            place = some[trial]
        elif trial % 4 == 0:
            place = rng.random(size)
        else:
            place = best + rng.normal(size=size) * 10 ** rng.uniform(-2.5, -0.3) * (rng.random(size) < 0.6)
        place = np.clip(np.where(rng.random(size) < 0.05, np.round(np.clip(place, 0, 1)), place), 0, 1)
        if grows(limit * 1.0003, place):
            best, limit = place, own(place, limit * 1.0003, high)
    return limit if grows(limit * (1 - NEAR), best) and not grows(limit * (1 + NEAR), best) else None


# ------------------------------------------------------------------ devices and their boxes


def _between(ends: tuple[Floats, Floats], share: Floats) -> Floats:
    """Return what is between two ends; small numbers are drawn more often."""
    return ends[0] + (ends[1] - ends[0]) * share**3


@dataclass(frozen=True)
class Drawn:
    """A loop whose number is not at its limit yet. A world is the ends of a box; None is any passive environment."""

    device: Tables
    gains: tuple[float, float]
    coupling: tuple[float, ...]
    box: tuple[Floats, Floats]
    number: str = "coupling"
    world: tuple[Floats, Floats] | None = None
    widths: Any = None
    rigid: bool = False
    unit: float = 1.0
    r: float = 0.0

    @property
    def keys(self) -> list[str]:
        return list(self.widths or {})

    def coupled(self, t: float) -> tuple[float, ...]:
        dual = self.device.get("display") == "impedance"
        if self.number == "coupling":
            return scaled(self.coupling, 1 / t if dual else t)
        return (*self.coupling[:2], self.coupling[2] * t) if self.number == "drag" else self.coupling

    def hands(self, t: float) -> tuple[Floats, Floats]:
        low, high = self.box
        return (low, high * np.array([1, 1, 1 / t])) if self.number == "stiffness" else self.box

    def worlds(self, t: float) -> tuple[Floats, Floats]:
        assert self.world is not None
        shift = np.array([0, t - 1, 0]) * self.world[0][1] if self.number == "damping" else 0
        return self.world[0] + shift, self.world[1] + shift

    def r_at(self, t: float) -> float:
        return self.r / t if self.number == "r" else self.r

    def loops(self, t: float, hand: Any, numbers: Any, world: Any = (0.0, 0.0, 0.0)) -> list[Loop]:
        """Return the loop, of a delay of whole samples on both sides of them."""
        device = with_numbers(self.device, self.keys, numbers) if self.keys else self.device
        delays = {"servo.delay" if "servo" in device else "delay": device.get("servo", device).get("delay", 0.0)}
        delays["force_sensor.delay"] = device.get("force_sensor", {}).get("delay", 0.0)
        sides, late = [device], next((key for key, delay in delays.items() if delay), None)
        if late is not None and samples_of(device) % 1 == 0:
            sides.append(with_numbers(device, [late], [delays[late] - 1e-7 * device["sample_time"]]))
        return [Loop(side, self.gains, self.coupled(t), triple(hand), triple(world)) for side in sides]

    def grows(self, t: float, place: Floats) -> bool:
        n, (low, high) = len(self.keys), ends_of(self.device, self.widths or {})
        numbers, hand = low + (high - low) * place[:n], _between(self.hands(t), place[n : n + 3])
        if self.world is None:
            return any(self.judged(loop, t) for loop in self.loops(t, hand, numbers))
        world = _between(self.worlds(t), place[n + 3 :])
        return any(radius(loop) > GROWS for loop in self.loops(t, hand, numbers, world))

    def judged(self, loop: Loop, t: float, only: float | None = None) -> bool:
        if self.rigid and loop.device.get("velocity", {}).get("from") == "measured":
            return radius(loop) > GROWS
        if self.rigid:  # before a damper that nothing moves
            return radius(moved(loop, world=(0.0, 1e9 * (loop.coupling[0] + loop.coupling[1] * loop.T), 0.0))) > GROWS
        return grows_before_some(loop, self.r_at(t), only)

    def at(self, t: float, hand: Any, numbers: Any, omega: float) -> bool:
        """Return whether it grows in one hand, at a frequency."""
        theta = float(np.clip(omega * self.device["sample_time"], 1e-5, pi * (1 - 1e-6)))
        middle = sum(ends_of(self.device, self.widths or {})) / 2
        loops = self.loops(t, np.array(hand) / self.unit, middle if numbers is None else numbers)
        return any(self._at(loop, t, theta) for loop in loops)

    def _at(self, loop: Loop, t: float, theta: float) -> bool:
        if self.world is None:
            return self.judged(loop, t, theta) or self.judged(loop, t)
        low, high = self.worlds(t)
        u, z = 2 / loop.device["sample_time"] * np.tan(theta / 2), turn(loop, theta)
        Y = complex(offered(loop, z) + seen(loop, z))
        tries = [_between((low, high), np.array(each)) for each in product((0.0, 0.3, 0.6, 1.0), repeat=3)]
        for m in np.linspace(low[0], high[0], 9):
            tries.append(
                np.array([m, max(low[1], -Y.real * (1 - 1e-9)), np.clip((m * u + Y.imag) * u, low[2], high[2])])
            )
            tries.append(np.array([m, low[1], np.clip((m * u + Y.imag) * u, low[2], high[2])]))
        for k in np.linspace(low[2], high[2], 9):
            tries.append(np.array([np.clip((k / u - Y.imag) / u, low[0], high[0]), low[1], k]))
        return any(radius(moved(loop, world=triple(world))) > 1 + 1e-10 for world in tries)

    def tables(self, t: float) -> Tables:
        stability: Tables = {"criterion": "hands", "safety_factor": 1.0}
        gains = None if "servo" in self.device or self.rigid else self.gains
        if "servo" not in self.device:
            stability["max_sensitivity"] = 1e6
        more: Tables = {}
        if self.rigid:
            more["environment"] = {"stiffness": inf}
        elif self.world is not None:
            ends = zip(NUMBERS, *self.worlds(t), strict=True)
            met = {name: {"min": float(low), "max": float(high)} for name, low, high in ends}
            met["damping"].pop("max")
            more["environment"] = met
        if self.widths or self.r:
            more["uncertainty"] = dict(self.widths or {})
        if self.r:
            hz = decimal(0.1 / self.device["sample_time"])
            more["uncertainty"]["unmodelled"] = [[hz / 100, self.r_at(t)], [hz, self.r_at(t)]]
        posed = stated(self.device, gains, self.coupled(t), stability, self.hands(t), more)
        if self.unit == 1:
            return posed
        found = in_units(posed, self.unit, 1.0)
        return found | {"device": found["device"] | {"units": "rotary"}}

    def at_limit(self, rng: Rng) -> Sentence | None:
        size = len(self.keys) + (3 if self.world is None else 6)
        limit = limit_of(self.grows, size, rng, 120 if self.world is None else 600)
        if limit is None:
            return None
        return Sentence("", lambda s: self.tables(limit * s), lambda s, *where: self.at(limit * s, *where), limit)


RATIO = 0.35
"""The damping ratio that is demanded at t = 1; at another it is that over t."""


@dataclass(frozen=True)
class Damped(Drawn):
    """A loop of which a damping ratio is demanded."""

    def grows(self, t: float, place: Floats) -> bool:
        n, (low, high) = len(self.keys), ends_of(self.device, self.widths or {})
        numbers, hand = low + (high - low) * place[:n], _between(self.hands(t), place[n : n + 3])
        return self.at(t, hand, numbers, place[n + 3 :])

    def at(self, t: float, hand: Any, numbers: Any, where: Any) -> bool:
        """Return whether a loop in one hand rings with less, before an environment or any corner of them."""
        if self.world is None:
            worlds = [np.array([0.0, 1e9 * (self.coupling[0] + self.coupling[1] * self.device["sample_time"]), 0.0])]
        else:  # at the least damping of the box
            shares = product((0.0, 1.0), repeat=2) if isinstance(where, float) else [(where[0], where[2])]
            worlds = [_between(self.world, np.array([mass, 0.0, spring])) for mass, spring in shares]
        if numbers is None:
            numbers = sum(ends_of(self.device, self.widths or {})) / 2
        loops = [loop for world in worlds for loop in self.loops(1.0, hand, numbers, world)]
        return any(slowest(loop, at_rest=False)[0] < RATIO / t for loop in loops)

    def tables(self, t: float) -> Tables:
        found = super().tables(1.0)
        return found | {"stability": found["stability"] | {"damping_ratio": RATIO / t}}

    def at_limit(self, rng: Rng) -> Sentence | None:
        found = super().at_limit(rng)
        if found is None or not 0.01 < RATIO / found.limit < 0.6:
            return None
        return replace(found, claim="damping_ratio")


def _world(rng: Rng, scale: float, T: float, which: str) -> tuple[Floats, Floats]:
    """Return a box of environments; its least damping is a scale of 1 where that is sought."""
    mass, stiff = decimal(scale * T * 10 ** rng.uniform(-1, 1.5)), decimal(scale / T * 10 ** rng.uniform(-3, -0.5))
    low = np.array([mass * rng.choice([0.0, 0.1]), 0.0, stiff * rng.choice([0.0, 0.3])])
    high = np.array([mass, 3 * scale, stiff])
    if which == "exact":
        low = high * np.array([1, 0.01, 1])
    elif which == "nothing":
        low, high = 0 * low, high * np.array([0, 1, 0])
    elif which == "spring":
        low[0], high[0] = 0.0, 0.0
    return np.array([*map(decimal, low)]), np.array([*map(decimal, high)])


def own_loop(
    rng: Rng, *parts: str, integrator: float = 1.0, limp: bool = False, exact: str = "", number: str = "coupling",
    world: str = "", unit: float = 1.0, uncertain: int = 0, mixed: bool = False,
) -> Sentence:  # fmt: skip
    """An admittance display in its hands."""
    while True:
        device = admittance(rng) if mixed else built(rng, *parts)
        if not sums_are_clear(device):
            continue
        gains = gains_for(rng, device, integrator)
        box = hands_for(rng, device["mass"], device["sample_time"])
        if limp:
            box[0][2] = 0.0
        if exact:
            box = (box[1], box[1])
            if exact == "without stiffness":
                box[1][2] = 0.0
        if number == "stiffness":
            box[0][2] = 0.0
        coupling = coupling_for(rng, device, gains[0], 1.0 if number == "drag" or not box[0][1] else 0.5)
        met = _world(rng, gains[0], device["sample_time"], world) if world else None
        widths = widths_of(rng, device, UNCERTAIN, uncertain)
        if not stable_in(device, gains, box) or not delays_are_clear(device, widths):
            continue
        if found := Drawn(device, gains, coupling, box, number, met, widths, unit=unit).at_limit(rng):
            return found


def of_servo(
    rng: Rng,
    *parts: str,
    order: int = 1,
    number: str = "coupling",
    world: str = "",
    uncertain: int = 0,
    r: bool = False,
) -> Sentence:
    """A vendor's servo in its hands."""
    while True:
        device = built_servo(rng, *parts, order=order)
        if not sums_are_clear(device):
            continue
        high = 10 ** rng.uniform([-1, 0, 1], [0.7, 1.5, 3.3])
        box = np.array([*map(decimal, high * rng.choice([0, 0, 0.3], 3))]), np.array([*map(decimal, high)])
        if r:  # below its first point a servo's radius is proportional to the frequency: no spring may matter there
            box[0][2], box[1][2] = 0.0, 1e-6
        b_c = inf if rng.random() < 0.4 or world == "nothing" else decades(rng, 1, 3)
        coupling = (b_c, decades(rng, -0.5, 1.3), decades(rng, 0, 2))
        met = _world(rng, coupling[2], device["sample_time"], world) if world else None
        widths = widths_of(rng, device, UNCERTAIN, uncertain)
        if not delays_are_clear(device, widths):
            continue
        drawn = Drawn(device, (0.0, 0.0), coupling, box, number, met, widths, r=decades(rng, -1.5, -0.5) * r)
        if found := drawn.at_limit(rng):
            return found


def damped_servo(rng: Rng, *parts: str, order: int = 1, world: str, uncertain: int = 0) -> Sentence:
    """A vendor's servo in its hands, of which a damping ratio is demanded."""
    while True:
        device = built_servo(rng, *parts, order=order)
        if not sums_are_clear(device):
            continue
        high = 10 ** rng.uniform([-1, 0, 1], [0.7, 1.5, 3.3])
        box = np.array([*map(decimal, high * rng.choice([0, 0, 0.3], 3))]), np.array([*map(decimal, high)])
        late_by = device["servo"]["delay"] + 0.2 / device["servo"]["bandwidth_hz"]
        scale = high[2] * late_by * decades(rng, 0.2, 1.0) + high[1]
        b_c = inf if world == "nothing" or rng.random() < 0.4 else scale * decades(rng, 0.3, 1.0)
        coupling = (b_c, decimal(scale * device["sample_time"] * decades(rng, 0.3, 1.5)), decimal(scale))
        low, most = _world(rng, coupling[2], device["sample_time"], world)
        if most[0] > 0:
            low[0] = decimal(0.2 * most[0])
        widths = widths_of(rng, device, UNCERTAIN, uncertain)
        if not delays_are_clear(device, widths):
            continue
        if found := Damped(device, (0.0, 0.0), coupling, box, world=(low, most), widths=widths).at_limit(rng):
            return found


def damped_wall(rng: Rng, *parts: str) -> Sentence:
    """A wall of an impedance display in its hands, of which a damping ratio is demanded."""
    while True:
        device = dual(rng, *parts)
        device["delay"] = decimal(device["sample_time"] * late(rng, 2))
        b_c, k_c = spring_for(rng, device)
        coupling = (b_c, decimal(k_c * decades(rng, -2.0, 0.0)))
        box = hands_for(rng, device["mass"], device["sample_time"])
        if found := Damped(device, (0.0, 0.0), coupling, box, rigid=True).at_limit(rng):
            return found


def dual(rng: Rng, *parts: str) -> Tables:
    """Return an impedance display with these parts alone."""
    device = built(rng, *parts) | {"display": "impedance"}
    device.pop("force_sensor", None)
    return device | {"damping": decimal(device["mass"] / device["sample_time"] * 10 ** rng.uniform(-3, -1.5))}


def display(rng: Rng, *parts: str, rigid: bool = False) -> Sentence:
    """An impedance display in its hands."""
    while True:
        device = dual(rng, *parts)
        device["delay"] = decimal(device["sample_time"] * late(rng, 2))
        gains = (0.0 if rigid else decimal(device["damping"] * rng.choice([0.0, 0.5])), 0.0)
        coupling = spring_for(rng, device)
        box = hands_for(rng, device["mass"], device["sample_time"])
        if stable_in(device, gains, box) and (found := Drawn(device, gains, coupling, box, rigid=rigid).at_limit(rng)):
            return found


# ------------------------------------------------------------------ any passive hand of an impedance display


def disc_of_hands(device: Tables, theta: Floats, aliases: int = 800) -> tuple[Floats, Floats]:
    """Return centre and radius of the sampled responses y per force in all passive hands.

    Each alias of the motor's speed per force is a disc around 1/(2 b) through 0, and a hand may choose each.
    """
    b, T = device["damping"], device["sample_time"]
    s = 1j * (theta[:, None] + 2 * pi * np.arange(-aliases, aliases + 1)) / T
    lag = np.exp(-s * device.get("delay", 0.0))
    if "actuator" in device:
        w = 2 * pi * device["actuator"]["bandwidth_hz"]
        first = device["actuator"].get("order", 1) == 1
        lag = lag * (1 / (1 + s / w) if first else w**2 / (s**2 + sqrt(2) * w * s + w**2))
    each = ((1 - np.exp(-1j * theta)[:, None]) / s / T) ** 2 * lag / (2 * b)
    return each.sum(axis=1), abs(each).sum(axis=1)


def any_hand(rng: Rng, *parts: str, rigid: bool = False) -> Sentence:
    """An impedance display in any passive hand: against a wall, or before any passive environment."""
    while True:
        device = dual(rng, *parts)
        whole = float(rng.integers(0, 3)) if "part of a sample" not in parts else float(rng.uniform(0.1, 1.9))
        device["delay"] = decimal(device["sample_time"] * whole)
        K_v = 0.0 if rigid else decimal(device["damping"] * rng.choice([0.0, 0.3]))
        coupling = spring_for(rng, device)
        theta = np.union1d(np.geomspace(1e-3, 3.141, 150), np.linspace(0.02, 3.141, 250))
        centre, around = disc_of_hands(device, theta)
        free = Loop(device, (K_v, 0.0), coupling)
        z, edge = turn(free, theta), np.exp(2j * np.pi * np.linspace(0, 1, 721))
        smooth = firmware(device.get("velocity", {}), device["sample_time"], z)
        disc = centre[:, None] + around[:, None] * edge
        if (abs(1 + K_v * smooth * centre) <= K_v * abs(smooth) * around).any():
            continue
        Y_c = offered(free, z)
        worst = (disc / (1 + K_v * smooth[:, None] * disc)).real.min(axis=1)

        def grows(
            t: float, _: Any, Y: Any = Y_c, w: Any = worst, c: Any = centre, r: Any = around, F: Any = K_v * smooth
        ) -> bool:
            law = F + 1 / (Y * t)
            return bool((abs(1 + law * c) <= abs(law) * r).any() if rigid else (Y.real * t + w < 0).any())

        limit = limit_of(grows, 0, rng, 0)
        if limit is None:
            continue
        break

    def tables(s: float) -> Tables:
        stability = {"criterion": "passive", "safety_factor": 1.0, "max_sensitivity": 1e6}
        more = {"environment": {"stiffness": inf}} if rigid else {}
        return stated(device, None if rigid else (K_v, 0.0), scaled(coupling, 1 / (limit * s)), stability, more=more)

    def at(s: float, *_: Any) -> bool:
        """Some hands: a spring, a mass, with up to two resonators."""
        drawn = Drawn(device, (K_v, 0.0), coupling, (np.zeros(3), np.zeros(3)), rigid=rigid)
        m, T = device["mass"], device["sample_time"]
        for _trial in range(150):
            loop = replace(
                drawn.loops(limit * s, (m * 10 ** rng.uniform(-2, 2), 0.0, m / T**2 * 10 ** rng.uniform(-4, 1)), ())[0],
                resonators=tuple(
                    (x := m * 10 ** rng.uniform(-1, 2), 0.0, x * (2 * pi / T * rng.uniform(0.3, 1.5)) ** 2)
                    for _ in range(int(rng.integers(0, 3)))
                ),
            )
            if drawn.judged(loop, limit * s):
                return True
        return False

    return Sentence("", tables, at, limit)


# ------------------------------------------------------------------ the velocity loop alone


def disc(rng: Rng) -> Sentence:
    """The velocity loop behind any all-pass in a disc, at the limit of its radius."""
    while True:
        device = admittance(rng)
        loop = Loop(device, gains_for(rng, device))
        limit = limit_of(lambda t, _, loop=loop: grows_in_disc(loop, 1 / t), 0, rng, 0)
        if radius(loop, at_rest=True) < 1 - 1e-6 and limit is not None:
            break

    def tables(s: float) -> Tables:
        hz = decimal(0.1 / device["sample_time"])
        radii = {"unmodelled": [[hz / 10, 1 / (limit * s)], [hz, 1 / (limit * s)]]}
        stability = {"criterion": "passive", "max_sensitivity": 1e9}
        return stated(device, loop.gains, (1.0, 1.0, 1.0), stability, more={"uncertainty": radii})

    def at(s: float, _hand: Any, _numbers: Any, omega: float) -> bool:
        r = 1 / (limit * s)
        return grows_in_disc(loop, r, omega * device["sample_time"]) or grows_in_disc(loop, r)

    return Sentence("unmodelled", tables, at, limit)


def without_gains(rng: Rng) -> Sentence:
    """A mass on the hand's spring, without a loop: without damping its poles are on the circle."""
    T, mass, stiffness = short(decades(rng, -3.7, -2.7)), decades(rng, -1.3, 1), decades(rng, 1, 3)
    damping, box = decades(rng, -1, 0), np.array([0.0, 0.0, stiffness])

    def tables(s: float) -> Tables:
        device = {"mass": mass, "sample_time": T, "damping": damping if s > 1 else 0.0}
        stability = {"criterion": "hands", "safety_factor": 1.0, "max_sensitivity": 1e6}
        return stated(device, (0.0, 0.0), (1.0, 1.0, 1.0), stability, (box, box))

    def at(s: float, *_: Any) -> bool:
        return radius(Loop(tables(s)["device"], hand=triple(box)), at_rest=True) > 1 - 1e-10

    return Sentence("", tables, at, 1.0, on_edge=True)


# ------------------------------------------------------------------ ROS 2


def ruled(device: Tables, gains: Any, rule: tuple[float, float, float], t: float, hand: Any) -> float:
    """Return the spectral radius with mass, a share of the joints' damping and stiffness of a controller."""
    mass, rate, stiffness = rule
    return radius(Loop(device, gains, hand=triple(hand), rule=(mass, mass * rate * t, stiffness)))


def ros(rng: Rng, *parts: str) -> Sentence:
    """An admittance_controller around an own loop or a servo, at the limit of its joint damping."""
    while True:
        device = built_servo(rng, "low-pass") if "servo" in parts else built(rng, "part of a sample", *parts)
        T = device["sample_time"]
        coefficient = float(rng.choice([1.0, 0.5, 0.3, 0.1]))
        if "servo" in parts:
            gains, box = (
                (0.0, 0.0),
                (np.zeros(3), np.array([*map(decimal, 10 ** rng.uniform([-1, 0, 1], [0.7, 1.5, 3]))])),
            )
            mass = decades(rng, 0, 1.3)
        else:
            gains = gains_for(rng, device, 1.0)
            box = (np.zeros(3), hands_for(rng, device["mass"], T)[1])
            mass = decimal(device["mass"] * 10 ** rng.uniform(-1, 0.3))
        stiffness = decimal(box[1][2] * 10 ** rng.uniform(-3, -1)) if rng.random() < 0.5 else 0.0
        rate = 0.05 / T
        if "servo" not in parts and not stable_in(device, gains, box):
            continue
        known = device | {"force_sensor": device.get("force_sensor", {}) | {"filter_coefficient": coefficient}}
        spectral = partial(ruled, known, gains, (mass, rate, stiffness))

        def grows(t: float, place: Any, of: Any = spectral, b: Any = box, most: float = 0.9 / rate / T) -> bool:
            return t < most and of(t, _between(b, place)) > GROWS

        limit = limit_of(grows, 3, rng, 300)
        if limit is None or not 1e-4 < limit * rate * T < 0.7:
            continue
        break

    def tables(_: float) -> Tables:
        servo = "servo" in parts
        stability = {"safety_factor": 1.0} | ({} if servo else {"max_sensitivity": 1e6})
        found = stated(device, None if servo else gains, (1.0, 1.0, 1.0), stability, box)
        del found["coupling"]
        return found

    def at(s: float, hand: Any, *_: Any) -> bool:
        return spectral(limit * s, hand) > 1 + 1e-10

    return Sentence("", tables, at, limit, lambda s: (mass, stiffness, float(f"{rate * limit * s:.9g}"), coefficient))


SENTENCES: dict[str, Callable[[Rng], Sentence]] = {
    "ideal": own_loop,
    "delay": lambda rng: own_loop(rng, "delay"),
    "part of a sample": lambda rng: own_loop(rng, "part of a sample"),
    "velocity filter": lambda rng: own_loop(rng, "filter"),
    "differenced velocity": lambda rng: own_loop(rng, "difference"),
    "actuator": lambda rng: own_loop(rng, "actuator"),
    "sensor low-pass": lambda rng: own_loop(rng, "low-pass"),
    "sensor delay": lambda rng: own_loop(rng, "late sensor"),
    "structure": lambda rng: own_loop(rng, "structure"),
    "filter coefficient": lambda rng: own_loop(rng, "coefficient"),
    "mixed": lambda rng: own_loop(rng, mixed=True),
    "limp hands": lambda rng: own_loop(rng, "part of a sample", integrator=0.0, limp=True),
    "no K_p": lambda rng: own_loop(rng, "delay", integrator=0.0),
    "rotary, 1e-15 kg m2": lambda rng: own_loop(rng, "delay", unit=1e-15),
    "one hand": lambda rng: own_loop(rng, "delay", exact="one"),
    "one hand without stiffness": lambda rng: own_loop(rng, "delay", exact="without stiffness"),
    "one hand of 1e-12": lambda rng: own_loop(rng, "delay", exact="one", unit=1e-12),
    "one hand of 1e-15": lambda rng: own_loop(rng, "part of a sample", exact="one", unit=1e-15),
    "hand's stiffness, 1e-15": lambda rng: own_loop(rng, number="stiffness", unit=1e-15),
    "one tiny hand without stiffness": lambda rng: own_loop(
        rng, integrator=0.0, limp=True, exact="without stiffness", unit=1e-15
    ),
    "tiny, limp, no K_p": lambda rng: own_loop(rng, "delay", integrator=0.0, limp=True, unit=1e-13),
    "no gains": without_gains,
    "drag": lambda rng: own_loop(rng, "part of a sample", "difference", number="drag"),
    "hand's stiffness": lambda rng: own_loop(rng, "delay", "filter", number="stiffness"),
    "uncertain": lambda rng: own_loop(rng, "part of a sample", uncertain=2),
    "uncertain parts": lambda rng: own_loop(rng, "actuator", "low-pass", uncertain=1),
    "box of environments": lambda rng: own_loop(rng, "delay", number="drag", world="box"),
    "one environment": lambda rng: own_loop(rng, "part of a sample", number="drag", world="exact"),
    "a spring alone": lambda rng: own_loop(rng, "delay", number="drag", world="spring"),
    "nothing behind": lambda rng: own_loop(rng, "delay", number="drag", world="nothing"),
    "servo": of_servo,
    "servo of order 2": lambda rng: of_servo(rng, order=2),
    "servo, position": lambda rng: of_servo(rng, "position"),
    "servo with spring": lambda rng: of_servo(rng, "spring", number="drag"),
    "servo, filter coefficient": lambda rng: of_servo(rng, "coefficient", order=2),
    "servo, sensor delay": lambda rng: of_servo(rng, "late sensor", "low-pass"),
    "servo, whole samples": lambda rng: of_servo(rng, "whole samples"),
    "servo, hand's stiffness": lambda rng: of_servo(rng, "low-pass", number="stiffness"),
    "servo, nothing behind": lambda rng: of_servo(rng, order=2, world="nothing", number="drag"),
    "servo, box of environments": lambda rng: of_servo(rng, world="box", number="drag"),
    "servo, one environment": lambda rng: of_servo(rng, "position", world="exact", number="drag"),
    "servo, uncertain": lambda rng: of_servo(rng, uncertain=2),
    "servo, disc": lambda rng: of_servo(rng, r=True),
    "display": display,
    "display, velocity filter": lambda rng: display(rng, "filter"),
    "display, structure": lambda rng: display(rng, "structure"),
    "wall in hands": lambda rng: display(rng, "filter", rigid=True),
    "wall in any hand": lambda rng: any_hand(rng, rigid=True),
    "wall in any hand, parts": lambda rng: any_hand(rng, "filter", "actuator", "part of a sample", rigid=True),
    "any hand": lambda rng: any_hand(rng, "filter"),
    "disc": disc,
    "ROS 2": ros,
    "ROS 2, differenced velocity": lambda rng: ros(rng, "difference"),
    "ROS 2 on a servo": lambda rng: ros(rng, "servo"),
    "velocity sections": lambda rng: own_loop(rng, "delay", "sections"),
    "force sections": lambda rng: own_loop(rng, "part of a sample", "felt sections"),
    "servo, sections": lambda rng: of_servo(rng, "felt sections"),
    "display, sections": lambda rng: display(rng, "sections"),
    "wall in hands, sections": lambda rng: display(rng, "sections", rigid=True),
    "wall in any hand, sections": lambda rng: any_hand(rng, "sections", rigid=True),
    "any hand, sections": lambda rng: any_hand(rng, "sections", "part of a sample"),
    "measured wall": lambda rng: display(rng, "measured", rigid=True),
    "measured wall, filtered": lambda rng: display(rng, "measured", "filter", "part of a sample", rigid=True),
    "measured wall, sections": lambda rng: display(rng, "measured", "sections", "actuator", rigid=True),
    "measured wall, structure": lambda rng: display(rng, "measured", "filter", "structure", rigid=True),
    "springs": lambda rng: own_loop(rng, "springs"),
    "springs, low-passes": lambda rng: own_loop(rng, "springs", "difference", "filter", "low-pass"),
    "springs, box of environments": lambda rng: own_loop(rng, "springs", "actuator", number="drag", world="box"),
    "springs, uncertain": lambda rng: own_loop(rng, "two springs", "part of a sample", uncertain=1),
    "handle sensed": lambda rng: own_loop(rng, "structure", "at handle", integrator=0.0),
    "handle sensed, springs": lambda rng: own_loop(rng, "springs", "at handle", "difference", "actuator"),
    "display, handle sensed": lambda rng: display(rng, "structure", "at handle"),
    "wall in hands, handle sensed": lambda rng: display(rng, "springs", "measured", "at handle", rigid=True),
    "display, springs": lambda rng: display(rng, "springs"),
    "wall in hands, springs": lambda rng: display(rng, "springs", "filter", rigid=True),
    "damped servo": lambda rng: damped_servo(rng, order=2, world="nothing"),
    "damped servo, position": lambda rng: damped_servo(rng, "position", "low-pass", world="nothing"),
    "damped servo, spring": lambda rng: damped_servo(rng, "spring", order=2, world="nothing"),
    "damped servo, a spring behind": lambda rng: damped_servo(rng, order=2, world="spring"),
    "damped servo, box of environments": lambda rng: damped_servo(rng, "late sensor", world="box"),
    "damped servo, uncertain": lambda rng: damped_servo(rng, world="nothing", uncertain=1),
    "damped wall": damped_wall,
    "damped wall, parts": lambda rng: damped_wall(rng, "filter", "actuator", "part of a sample"),
    "damped wall, structure": lambda rng: damped_wall(rng, "structure"),
}
