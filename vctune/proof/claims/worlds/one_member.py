"""Prove one environment of a box stable in one hand, by the turns of Y + Z_e around 0 (model/README.md, section 20)."""

from __future__ import annotations

from dataclasses import astuple, dataclass
from math import pi

from flint import arb

from vctune.model.gains import AnyCoupling, SpringDamper
from vctune.model.hands import Hand
from vctune.model.numbers.arithmetic import Number
from vctune.model.numbers.pair import Pair
from vctune.model.sampled.plant_in_hand import AnyPlantInHand, delays_of, plant_in_hand
from vctune.model.sampled.worlds.loop_in_late_worlds import LEADING
from vctune.model.sampled.worlds.loop_in_worlds import Offered, Seen
from vctune.model.worlds import World, Worlds
from vctune.proof.claims.margins_of_claims import HALF_TURN, Design, met_by_environment
from vctune.proof.claims.sampled_poles import in_rad_per_s
from vctune.proof.enclosures.arb_balls import BALLS, ball, design_ball
from vctune.proof.engine.interval import Outcome, Verdict
from vctune.proof.engine.winding import turned_angle

UNBOUNDED = 1e30  # Bound of an imaginary part that does not matter, because the real part is positive


def prove_member(design: Design, hand: Hand, worlds: Worlds) -> Outcome:
    """Prove the loop stable with the environment in the middle of a box, given that it is stable with v_e = 0."""
    member, exact = middle_of(worlds), design_ball(design)
    plant = plant_in_hand(exact.device, hand.mapped(ball), delays_of(design.device), BALLS)
    held = design.gains.position > 0 or not design.device.kind.own_loop
    curve = _Curve(
        exact,
        plant,
        worlds,
        World(*map(ball, astuple(member))),
        sprung=bool(member.stiffness > 0 or (hand.stiffness > 0 and held)),
        heavy=bool((worlds.rule == "trapezoid" and member.mass > 0) or design.coupling.rigid),
        ahead=worlds.ahead,
    )
    outcome, angle = turned_angle(curve.at, 0.0, HALF_TURN)
    if outcome.verdict is not Verdict.PROVED:
        return in_rad_per_s(outcome, design.device)
    return Outcome(Verdict.PROVED if abs(angle) < pi / 2 else Verdict.REFUTED, outcome.boxes)


def middle_of(worlds: Worlds) -> World:
    """Return the environment in the middle of a finite box."""
    low, high = worlds.low, worlds.high
    return World(*((a + b) / 2 for a, b in zip(astuple(low), astuple(high), strict=True)))


@dataclass(frozen=True, slots=True)
class _Curve:
    """Y + Z_e over the upper half of the unit circle, times |F|^2 and the factors that make it regular."""

    design: Design  # design and plant in balls
    plant: AnyPlantInHand
    worlds: Worlds  # environments with their rule and lateness
    member: World  # the environment in the middle, in balls
    sprung: bool  # whether the environment has a pole at 1, at -1 and at infinity
    heavy: bool
    ahead: bool

    def at(self, theta: arb) -> Pair:
        """Return the curve at an angle, rad."""
        offered, seen, _ = met_by_environment(self.plant, self.design, theta, 1, BALLS)
        late = -2 * self.worlds.late
        found = self._alone(offered, seen, theta) + _turned(self._rendered(theta), late, theta).scaled(seen.size)
        return _turned(found, -(self.sprung + self.heavy + 2 * self.ahead), theta)

    def _alone(self, at: Offered, seen: Seen, theta: arb) -> Pair:
        """Return Y |F|^2 times 2 j s if the environment has a pole at 1, and times 2 c if it has one at -1."""
        T, sin, cos = self.design.device.sample_time, (theta / 2).sin(), (theta / 2).cos()
        scale = 2 * cos if self.heavy else 1
        real = at.resistance * seen.size - seen.lost
        reactive = 2 * at.reactance if self.heavy else _reactance(self.design.coupling, T, sin, cos)
        if self.sprung:
            return Pair(-2 * (sin * reactive * seen.size - scale * seen.swing), 2 * sin * scale * real)
        if bool(sin.contains(0)):  # near rest the real part alone decides
            return Pair(scale * real, arb(0, UNBOUNDED) if theta.rad() > 0 else arb(0))
        return Pair(scale * real, reactive * seen.size - scale * (seen.swing / sin))

    def _rendered(self, theta: arb) -> Pair:
        """Return the environment without its lateness, times the same factors."""
        T, sin, cos, q = self.design.device.sample_time, (theta / 2).sin(), (theta / 2).cos(), LEADING[self.worlds.rule]
        mass, damping, stiffness = self.member.mass, self.member.damping, self.member.stiffness
        scale, moved = (2 * cos if self.heavy else arb(1)), 2 * sin / T * mass
        # the factor j s belongs to the mass, the factor 1/(j s) to the spring
        if q == 0:
            inertia = Pair(arb(0), 2 * moved if self.heavy else arb(0))
            spring = stiffness * T * cos * scale
            turned = Pair(spring, arb(0))
        else:
            inertia = _turned(Pair(arb(0), moved * scale), q, theta)
            turned = _turned(Pair(stiffness * T * scale, arb(0)), -q, theta)
        met = inertia.plus(damping * scale)
        return met * Pair(arb(0), 2 * sin) + turned if self.sprung else met


def _turned(number: Pair, halves: int, theta: arb) -> Pair:
    """Return a number times e^(j halves theta/2)."""
    return number * Pair((theta * halves / 2).cos(), (theta * halves / 2).sin())


def _reactance(coupling: AnyCoupling, sample_time: Number, sin: Number, cos: Number) -> Number:
    """Return Im Z_c of a coupling in series with finite damping; 0 for an impedance display."""
    if isinstance(coupling, SpringDamper):
        return 0
    reactance, slack = coupling.mass * 2 * sin / sample_time, coupling.damping * cos
    return reactance * coupling.damping * slack / (slack * slack + reactance * reactance)
