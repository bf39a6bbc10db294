"""The margins of the claims: functions that must be positive, each written once for every arithmetic."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, dataclass
from math import inf, nextafter

from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Coupling, Gains, SpringDamper, coupling_impedance
from vctune.model.loop.device_response import DeviceResponse, device_response
from vctune.model.loop.llewellyn import llewellyn_demand, moduli, passive_alone
from vctune.model.loop.loop import loop_constants, loop_response
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.pair import EvenOdd, Pair, im_conj_product, re_conj_product
from vctune.model.problem import Demands
from vctune.model.sampled.any_hand import any_hand
from vctune.model.sampled.hand_loop import (
    NextToRest,
    loop_in_hand,
    required_in_hand,
    required_in_limp_hand,
    room,
    seen_in_hand,
    seen_in_limp_hand,
)
from vctune.model.sampled.impedance_display import ForceInHand, Required
from vctune.model.sampled.loop_in_worlds import (
    Disjuncts,
    Offered,
    Seen,
    Strip,
    disjuncts,
    limp_disjuncts,
    offered_at,
    strip_in_walls,
)
from vctune.model.sampled.plant_in_hand import AnyPlantInHand, PlantInHand
from vctune.model.sampled.velocity_loop import PlantLetGo, difference_slope, return_difference
from vctune.model.worlds import WorldsMet


@dataclass(frozen=True, slots=True)
class LoopDelay:
    """The number of whole samples in a delay, and whether a fraction of a sample remains beyond them."""

    whole_samples: Number
    fractional: bool


@dataclass(frozen=True, slots=True)
class Design:
    """The judged design: a device with gains and coupling, in numbers of any arithmetic."""

    device: Device
    gains: Gains
    coupling: AnyCoupling

    def converted(self, number: Callable[[Number], Number]) -> Design:
        """Return the design with its numbers in another arithmetic; inf stays a float."""
        coupling = type(self.coupling)(*(x if x == inf else number(x) for x in astuple(self.coupling)))
        return Design(self.device.converted(number), Gains(*map(number, astuple(self.gains))), coupling)

    @property
    def series(self) -> Coupling:
        """The coupling of an admittance display or a servo: damping and mass in series with a drag in parallel."""
        assert isinstance(self.coupling, Coupling)
        return self.coupling


def conditions_margin(design: Design, omega: Number, factor: Number, ops: Arithmetic) -> Number:
    """Return 2 r (Re Z_c - factor R) at omega > 0, where r is the loop's resistance (model/README.md, section 4)."""
    loop = loop_response(device_response(design.device, omega, ops), design.gains, ops)
    return 2 * loop.resistance * coupling_impedance(design.series, omega).re - factor * llewellyn_demand(loop, ops)


def alone_margin(design: Design, omega: Number, factor: Number, ops: Arithmetic) -> Number:
    """Return the margin at omega > 0 of the handle's passivity with nothing behind a coupling of Z_c / factor."""
    loop = loop_response(device_response(design.device, omega, ops), design.gains, ops)
    held, driven = passive_alone(loop, coupling_impedance(design.series, omega))
    return held + factor * driven


def conditions_of(demands: Demands) -> Callable[[Design, Number, Number, Arithmetic], Number]:
    """Return the margin of the claim about any passive hand: with every passive environment, or with nothing behind."""
    return alone_margin if demands.alone else conditions_margin


def clamped_margin(design: Design, omega: Number, radius: Number, ops: Arithmetic) -> Number:
    """Return |N|^2 - r^2 |N - N_0|^2 at omega > 0. Where it is positive, N is not 0 for any response within the
    disc."""
    numerator = loop_constants(device_response(design.device.modelled, omega, ops)).numerator
    N, driven = numerator.closed(design.gains).abs2(), numerator.driven(design.gains)
    return N if driven is None else N - radius * radius * driven.abs2()


def low_margin(design: Design, omega: Number, factor: Number, ops: Arithmetic) -> Number:
    """Return a margin that is regular at omega = 0. Where it is positive, `conditions_margin` is positive."""
    device, coupling = design.device, design.series
    loop = loop_response(device_response(device, omega, ops), design.gains, ops)
    weight = moduli(loop, ops) + re_conj_product(loop.C_scaled, loop.D_scaled)
    im = loop.im_C_conj_D_scaled
    if device.operator is not None and not ops.is_zero(device.operator.damping):
        eased = 2 * loop.resistance * coupling.drag + factor * loop.operator_relief
        return eased * weight - factor * (im * im)
    if not ops.is_zero(coupling.drag):
        return 2 * loop.resistance * coupling.drag * weight - factor * (im * im)
    if loop.im_slope is None:
        return -weight
    b_c, m_c, reactance = coupling.damping, coupling.mass, coupling.mass * omega
    slope = b_c * (m_c * m_c) / (b_c * b_c + reactance * reactance)
    return 2 * loop.resistance * slope * weight - factor * (loop.im_slope * loop.im_slope)


