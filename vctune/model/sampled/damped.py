"""The loop in a hand at the points z = e^(s T) of a damping ratio, s = omega (-zeta + j sqrt(1 - zeta^2)): the number
whose zeros are the poles of the loop (model/README.md, section 21)."""

from __future__ import annotations

from typing import NamedTuple

from vctune.model.gains import Coupling, Rule, stepped
from vctune.model.hands import NAMES, Hand, Hands
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.complexes import Complex, Ray, as_one
from vctune.model.sampled.servo_in_hand import seen_apart
from vctune.model.sampled.servo_plant import ServoPlant
from vctune.model.worlds import Worlds


class Span(NamedTuple):
    """A share of a number: a complex number times each real number between two limits, of which the greater one may be
    infinite."""

    of: Complex
    low: Number
    high: Number


class Spanned(NamedTuple):
    """The numbers fixed + sum of t of, for every t of each span."""

    fixed: Complex
    spans: tuple[Span, ...]


class AtRest(NamedTuple):
    """Spanned numbers, and rays from any of them: next to z = 1, where a spring's share has no limit."""

    spanned: Spanned
    rays: tuple[Complex, ...]


def ray(ratio: Number, ops: Arithmetic) -> Ray:
    """Return the arithmetic of the angles theta, with z = e^(j theta), of a damping ratio."""
    return Ray(ops, ratio / ops.sqrt(1 - ratio * ratio))


class _Shares(NamedTuple):
    """The characteristic number (1 - w) r + k with w = 1/z, by its shares of each parameter: r and k of what is fixed,
    and spans of r alone, and of springs, which have both."""

    fixed: tuple[Complex, Complex | None]
    spans: tuple[Span, ...]
    springs: tuple[tuple[Complex | None, Complex, Number, Number], ...]
    step: Complex  # 1 - w
    slant: Complex  # (1 - w)/Re theta, regular at theta = 0


def _shares(
    plant: ServoPlant, coupling: Coupling, rule: Rule, hands: Hands, worlds: Worlds, along: Number, ops: Ray
) -> _Shares:
    """Return the shares for the real part of an angle. Environments have the least damping of their box: next to a
    damper without limit, the trapezoidal rule leaves a pole at z = -1."""
    theta, T = ops.angle(along), plant.sample_time
    half = ops.sin(theta / 2)
    cos = ops.cos(theta / 2)
    w = 1 - 2 * (half * half) - (2 * (half * cos)).turned()
    late = cos - half.turned()  # e^(-j theta/2)
    step = (2 * (half * late)).turned()
    slant = (Complex(1, ops.slope) * ops.sinc(theta / 2) * late).turned()
    jump, decay = stepped(coupling, T, rule)
    pole = 1 - decay * w
    heavy = not ops.is_zero(worlds.high.mass)
    turned = coupling.rigid and rule == "trapezoid"  # then the pole of the coupling is that of a mass, at z = -1
    extra = 1 + w if heavy and not turned else 1
    scale = pole * extra
    own = (coupling.drag * pole + jump * step) * extra + scale * worlds.low.damping
    spans, springs = list[Span](), list[tuple[Complex | None, Complex, Number, Number]]()
    for name in NAMES:
        low, high = getattr(hands.low, name), getattr(hands.high, name)
        unit = Hand(**{each: int(each == name) for each in NAMES})
        regular, singular = (as_one(part) * scale for part in seen_apart(plant, unit, theta, ops))
        if name == "stiffness":
            springs.append((regular, singular, low, high))
        else:
            spans.append(Span(regular, low, high))
    low, high = worlds.low, worlds.high
    if heavy:
        spans.append(Span((2 / T) * (step if turned else step * pole), low.mass, high.mass))
    if not ops.is_zero(high.stiffness):
        springs.append((None, (T / 2) * ((1 + w) * scale), low.stiffness, high.stiffness))
    fixed: tuple[Complex, Complex | None] = (own, None)
    if plant.pull is not None:
        spring = Hand(0, 0, plant.pull.stiffness)
        regular, singular = (as_one(part) * scale for part in seen_apart(plant.pull.plant, spring, theta, ops))
        fixed = own + regular, singular
    return _Shares(fixed, tuple(spans), tuple(springs), step, slant)


def characteristic(
    plant: ServoPlant, coupling: Coupling, rule: Rule, hands: Hands, worlds: Worlds, along: Number, ops: Ray
) -> Spanned:
    """Return the polynomial in w = 1/z whose zeros are the poles of a servo's loop, in every hand and environment of
    two boxes, at an angle with a real part. It has poles only where servo, sensor and filters have."""
    of = _shares(plant, coupling, rule, hands, worlds, along, ops)
    regular, singular = of.fixed
    spans = [Span(each.of * of.step, each.low, each.high) for each in of.spans]
    for r, k, low, high in of.springs:
        spans.append(Span(k if r is None else r * of.step + k, low, high))
    fixed = regular * of.step
    return Spanned(fixed if singular is None else fixed + singular, tuple(spans))


def without_position(
    plant: ServoPlant, coupling: Coupling, rule: Rule, hands: Hands, worlds: Worlds, along: Number, ops: Ray
) -> AtRest:
    """Return `characteristic` over 1 - w, which has a value at z = 1 where nothing holds the position; springs are rays
    beside it."""
    of = _shares(plant, coupling, rule, hands, worlds, along, ops)
    regular, singular = of.fixed
    back = of.slant.conjugate()
    rays = [(k if r is None else r * (of.slant * along) + k) * back for r, k, _, _ in of.springs]
    if singular is not None:
        rays.append(singular * back)
    return AtRest(Spanned(regular, of.spans), tuple(rays))
