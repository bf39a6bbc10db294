"""The margins of the claims: functions of a case and a frequency that must be positive, each written once."""

from __future__ import annotations

from dataclasses import replace
from math import inf, nextafter

from vctune.model.device import Device
from vctune.model.gains import SpringDamper, coupling_impedance
from vctune.model.hands import STIFFNESS
from vctune.model.loop.device_response import device_response
from vctune.model.loop.llewellyn import llewellyn_excess, moduli, passive_alone, required_resistance
from vctune.model.loop.loop import LoopResponse, loop_constants, loop_response
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.pair import EvenOdd, Pair, im_conj_product, re_conj_product
from vctune.model.sampled.any_hand import AnyHand, any_hand
from vctune.model.sampled.hand_loop import (
    NextToRest,
    loop_in_hand,
    required_in_hand,
    required_in_limp_hand,
    room,
    seen_in_hand,
    seen_in_limp_hand,
)
from vctune.model.sampled.impedance_display import ForceInHand, Required, firmware_filter
from vctune.model.sampled.loop_in_worlds import (
    Disjuncts,
    Strip,
    ZOffered,
    ZSeen,
    disjuncts,
    limp_disjuncts,
    offered_at,
    strip_in_walls,
)
from vctune.model.sampled.plant_in_hand import PlantInHand, plants_in_spring
from vctune.model.sampled.velocity_loop import ReturnDifference, difference_slope, return_difference, unturned
from vctune.model.worlds import WorldsMet
from vctune.proof.boxes import FREQUENCY
from vctune.proof.claims.cases import Case

# The names of the rows for the shares of rho (model/README.md, section 14)
RHO_SHARES = "share of the integrator", "share of the hand's stiffness in the rest"
# The names of the two rows that both begin at 0 in a box of hands next to rest: the angle and the stiffness
AT_REST = (FREQUENCY, STIFFNESS)


def conditions_margin(case: Case, omega: Number) -> Number:
    """Return 2 r (Re Z_c - factor R) at omega > 0, where r is the loop's resistance (model/README.md, section 4), or,
    with nothing behind the coupling, the margin of the handle's passivity with Z_c / factor."""
    loop, offered = _loop(case, omega), coupling_impedance(case.design.series, omega)
    if case.demands.alone:
        held, driven = passive_alone(loop, offered)
        return held + case.factor * driven
    return 2 * loop.resistance * offered.re - case.factor * llewellyn_excess(loop, case.ops)


def clamped_margin(case: Case, omega: Number) -> Number:
    """Return |N|^2 - r^2 |N - N_0|^2 at omega > 0. Where it is positive, N is not 0 for any response within the
    disc."""
    numerator = loop_constants(device_response(case.design.device.modelled, omega, case.ops)).numerator
    N, driven = numerator.closed(case.design.gains).abs2(), numerator.driven(case.design.gains)
    radius = case.radius(omega)
    return N if driven is None else N - radius * radius * driven.abs2()


def low_margin(case: Case, omega: Number) -> Number:
    """Return a margin that is regular at omega = 0. Where it is positive, `conditions_margin` is positive
    (proof/README.md, section 5)."""
    device, coupling, factor, ops = case.design.device, case.design.series, case.factor, case.ops
    loop = _loop(case, omega)
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


def high_margin(case: Case, v: Number) -> Number:
    """Return `conditions_margin` at omega = 1/v, for an ideal device with hold "lag" and no delay
    (model/README.md, section 6)."""
    device, gains, coupling, factor = case.design.device, case.design.gains, case.design.series, case.factor
    assert device.ideal, "beyond Nyquist only an ideal device has a model"
    half = device.sample_time / 2
    decay = 1 / (v * v + half * half)
    re_C_over_v = (gains.velocity - gains.position * half) * decay * v
    omega_im_C = -((gains.velocity * half + gains.position * (v * v)) * decay)
    re_C = re_C_over_v * v
    re_D = device.damping + re_C
    im_D_v, re_D_v = device.mass + omega_im_C * (v * v), re_D * v
    product = (re_C_over_v * re_C_over_v + omega_im_C * omega_im_C) * (re_D_v * re_D_v + im_D_v * im_D_v)
    excess = case.ops.sqrt(product) - (re_C * re_D + omega_im_C * im_D_v)
    re_Z_c = coupling.drag
    if not coupling.rigid:
        mass2, damping_v = coupling.mass * coupling.mass, coupling.damping * v
        re_Z_c = re_Z_c + coupling.damping * mass2 / (damping_v * damping_v + mass2)
    if device.operator is None:
        return 2 * re_D * re_Z_c - factor * excess
    b_h = device.operator.damping
    return 2 * (re_D + b_h) * re_Z_c + factor * (2 * b_h * re_C - excess)