def high_margin(design: Design, v: Number, factor: Number, ops: Arithmetic) -> Number:
    """Return `conditions_margin` at omega = 1/v, for an ideal device with hold "lag" and no delay."""
    device, gains, coupling = design.device, design.gains, design.series
    assert device.ideal, "beyond Nyquist only an ideal device has a model"
    half = device.sample_time / 2
    decay = 1 / (v * v + half * half)
    re_C_over_v = (gains.velocity - gains.position * half) * decay * v
    omega_im_C = -((gains.velocity * half + gains.position * (v * v)) * decay)
    re_C = re_C_over_v * v
    re_D = device.damping + re_C
    im_D_v, re_D_v = device.mass + omega_im_C * (v * v), re_D * v
    product = (re_C_over_v * re_C_over_v + omega_im_C * omega_im_C) * (re_D_v * re_D_v + im_D_v * im_D_v)
    excess = ops.sqrt(product) - (re_C * re_D + omega_im_C * im_D_v)
    re_Z_c = coupling.drag
    if not coupling.rigid:
        mass2, damping_v = coupling.mass * coupling.mass, coupling.damping * v
        re_Z_c = re_Z_c + coupling.damping * mass2 / (damping_v * damping_v + mass2)
    if device.operator is None:
        return 2 * re_D * re_Z_c - factor * excess
    b_h = device.operator.damping
    return 2 * (re_D + b_h) * re_Z_c + factor * (2 * b_h * re_C - excess)


def sensitivity_margin(plant: PlantLetGo, gains: Gains, theta: Number, limit: Number, ops: Arithmetic) -> Number:
    """Return limit^2 |F|^2 - |F_0|^2 of the sampled loop. It is positive where |S| = |F_0/F| < limit."""
    parts = return_difference(plant, theta, ops, position=not ops.is_zero(gains.position))
    return limit * limit * parts.closed(gains).abs2() - parts.open.abs2()


def unmodelled_margin(plant: PlantLetGo, gains: Gains, theta: Number, radius: Number, ops: Arithmetic) -> Number:
    """Return |F|^2 - radius^2 |F - F_0|^2. It is positive where |1 - S| radius < 1 (model/README.md, section 13)."""
    parts = return_difference(plant, theta, ops, position=not ops.is_zero(gains.position))
    loop = parts.velocity.scaled(gains.velocity) + parts.position.scaled(gains.position)
    return (parts.open + loop).abs2() - radius * radius * loop.abs2()


def hand_margin(plant: AnyPlantInHand, design: Design, theta: Number, factor: Number, ops: Arithmetic) -> Number:
    """Return |F|^2 (Re Z_c - factor R) in a hand (model/README.md, section 14)."""
    required = required_in_hand(loop_in_hand(plant, theta, ops), design.gains)
    return room(design.coupling, design.device, required, factor, theta, ops)


def margin_in_spring(
    plants: tuple[PlantInHand, PlantInHand], design: Design, theta: Number, factor: Number, ops: Arithmetic
) -> tuple[Number, Number]:
    """Return two margins; where both are positive, `hand_margin` is for a spring of any stiffness.

    It is a quadratic in the stiffness, whose discriminant and whose square term decide (model/README.md, section 14).
    """
    soft, stiff = (loop_in_hand(plant, theta, ops) for plant in plants)
    F, P = soft.closed(design.gains), soft.numerator(design.gains)
    F_1, P_1 = stiff.closed(design.gains) + F.scaled(-1), stiff.numerator(design.gains) + P.scaled(-1)
    # from the stiffness with the least |F|, where F is across F_1 and nothing is left of the resonance
    square, size = F.square, F_1.abs2()
    across = (F_1.even * F.odd - F_1.odd * F.even) / size
    F_0 = EvenOdd(-(square * (across * F_1.odd)), across * F_1.even, square)
    P_0 = P + P_1.scaled(-((F.even * F_1.even + square * (F.odd * F_1.odd)) / size))

    def term(size: Number, *pairs: tuple[EvenOdd, EvenOdd]) -> Number:
        lost = [-0.5 * (p.odd * f.even - p.even * f.odd) for p, f in pairs]
        return room(design.coupling, design.device, Required(sum(lost[1:], start=lost[0]), size), factor, theta, ops)

    bent, linear = term(size, (P_1, F_1)), term(0 * size, (P_0, F_1), (P_1, F_0))
    return 4 * (bent * term(square * (across * across * size), (P_0, F_0))) - linear * linear, bent


