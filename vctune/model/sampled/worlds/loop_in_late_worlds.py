"""Evaluate the sampled loop in a hand with every environment of a box that runs late or steps by Euler's rules."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import inf
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.sampled.worlds.loop_in_worlds import Offered, Seen
from vctune.model.worlds import World, WorldRule, Worlds

# The direction of a normal: along 1, along j, or perpendicular to the factor of the mass or of the spring
Normal = Literal["real", "imaginary", "to the mass", "to the spring"]


class Side(NamedTuple):
    """A side of the polygon, and the condition that -Y' is beyond it."""

    normal: Normal  # direction of the side's normal
    sign: int


# The sides of the polygon, by the names of their margins
SIDES: Mapping[str, Side] = MappingProxyType(
    {
        "resistive": Side("real", 1),
        "driven": Side("real", -1),
        "above": Side("imaginary", -1),
        "below": Side("imaginary", 1),
        "resistive_past_mass": Side("to the mass", 1),
        "driven_past_mass": Side("to the mass", -1),
        "resistive_past_spring": Side("to the spring", 1),
        "driven_past_spring": Side("to the spring", -1),
    }
)
LEADING: Mapping[WorldRule, int] = MappingProxyType({"trapezoid": 0, "explicit": 1, "implicit": -1})  # q of each rule


class HalfPlane(NamedTuple):
    """A margin as a function of Y', regular at 0 and pi: the factors of the parts of Y', and the environment's part."""

    resistance: Number  # factor of |F|^2 Re Y
    reactance: Number  # factor of |F|^2 c Im Z_c
    swing: Number  # factor of the swing of Z_seen
    room: Number  # factor of |F|^2, from the nearest environment

    def terms(self, offered: Offered, seen: Seen, share: Number = 1.0) -> tuple[Number, ...]:
        """Return the terms whose sum is the margin with a share of the coupling."""
        size = seen.size
        return (
            self.resistance * (share * offered.resistance * size),
            -(self.resistance * seen.lost),
            self.reactance * (share * offered.reactance * size),
            self.swing * seen.swing,
            self.room * size,
        )


def sides_of(worlds: Worlds) -> tuple[str, ...]:
    """Return the names of the sides that the polygons of a box have, without sides at infinity."""
    low, high, moved = worlds.low, worlds.high, LEADING[worlds.rule] != 0
    wanted: dict[Normal, Any] = {
        "real": True,
        "imaginary": True,
        "to the mass": moved and high.mass > low.mass,
        "to the spring": moved and high.stiffness > low.stiffness,
    }
    return tuple(
        name
        for name, side in SIDES.items()
        if wanted[side.normal] and all(most < inf for most in _ends(side, worlds).values())
    )


def sides_at_nyquist(worlds: Worlds, *, rigid: bool) -> tuple[str, ...]:
    """Return the names of the sides that decide at theta = pi. The margins of all other sides are 0 there."""
    if worlds.rule != "trapezoid":
        return sides_of(worlds) if rigid else _only(worlds, "real")
    imaginary = _only(worlds, "imaginary")
    return imaginary if rigid else _only(worlds, "real") + imaginary[1:] * bool(worlds.low.mass > 0)


def _only(worlds: Worlds, normal: Normal) -> tuple[str, ...]:
    return tuple(name for name in sides_of(worlds) if SIDES[name].normal == normal)


def half_planes(
    worlds: Worlds, names: Sequence[str], sample_time: Number, theta: Number, ops: Arithmetic, *, rigid: bool
) -> dict[str, HalfPlane]:
    """Return the sides of the polygon at an angle."""
    return {name: _half_plane(SIDES[name], worlds, sample_time, theta, ops, rigid=rigid) for name in names}


def _half_plane(side: Side, worlds: Worlds, T: Number, theta: Number, ops: Arithmetic, *, rigid: bool) -> HalfPlane:
    sin, cos, q, n = ops.sin(theta / 2), ops.cos(theta / 2), LEADING[worlds.rule], worlds.late
    sizes = _sizes(side.normal, worlds.rule, sin, cos, T)
    ends, signs = _ends(side, worlds), _signs(side.normal, worlds.rule)
    room = sum((side.sign * signs[name] * (sizes[name] * ends[name]) for name in ends), start=0 * theta)
    if side.normal == "imaginary":
        turned = sin * (cos * ops.sin(n * theta)) if n else 0 * theta
        along = ops.cos(n * theta)
        parts = turned, along * sin, -(along * cos)
    elif side.normal == "real":  # sin(n theta) = 2 s c V
        V = _quotient(2 * n, theta, ops) if n else 0 * theta
        parts = ops.cos(n * theta), -(2 * sin * V), 2 * cos * V
    else:
        p = 2 * n - q if side.normal == "to the mass" else 2 * n + q
        U = _quotient(abs(p), theta, ops) * (1 if p > 0 else -1)
        parts = cos * ops.cos(p * (theta / 2)), -(sin * U), cos * U
    scale: Number = side.sign
    if side.normal == "real" and rigid and worlds.rule == "trapezoid":
        # the masses of coupling and environment have poles at z = -1; if these cancel, the loop has a pole there
        scale, room = scale * (cos * cos), room * (cos * cos)
    resistance, reactance, swing = (scale * part for part in parts)
    return HalfPlane(resistance, reactance, swing, room)


def _quotient(p: int, theta: Number, ops: Arithmetic) -> Number:
    """Return sin(p theta/2) over sin(theta/2) or, for an even p, over sin(theta): a sum of cosines, p > 0."""
    if p % 2:
        return 1 + sum((2 * ops.cos(j * theta) for j in range(1, p // 2 + 1)), start=0 * theta)
    n = p // 2
    return sum((ops.cos((n - 1 - 2 * j) * theta) for j in range(n)), start=0 * theta)


def _signs(normal: Normal, rule: WorldRule) -> dict[str, int]:
    """Return the signs of the parts of f_m, 1 and f_k along a normal. Parts that are 0 are absent."""
    q = LEADING[rule]
    if normal == "imaginary":
        return {"mass": 1, "stiffness": -1}
    if q == 0:
        return {"damping": 1}
    parts = {"damping": 1, "mass": -q, "stiffness": -q}
    absent = {"to the mass": "mass", "to the spring": "stiffness"}.get(normal)
    return {name: sign for name, sign in parts.items() if name != absent}


def _ends(side: Side, worlds: Worlds) -> dict[str, Number]:
    """Return the numbers of the environment nearest to a side."""
    signs = _signs(side.normal, worlds.rule)
    return {name: _end(worlds, nearest=side.sign * sign, name=name) for name, sign in signs.items()}


def _end(worlds: Worlds, *, nearest: int, name: str) -> Number:
    end: World = worlds.low if nearest > 0 else worlds.high
    return getattr(end, name)


def _sizes(normal: Normal, rule: WorldRule, sin: Number, cos: Number, T: Number) -> dict[str, Number]:
    """Return the sizes of the parts of f_m, 1 and f_k along a normal, times a factor that makes the margin regular."""
    square, moved = cos * cos, sin * sin * (2 / T)
    if normal == "imaginary":
        return {"mass": moved if rule == "trapezoid" else moved * square, "stiffness": square * (T / 2)}
    if normal == "real":
        return {"damping": 1.0, "mass": moved, "stiffness": T / 2}
    return {"damping": square, "mass": 2 * (moved * square), "stiffness": square * T}