def sensitivity_margin(case: Case, theta: Number) -> Number:
    """Return limit^2 |F|^2 - |F_0|^2 of the sampled loop. It is positive where |S| = |F_0/F| < limit."""
    parts, limit = _difference(case, theta), case.max_sensitivity
    return limit * limit * parts.closed(case.design.gains).abs2() - parts.open.abs2()


def unmodelled_margin(case: Case, theta: Number) -> Number:
    """Return |F|^2 - r^2 |F - F_0|^2. It is positive where |1 - S| r < 1 (model/README.md, section 13)."""
    parts, gains = _difference(case, theta), case.design.gains
    radius = case.radius(theta / case.design.device.sample_time)
    loop = parts.velocity.scaled(gains.velocity) + parts.position.scaled(gains.position)
    return (parts.open + loop).abs2() - radius * radius * loop.abs2()


def sampled_curve(case: Case, theta: Number) -> Pair:
    """Return F of the sampled loop, rotated to be real at both ends."""
    return unturned(case.let_go(), _difference(case, theta).closed(case.design.gains), theta, case.ops)


def hand_margin(case: Case, theta: Number) -> Number:
    """Return |F|^2 (Re Z_c - factor R) in a hand (model/README.md, section 14)."""
    return _room(case, required_in_hands(case, theta), theta)


def margin_in_spring(case: Case, theta: Number) -> tuple[Number, Number]:
    """Return two margins; where both are positive, `hand_margin` is for a spring of any stiffness.

    It is a quadratic in the stiffness, whose discriminant and whose square term decide (model/README.md, section 14).
    """
    gains, plants = case.design.gains, plants_in_spring(case.design.device, case.hand, case.delays, case.ops)
    soft, stiff = (loop_in_hand(replace(plant, delays=case.delays), theta, case.ops) for plant in plants)
    F, P = soft.closed(gains), soft.numerator(gains)
    F_1, P_1 = stiff.closed(gains) + F.scaled(-1), stiff.numerator(gains) + P.scaled(-1)
    # from the stiffness with the least |F|, where F is across F_1 and nothing is left of the resonance
    square, size = F.square, F_1.abs2()
    across = (F_1.even * F.odd - F_1.odd * F.even) / size
    F_0 = EvenOdd(-(square * (across * F_1.odd)), across * F_1.even, square)
    P_0 = P + P_1.scaled(-((F.even * F_1.even + square * (F.odd * F_1.odd)) / size))

    def term(size: Number, *pairs: tuple[EvenOdd, EvenOdd]) -> Number:
        lost = [-0.5 * (p.odd * f.even - p.even * f.odd) for p, f in pairs]
        return _room(case, Required(sum(lost[1:], start=lost[0]), size), theta)

    bent, linear = term(size, (P_1, F_1)), term(0 * size, (P_0, F_1), (P_1, F_0))
    return 4 * (bent * term(square * (across * across * size), (P_0, F_0))) - linear * linear, bent


def limp_hand_margin(case: Case, theta: Number) -> Number:
    """Return `hand_margin` divided by rho^2, for theta near 0, a hand without stiffness and K_p = 0."""
    plant, rest = _next_to_rest(case, theta)
    required = required_in_limp_hand(plant, case.design.gains.velocity, theta, rest, case.ops)
    return _room(case, required, theta)


def margins_in_worlds(case: Case, theta: Number) -> Disjuncts:
    """Return the margins in a hand with a box of environments, each as the terms of its sum. At least one margin must
    be positive (model/README.md, section 18)."""
    met, (offered, seen) = _met(case), _met_by_environment(case, theta)
    return disjuncts(offered, met.worlds, case.design.device.sample_time, seen, met.factor, theta, case.ops)


def limp_margins_in_worlds(case: Case, theta: Number) -> Disjuncts:
    """Return `margins_in_worlds` divided by rho^2, for K_p = 0, theta near 0 and a hand without stiffness."""
    met, T = _met(case), case.design.device.sample_time
    seen, offered = _seen_at_rest(case, theta), _offered(case, theta)
    return limp_disjuncts(offered, met.worlds, T, seen, met.factor, theta, case.ops)