def limp_hand_margin(
    plant: PlantInHand, design: Design, theta: Number, rest: NextToRest, factor: Number, ops: Arithmetic
) -> Number:
    """Return `hand_margin` divided by rho^2, for theta near 0, a hand without stiffness and K_p = 0."""
    required = required_in_limp_hand(plant, design.gains.velocity, theta, rest, ops)
    return room(design.coupling, design.device, required, factor, theta, ops)


def margins_in_worlds(
    plant: AnyPlantInHand, design: Design, theta: Number, met: WorldsMet, ops: Arithmetic
) -> Disjuncts:
    """Return the margins in a hand with a box of environments, each as the terms of its sum. At least one margin must
    be positive."""
    offered, seen = met_by_environment(plant, design, theta, ops)
    return disjuncts(offered, met.worlds, design.device.sample_time, seen, met.factor, theta, ops)


def met_by_environment(plant: AnyPlantInHand, design: Design, theta: Number, ops: Arithmetic) -> tuple[Offered, Seen]:
    """Return the impedances that an environment meets: of the coupling and of the loop."""
    seen = seen_in_hand(loop_in_hand(plant, theta, ops), design.gains)
    return offered_at(design.series, design.device.sample_time, theta, ops), seen


def limp_margins_in_worlds(
    plant: PlantInHand, design: Design, theta: Number, rest: NextToRest, met: WorldsMet, ops: Arithmetic
) -> Disjuncts:
    """Return `margins_in_worlds` divided by rho^2, for K_p = 0, theta near 0 and a hand without stiffness."""
    seen, T = seen_in_limp_hand(plant, design.gains.velocity, theta, rest, ops), design.device.sample_time
    return limp_disjuncts(offered_at(design.series, T, theta, ops), met.worlds, T, seen, met.factor, theta, ops)


def strip_of_walls(
    plant: AnyPlantInHand, design: Design, theta: Number, share: Number, met: WorldsMet, ops: Arithmetic
) -> Strip:
    """Return the ranges over which the condition of walls must hold in a hand, for one share of the coupling."""
    offered, seen = met_by_environment(plant, design, theta, ops)
    return strip_in_walls(offered, met.worlds, design.device.sample_time, seen, share, theta, ops)


def limp_strip_of_walls(
    plant: PlantInHand, design: Design, theta: Number, rest: NextToRest, share: Number, met: WorldsMet, ops: Arithmetic
) -> Strip:
    """Return `strip_of_walls` divided by rho^2, for K_p = 0, theta near 0 and a hand without stiffness."""
    seen, T = seen_in_limp_hand(plant, design.gains.velocity, theta, rest, ops), design.device.sample_time
    whole = Seen(seen.lost, ops.sin(theta / 2) * seen.swing, seen.size)
    return strip_in_walls(offered_at(design.series, T, theta, ops), met.worlds, T, whole, share, theta, ops)


def any_hand_margin(
    design: Design, delay: LoopDelay, theta: Number, factor: Number, ops: Arithmetic
) -> tuple[Number, Number]:
    """Return two margins for an impedance display in any passive hand. Both must be positive."""
    hand = any_hand(design.device, delay.whole_samples, theta, ops, fractional=delay.fractional)
    required = hand.required(design.gains)
    return room(design.coupling, design.device, required, factor, theta, ops), required.size


def any_hand_before_wall(design: Design, delay: LoopDelay, theta: Number, share: Number, ops: Arithmetic) -> Number:
    """Return a margin for a share of the coupling as a wall in any passive hand (model/README.md, section 15)."""
    hand = any_hand(design.device, delay.whole_samples, theta, ops, fractional=delay.fractional)
    assert isinstance(design.coupling, SpringDamper)
    along, size2 = hand.before_wall(design.coupling, design.device.sample_time, theta, ops)
    return 1 + share * (along + share * size2)


def wall_curve(plant: AnyPlantInHand, wall: SpringDamper, share: Number, theta: Number, ops: Arithmetic) -> Pair:
    """Return `hand_curve` for a share of the coupling as a wall."""
    loop = loop_in_hand(plant, theta, ops)
    assert isinstance(loop, ForceInHand)
    F = loop.before_wall(wall, share)
    return Pair(F.even, ops.sin(theta / 2) * F.odd) * _turned(plant.poles, theta, ops)


def hand_curve(plant: AnyPlantInHand, gains: Gains, theta: Number, ops: Arithmetic) -> Pair:
    """Return F of the loop in a hand, rotated to be real at both ends. The curve of a stable loop makes no turn around
    0."""
    F = loop_in_hand(plant, theta, ops).closed(gains)
    return Pair(F.even, ops.sin(theta / 2) * F.odd) * _turned(plant.poles, theta, ops)


def limp_hand_curve(plant: AnyPlantInHand, gains: Gains, theta: Number, ops: Arithmetic) -> tuple[Pair, Number]:
    """Return `hand_curve` without the pole at z = 1 of a free position, and its real part, also at theta = 0."""
    F, others = loop_in_hand(plant, theta, ops).closed(gains), plant.poles - 1
    curve = Pair(F.odd, -F.even / ops.sin(theta / 2)) * _turned(others, theta, ops)
    ratio = others * ops.sinc(theta * (others / 2)) / ops.sinc(theta / 2)  # of the sines of others theta/2 and theta/2
    return curve, F.odd * ops.cos(theta * (others / 2)) - F.even * ratio


def _turned(poles: int, theta: Number, ops: Arithmetic) -> Pair:
    return Pair(ops.cos(theta * (poles / 2)), -ops.sin(theta * (poles / 2)))


def resistance_apart(device: Device) -> bool:
    """Return whether the loop's resistance needs a proof of its own, besides `conditions_margin`."""
    return device.operator is not None and not device.ideal


def resistance_margin(design: Design, omega: Number, ops: Arithmetic) -> Number:
    """Return the loop's resistance in the hand of the least operator; without an operator it is |D|^2 Re G_hh."""
    return loop_response(device_response(design.device, omega, ops), design.gains, ops).resistance


def model_curve(at: DeviceResponse, gains: Gains, ops: Arithmetic) -> Pair:
    """Return a curve that has the zeros of D and no pole to the right of the imaginary axis."""
    D = loop_response(at, gains, ops).D_scaled
    if not ops.is_zero(gains.position):
        D = Pair(-D.im, D.re)
    return D if at.spring is None else D * Pair(at.spring.y_k, at.omega * at.spring.y_c)


def along_drive(at: DeviceResponse, gains: Gains) -> Number:
    """Return Re(D conj(e A H)) with e = 1 + y Z_2. It does not depend on K_p and is regular at omega = 0."""
    omega, drive, spring = at.omega, at.drive, at.spring
    lagging = omega * drive.lag
    H2 = drive.re * drive.re + lagging * lagging
    kept = H2 if at.estimate is None else H2 * at.estimate.re
    along = at.damping * drive.re - at.mass * omega * lagging + gains.velocity * kept
    if spring is None:
        return along
    Z_2 = Pair(0 if spring.damping is None else spring.damping, omega * spring.mass)
    e = Pair(omega * (omega * spring.y_c), omega * spring.y_k) * Z_2
    e = Pair(1 + e.re, e.im)
    return e.abs2() * along + re_conj_product(Z_2, e * Pair(drive.re, -lagging))


def across_position(plant: PlantLetGo, gains: Gains, theta: Number, ops: Arithmetic) -> tuple[Number, Number]:
    """Return Im(F conj P)/theta and |F_0|^2 |P|^2/theta^2 with P = dF/dK_p. Neither depends on K_p."""
    velocity_loop = return_difference(plant, theta, ops, position=False)
    P, slope = return_difference(plant, theta, ops, position=True).position, difference_slope(theta, ops)
    F = velocity_loop.closed(gains) * slope
    return im_conj_product(F, P), (velocity_loop.open * slope).abs2() * P.abs2()


def sensitivity_sufficient_margin(
    plant: PlantLetGo, gains: Gains, theta: Number, limit: Number, ops: Arithmetic
) -> Number:
    """Return (limit Im(F conj P) - |F_0||P|)/theta. Where it is positive, |S| < limit for all K_p."""
    across, product2 = across_position(plant, gains, theta, ops)
    return limit * across - ops.sqrt(product2)


def outwards(band: tuple[float, float]) -> tuple[float, float]:
    """Return a band in rad/s, each edge moved outwards by four floats, more than the rounding error of 2 pi f."""
    low, high = band
    for _ in range(4):
        low, high = nextafter(low, 0.0), nextafter(high, inf)
    return low, high


def inwards(band: tuple[float, float]) -> tuple[float, float]:
    """Return a band in rad/s that lies within the intended band for any rounding of 2 pi f."""
    low, high = band
    for _ in range(4):
        low, high = nextafter(low, inf), nextafter(high, 0.0)
    return low, high