def strip_of_walls(case: Case, theta: Number) -> Strip:
    """Return the ranges over which the condition of walls must hold in a hand, for one share of the coupling."""
    offered, seen = _met_by_environment(case, theta)
    return strip_in_walls(offered, _met(case).worlds, case.design.device.sample_time, seen, case.share, theta, case.ops)


def limp_strip_of_walls(case: Case, theta: Number) -> Strip:
    """Return `strip_of_walls` divided by rho^2, for K_p = 0, theta near 0 and a hand without stiffness."""
    seen, T, ops = _seen_at_rest(case, theta), case.design.device.sample_time, case.ops
    whole = ZSeen(seen.lost, ops.sin(theta / 2) * seen.swing, seen.size)
    offered = _offered(case, theta)
    return strip_in_walls(offered, _met(case).worlds, T, whole, case.share, theta, ops)


def any_hand_margin(case: Case, theta: Number) -> Number:
    """Return |F|^2 (Re 1/Z_c - factor R) for any passive hand on an impedance display (model/README.md, section 15)."""
    return _room(case, required_in_any_hand(case, theta), theta)


def any_hand_size(case: Case, theta: Number) -> Number:
    """Return |F|^2 in the worst passive hand, which must be positive as well."""
    return required_in_any_hand(case, theta).size


def any_hand_before_wall(case: Case, theta: Number) -> Number:
    """Return a margin for a share of factor times the coupling as a wall in any passive hand (model/README.md,
    section 15)."""
    wall, share = case.design.coupling, case.factor * case.share
    assert isinstance(wall, SpringDamper)
    along, size2 = _any_hand(case, theta).before_wall(wall, case.design.device.sample_time, theta, case.ops)
    return 1 + share * (along + share * size2)


def hand_curve(case: Case, theta: Number) -> Pair:
    """Return F of the loop in a hand, before a rigid wall with a share of factor times the coupling as that wall.

    It is rotated to be real at both ends. The curve of a stable loop makes no turn around 0.
    """
    plant, wall = case.held(), case.design.coupling
    loop = loop_in_hand(plant, theta, case.ops)
    if case.demands.rigid:
        assert isinstance(loop, ForceInHand) and isinstance(wall, SpringDamper)
        F = loop.before_wall(wall, case.factor * case.share)
    else:
        F = loop.closed(case.design.gains)
    return Pair(F.even, case.ops.sin(theta / 2) * F.odd) * _turned(plant.poles, theta, case.ops)


def coupling_curve(case: Case, theta: Number) -> Pair:
    """Return (1 - 1/z) Z_c T of an impedance display, whose zeros outside the unit circle are poles of 1/Z_c."""
    coupling, device, ops = case.design.coupling, case.design.device, case.ops
    assert isinstance(coupling, SpringDamper)
    passed, half = firmware_filter(device, theta, ops) or Pair(1, 0), ops.sin(theta / 2)
    difference = Pair(2 * half * half, 2 * half * ops.cos(theta / 2))
    return (passed * difference).scaled(coupling.damping).plus(coupling.stiffness * device.sample_time)


def limp_hand_curve(case: Case, theta: Number) -> Pair:
    """Return `hand_curve` without the pole at z = 1 of a free position."""
    plant, ops = case.held(), case.ops
    F = loop_in_hand(plant, theta, ops).closed(case.design.gains)
    return Pair(F.odd, -F.even / ops.sin(theta / 2)) * _turned(plant.poles - 1, theta, ops)


def limp_hand_real(case: Case, theta: Number) -> Number:
    """Return the real part of `limp_hand_curve`, also at theta = 0."""
    plant, ops = case.held(), case.ops
    F, others = loop_in_hand(plant, theta, ops).closed(case.design.gains), plant.poles - 1
    ratio = others * ops.sinc(theta * (others / 2)) / ops.sinc(theta / 2)  # of the sines of others theta/2 and theta/2
    return F.odd * ops.cos(theta * (others / 2)) - F.even * ratio


def resistance_apart(device: Device) -> bool:
    """Return whether the loop's resistance needs a proof of its own, besides `conditions_margin`."""
    return device.operator is not None and not device.ideal


def resistance_margin(case: Case, omega: Number) -> Number:
    """Return the loop's resistance in the hand of the least operator; without an operator it is |D|^2 Re G_hh."""
    return _loop(case, omega).resistance


def required_margin(case: Case, omega: Number) -> Number:
    """Return the least feasible Re Z_c, N s/m, where the loop's resistance is positive."""
    return required_resistance(_loop(case, omega), case.ops)


def required_in_hands(case: Case, theta: Number) -> Required:
    """Return the least feasible Re Z_c in a hand, N s/m."""
    return required_in_hand(loop_in_hand(case.held(), theta, case.ops), case.design.gains)


def required_in_any_hand(case: Case, theta: Number) -> Required:
    """Return the least feasible Re 1/Z_c in any passive hand on an impedance display."""
    return _any_hand(case, theta).required(case.design.gains)


def model_curve(case: Case, omega: Number) -> Pair:
    """Return a curve that has the zeros of D and no pole to the right of the imaginary axis."""
    at, gains = device_response(case.design.device, omega, case.ops), case.design.gains
    D = loop_response(at, gains, case.ops).D_scaled
    if not case.ops.is_zero(gains.position):
        D = Pair(-D.im, D.re)
    return D if at.spring is None else D * Pair(at.spring.y_k, at.omega * at.spring.y_c)


def along_drive(case: Case, omega: Number) -> Number:
    """Return Re(D conj(e A H)) with e = 1 + y Z_2. It does not depend on K_p and is regular at omega = 0."""
    at, gains = device_response(case.design.device, omega, case.ops), case.design.gains
    drive, spring = at.drive, at.spring
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


def across_position(case: Case, theta: Number) -> tuple[Number, Number]:
    """Return Im(F conj P)/theta and |F_0|^2 |P|^2/theta^2 with P = dF/dK_p. Neither depends on K_p."""
    plant, ops = case.let_go(), case.ops
    velocity_loop = return_difference(plant, theta, ops, position=False)
    P, slope = return_difference(plant, theta, ops, position=True).position, difference_slope(theta, ops)
    F = velocity_loop.closed(case.design.gains) * slope
    return im_conj_product(F, P), (velocity_loop.open * slope).abs2() * P.abs2()


def sensitivity_sufficient_margin(case: Case, theta: Number) -> Number:
    """Return (limit Im(F conj P) - |F_0||P|)/theta. Where it is positive, |S| < limit for all K_p."""
    across, product2 = across_position(case, theta)
    return case.max_sensitivity * across - case.ops.sqrt(product2)


def _loop(case: Case, omega: Number) -> LoopResponse:
    return loop_response(device_response(case.design.device, omega, case.ops), case.design.gains, case.ops)


def _difference(case: Case, theta: Number) -> ReturnDifference:
    position = not case.ops.is_zero(case.design.gains.position)
    return return_difference(case.let_go(), theta, case.ops, position=position)


def _any_hand(case: Case, theta: Number) -> AnyHand:
    delays = case.delays
    return any_hand(case.design.device, delays.loop, theta, case.ops, fractional=delays.loop_fractional)


def _room(case: Case, required: Required, theta: Number) -> Number:
    return room(case.design.coupling, case.design.device, required, case.factor, theta, case.ops)


def _met(case: Case) -> WorldsMet:
    assert case.met is not None
    return case.met


def _met_by_environment(case: Case, theta: Number) -> tuple[ZOffered, ZSeen]:
    """Return the impedances that an environment meets: of the coupling and of the loop."""
    seen = seen_in_hand(loop_in_hand(case.held(), theta, case.ops), case.design.gains)
    return _offered(case, theta), seen


def _offered(case: Case, theta: Number) -> ZOffered:
    device = case.design.device
    return offered_at(case.design.series, device.sample_time, device.rule, theta, case.ops)


def _next_to_rest(case: Case, theta: Number) -> tuple[PlantInHand, NextToRest]:
    """Return the plant, and the sum rho with its shares, which are rows of the boxes (model/README.md, section 14)."""
    plant, v = case.held(), case.values
    assert isinstance(plant, PlantInHand)  # only a velocity loop has K_p
    integrator, others = v[RHO_SHARES[0]], 1 - v[RHO_SHARES[0]]
    stiffness = case.hand.stiffness + case.design.gains.position
    stiffness = stiffness * (plant.sample_time * plant.sample_time / plant.mass)
    turned, spring = others * (1 - v[RHO_SHARES[1]]), others * v[RHO_SHARES[1]]
    return plant, NextToRest(2 * case.ops.sin(theta / 2) + stiffness, turned, spring, integrator)


def _seen_at_rest(case: Case, theta: Number) -> ZSeen:
    plant, rest = _next_to_rest(case, theta)
    return seen_in_limp_hand(plant, case.design.gains.velocity, theta, rest, case.ops)


def _turned(poles: int, theta: Number, ops: Arithmetic) -> Pair:
    return Pair(ops.cos(theta * (poles / 2)), -ops.sin(theta * (poles / 2)))


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
