"""The margins of the claims: functions that must be positive, each written once for every arithmetic.

In sampled loops, s = sin(theta/2) and z = e^{j theta}. model/README.md defines C, D, N, Z_2, y and A H in sections 2
and 12, F and F_0 in section 7, and rho in section 14. A limp hand has no stiffness. With K_p = 0, F in a limp hand
vanishes next to rest unless the code divides it by rho.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, nextafter, pi

from vctune.model.coupling import coupling_impedance
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Coupling, Gains, SpringDamper
from vctune.model.loop.affine import loop_constants
from vctune.model.loop.device_response import DeviceResponse, device_response
from vctune.model.loop.llewellyn import llewellyn_demand, moduli
from vctune.model.loop.loop import loop_response
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.pair import Pair, im_conj_product, re_conj_product
from vctune.model.sampled.any_hand import any_hand
from vctune.model.sampled.hand_loop import (
    CommandInHand,
    NextToRest,
    loop_in_hand,
    offered_at_spring,
    required_in_hand,
    required_in_limp_hand,
    room,
    seen_by_tool,
    seen_in_hand,
    seen_in_limp_hand,
)
from vctune.model.sampled.impedance_display import ForceInHand, Required
from vctune.model.sampled.let_go import Plant, return_difference
from vctune.model.sampled.plant_in_hand import AnyPlantInHand, PlantInHand, ServoInHand
from vctune.model.sampled.velocity_loop import difference_slope
from vctune.model.sampled.worlds.loop_in_late_worlds import half_planes
from vctune.model.sampled.worlds.loop_in_walls import Strip, strip_in_walls
from vctune.model.sampled.worlds.loop_in_worlds import (
    UNCOUPLED,
    Disjuncts,
    Offered,
    Seen,
    disjuncts,
    limp_disjuncts,
    offered_at,
    sum_of,
)
from vctune.model.worlds import Worlds, WorldsMet

HALF_TURN = nextafter(pi, inf)
"""theta = omega T at the Nyquist frequency, rounded upwards. The curve of the sampled loop is symmetric about it."""


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

    @property
    def series(self) -> Coupling:
        """The coupling of an admittance display or a servo: damping and mass in series with a drag in parallel."""
        assert isinstance(self.coupling, Coupling)
        return self.coupling


def conditions_margin(design: Design, omega: Number, factor: Number, ops: Arithmetic) -> Number:
    """Return 2 r (Re Z_c - factor R) at omega > 0, where r is the loop's resistance (model/README.md, section 4).

    Where this margin and r are positive, Re Z_c >= factor R. Without an operator the margin is 2 r Re Z_c - factor
    (|C||D| - Re(C conj D)), which is positive only if r > 0. For an ideal device in a hand the margin is 2 r Re Z_c +
    factor (2 b_h Re C - ...). Re C <= 0 where r <= 0, so the margin is again positive only if r > 0. For any other
    device in a hand, r > 0 needs a separate proof (`resistance_apart`).

    Parameters
    ----------
    design : device, gains and coupling in numbers of the arithmetic
    omega : angular frequency, rad/s, > 0
    factor : least permitted Re Z_c / R
    ops : arithmetic of the other arguments

    Returns
    -------
    Number
        (N s/m)^2. It has the shape of omega.
    """
    loop = loop_response(device_response(design.device, omega, ops), design.gains, ops)
    return 2 * loop.resistance * coupling_impedance(design.series, omega).re - factor * llewellyn_demand(loop, ops)


def clamped_margin(design: Design, omega: Number, radius: Number, ops: Arithmetic) -> Number:
    """Return |N|^2 - r^2 |N - N_0|^2 at omega > 0. Where it is positive, N is not 0 for any response within the disc.

    N_0 is N with both gains 0 (model/README.md, section 13).

    Parameters
    ----------
    design : device, gains and coupling in numbers of the arithmetic
    omega : angular frequency, rad/s, > 0
    radius : radius r of the disc at omega, dimensionless
    ops : arithmetic of the other arguments

    Returns
    -------
    Number
        Dimensionless. It has the shape of omega.
    """
    numerator = loop_constants(device_response(design.device.modelled, omega, ops)).numerator
    return numerator.closed(design.gains).abs2() - radius * radius * numerator.driven(design.gains).abs2()


def low_margin(design: Design, omega: Number, factor: Number, ops: Arithmetic) -> Number:
    """Return a margin that is regular at omega = 0. Where it is positive, `conditions_margin` is positive.

    Where both sides of 2 r Re Z_c >= factor times `llewellyn_demand` vanish, the function divides them by their common
    power of omega. For a coupling with drag, or with an operator that relaxes the constraint, the margin uses only
    Re Z_c >= b_0. In all other cases with K_p > 0 and b + tau_s K_p > 0 (tau_s: lag of the force sensor), R does not
    vanish, and no margin is positive.

    Parameters
    ----------
    design : device, gains and coupling in numbers of the arithmetic
    omega : angular frequency, rad/s, >= 0
    factor : least permitted Re Z_c / R
    ops : arithmetic of the other arguments

    Returns
    -------
    Number
        Only its sign has a meaning. It has the shape of omega.
    """
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
    """Return `conditions_margin` at omega = 1/v, for an ideal device with hold "lag" and no delay.

    The margin is smooth at v = 0.

    Parameters
    ----------
    design : device, gains and coupling in numbers of the arithmetic
    v : 1/omega, s/rad, >= 0
    factor : least permitted Re Z_c / R
    ops : arithmetic of the other arguments

    Returns
    -------
    Number
        (N s/m)^2. It has the shape of v.
    """
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
    mass2, damping_v = coupling.mass * coupling.mass, coupling.damping * v
    re_Z_c = coupling.drag + coupling.damping * mass2 / (damping_v * damping_v + mass2)
    if device.operator is None:
        return 2 * re_D * re_Z_c - factor * excess
    b_h = device.operator.damping
    return 2 * (re_D + b_h) * re_Z_c + factor * (2 * b_h * re_C - excess)


def sensitivity_margin(plant: Plant, gains: Gains, theta: Number, limit: Number, ops: Arithmetic) -> Number:
    """Return limit^2 |F|^2 - |F_0|^2 of the sampled loop. It is positive where |S| = |F_0/F| < limit.

    See model/README.md, section 7.

    Parameters
    ----------
    plant : a device without a hand, over one sample
    gains : K_v and K_p, N s/m and N/m
    theta : omega T, rad, in [0, pi]
    limit : greatest permitted |S|
    ops : arithmetic of the other arguments

    Returns
    -------
    Number
        Dimensionless. It has the shape of theta.
    """
    parts = return_difference(plant, theta, ops, position=not ops.is_zero(gains.position))
    return limit * limit * parts.closed(gains).abs2() - parts.open.abs2()


def unmodelled_margin(plant: Plant, gains: Gains, theta: Number, radius: Number, ops: Arithmetic) -> Number:
    """Return |F|^2 - radius^2 |F - F_0|^2. It is positive where |1 - S| radius < 1 (model/README.md, section 13).

    Where |1 - S| radius < 1 at every theta, the small-gain theorem applies: no response in the disc of this radius
    around the modelled response makes a stable loop unstable.

    Parameters
    ----------
    plant : a device without a hand, over one sample
    gains : K_v and K_p, N s/m and N/m
    theta : omega T, rad, in [0, pi]
    radius : greatest |delta| at theta, dimensionless
    ops : arithmetic of the other arguments

    Returns
    -------
    Number
        Dimensionless. It has the shape of theta.
    """
    parts = return_difference(plant, theta, ops, position=not ops.is_zero(gains.position))
    loop = parts.velocity.scaled(gains.velocity) + parts.position.scaled(gains.position)
    return (parts.open + loop).abs2() - radius * radius * loop.abs2()


def loop_gain_margin(plant: Plant, gains: Gains, theta: Number, limit: Number, ops: Arithmetic) -> Number:
    """Return limit^2 |F_0|^2 - |F - F_0|^2. Where it is positive, |L| < limit and |S| < 1/(1 - limit) for any phase.

    Whole samples of delay rotate F - F_0 and do not change its magnitude.

    Parameters
    ----------
    plant : a device without a hand, over one sample
    gains : K_v and K_p, N s/m and N/m
    theta : omega T, rad, in [0, pi]
    limit : greatest permitted |L|, at most 1
    ops : arithmetic of the other arguments

    Returns
    -------
    Number
        Dimensionless. It has the shape of theta.
    """
    parts = return_difference(plant, theta, ops, position=not ops.is_zero(gains.position))
    loop = parts.velocity.scaled(gains.velocity) + parts.position.scaled(gains.position)
    return limit * limit * parts.open.abs2() - loop.abs2()


def hand_margin(plant: AnyPlantInHand, design: Design, theta: Number, factor: Number, ops: Arithmetic) -> Number:
    """Return |F|^2 (Re Z_c - factor R) in a hand (model/README.md, section 14).

    Where the margin is positive, F is not 0, so that no pole of the loop in the hand lies on the unit circle at theta.
    For an impedance display the margin is |F|^2 (Re 1/Z_c - factor R)/s^2 times a positive number (section 15).

    Parameters
    ----------
    plant : the device in the hand, over one sample
    design : device, gains and coupling in numbers of the arithmetic
    theta : omega T, rad, in [0, pi]
    factor : least permitted Re Z_c / R
    ops : arithmetic of the other arguments

    Returns
    -------
    Number
        N s/m, with the shape of theta. For an impedance display only the sign has a meaning.
    """
    required = required_in_hand(loop_in_hand(plant, theta, ops), design.gains)
    return room(design.coupling, design.device, required, factor, theta, ops)


def whenever_margin(plant: ServoInHand, design: Design, theta: Number, factor: Number, ops: Arithmetic) -> Number:
    """Return 2 s (Re Z_c - factor |Z_seen|), s = sin(theta/2), for a servo with any number of whole samples of delay.

    If there is a disc around Z_seen, the margin includes it. Where the margin is positive, so is `hand_margin`.

    Parameters
    ----------
    plant : the servo in the hand, over one sample, with any number of whole samples of delay
    design : device, gains and coupling in numbers of the arithmetic
    theta : omega T, rad, in (0, pi]
    factor : least permitted Re Z_c / R
    ops : arithmetic of the other arguments

    Returns
    -------
    Number
        N s/m. It has the shape of theta.
    """
    turned = replace(plant, plant=replace(plant.plant, turns=0.0))
    loop, twice = loop_in_hand(turned, theta, ops), 2 * ops.sin(theta / 2)
    assert isinstance(loop, CommandInHand)
    around = ops.modulus(loop.seen.even, 0.5 * (twice * loop.seen.odd))
    rest = room(design.coupling, design.device, Required(loop.blur, 1), factor, theta, ops)
    return twice * rest - factor * around


def limp_hand_margin(
    plant: PlantInHand, design: Design, theta: Number, rest: NextToRest, factor: Number, ops: Arithmetic
) -> Number:
    """Return `hand_margin` divided by rho^2, for theta near 0, a hand without stiffness and K_p = 0.

    Parameters
    ----------
    plant : the device in the hand, over one sample
    design : design in numbers of the arithmetic
    theta : omega T, rad, in [0, pi]
    rest : shares of rho (`NextToRest`); if the divided margin is positive for all shares, so is `hand_margin`
    factor : least permitted Re Z_c / R
    ops : arithmetic of the other arguments

    Returns
    -------
    Number
        N s/m. It has the shape of theta.
    """
    required = required_in_limp_hand(plant, design.gains.velocity, theta, rest, ops)
    return room(design.coupling, design.device, required, factor, theta, ops)


def margins_in_worlds(
    plant: AnyPlantInHand, design: Design, theta: Number, met: WorldsMet, ops: Arithmetic, share: Number = 1.0
) -> Disjuncts:
    """Return the margins in a hand with a box of environments, each as the terms of its sum. At least one margin must
    be positive.

    Parameters
    ----------
    plant : the device in the hand
    design : design in numbers of the arithmetic
    theta : omega T, rad, in [0, pi]
    met : the environments that the loop meets, and the factor, in numbers of the arithmetic
    ops : arithmetic of the other arguments
    share : share of an impedance display's coupling admittance, from 1/factor to 1; each share has its own margins
    """
    offered, seen, share = met_by_environment(plant, design, theta, share, ops)
    factor = 1 if isinstance(design.coupling, SpringDamper) else met.factor
    return disjuncts(offered, met.worlds, design.device.sample_time, seen, factor, theta, ops)


def met_by_environment(
    plant: AnyPlantInHand, design: Design, theta: Number, share: Number, ops: Arithmetic
) -> tuple[Offered, Seen, Number]:
    """Return the impedances that an environment meets, of the coupling and of the loop, and the coupling's share.

    The coupling of an impedance display is a part of its loop (model/README.md, section 18).

    Parameters
    ----------
    plant : the device in the hand
    design : design in numbers of the arithmetic
    theta : omega T, rad, in [0, pi]
    share : share y of the coupling, from 1/safety_factor to 1
    ops : arithmetic of the other arguments
    """
    loop, coupling = loop_in_hand(plant, theta, ops), design.coupling
    if isinstance(coupling, SpringDamper) and isinstance(loop, ForceInHand):
        at = offered_at_spring(coupling, design.device, theta, ops)
        return UNCOUPLED, seen_by_tool(loop, design.gains, at, share).whole, 1
    offered = offered_at(design.series, design.device.sample_time, theta, ops)
    return offered, seen_in_hand(loop, design.gains), share


def limp_margins_in_worlds(
    plant: PlantInHand, design: Design, theta: Number, rest: NextToRest, met: WorldsMet, ops: Arithmetic
) -> Disjuncts:
    """Return `margins_in_worlds` divided by rho^2, for K_p = 0, theta near 0 and a hand without stiffness.

    Parameters
    ----------
    plant, design, theta, rest, ops : see `limp_hand_margin`
    met : see `margins_in_worlds`
    """
    seen, T = seen_in_limp_hand(plant, design.gains.velocity, theta, rest, ops), design.device.sample_time
    return limp_disjuncts(offered_at(design.series, T, theta, ops), met.worlds, T, seen, met.factor, theta, ops)


def margins_in_late_worlds(
    plant: AnyPlantInHand,
    design: Design,
    theta: Number,
    share: Number,
    worlds: Worlds,
    names: Sequence[str],
    ops: Arithmetic,
) -> tuple[Number, ...]:
    """Return margins in a hand with every environment of a box that may run late or by Euler's rules.

    At least one of these margins must be positive.

    See model/README.md, section 20.

    Parameters
    ----------
    plant : the device in the hand
    design : design in numbers of the arithmetic
    theta : omega T, rad, in [0, pi]
    share : share of the coupling, from 1/safety_factor to 1
    worlds : the box of environments, in numbers of the arithmetic
    names : names of the sides of the box's polygon
    ops : arithmetic of all other arguments
    """
    return _beyond(*met_by_environment(plant, design, theta, share, ops), design, theta, worlds, names, ops)


def limp_margins_in_late_worlds(
    plant: PlantInHand,
    design: Design,
    theta: Number,
    rest: NextToRest,
    share: Number,
    worlds: Worlds,
    names: Sequence[str],
    ops: Arithmetic,
) -> tuple[Number, ...]:
    """Return `margins_in_late_worlds` divided by rho^2, for K_p = 0, theta near 0 and a hand without stiffness.

    Parameters
    ----------
    plant, design, theta, rest, ops : see `limp_hand_margin`
    share, worlds, names : see `margins_in_late_worlds`
    """
    seen = seen_in_limp_hand(plant, design.gains.velocity, theta, rest, ops)
    whole = Seen(seen.lost, ops.sin(theta / 2) * seen.swing, seen.size)
    offered = offered_at(design.series, design.device.sample_time, theta, ops)
    return _beyond(offered, whole, share, design, theta, worlds, names, ops)


def _beyond(
    offered: Offered,
    seen: Seen,
    share: Number,
    design: Design,
    theta: Number,
    worlds: Worlds,
    names: Sequence[str],
    ops: Arithmetic,
) -> tuple[Number, ...]:
    """Return the distance of a loop beyond each side of the polygon of environments, in the order of `names`."""
    planes = half_planes(worlds, names, design.device.sample_time, theta, ops, rigid=design.coupling.rigid)
    return tuple(sum_of(planes[name].terms(offered, seen, share)) for name in names)


def strip_of_walls(
    plant: AnyPlantInHand, design: Design, theta: Number, share: Number, met: WorldsMet, ops: Arithmetic
) -> Strip:
    """Return the ranges over which the condition of walls must hold in a hand, for one share of the coupling.

    See model/README.md, section 19.

    Parameters
    ----------
    plant : the device in the hand
    design : design in numbers of the arithmetic
    theta : omega T, rad, in [0, pi]
    share : share of the coupling, from 1/safety_factor to 1
    met : the environments, with the corner, in numbers of the arithmetic
    ops : arithmetic of the other arguments
    """
    offered, seen, share = met_by_environment(plant, design, theta, share, ops)
    return strip_in_walls(offered, met.worlds, design.device.sample_time, seen, share, theta, ops)


def limp_strip_of_walls(
    plant: PlantInHand, design: Design, theta: Number, rest: NextToRest, share: Number, met: WorldsMet, ops: Arithmetic
) -> Strip:
    """Return `strip_of_walls` divided by rho^2, for K_p = 0, theta near 0 and a hand without stiffness.

    Parameters
    ----------
    plant, design, theta, rest, ops : see `limp_hand_margin`
    share, met : see `strip_of_walls`
    """
    seen, T = seen_in_limp_hand(plant, design.gains.velocity, theta, rest, ops), design.device.sample_time
    whole = Seen(seen.lost, ops.sin(theta / 2) * seen.swing, seen.size)
    return strip_in_walls(offered_at(design.series, T, theta, ops), met.worlds, T, whole, share, theta, ops)


def any_hand_margin(
    design: Design, delay: LoopDelay, theta: Number, factor: Number, ops: Arithmetic
) -> tuple[Number, Number]:
    """Return two margins for an impedance display in any passive hand. Both must be positive.

    The first margin is size (Re 1/Z_c - factor R)/s^2 times a positive number. The second is size, which is positive if
    the loop of K_v alone is stable in every passive hand (model/README.md, section 15).

    Parameters
    ----------
    design : design of an impedance display, in numbers of the arithmetic
    delay : whole samples of the device's delay
    theta : omega T, rad, in [0, pi]
    factor : least permitted Re(1/Z_c)/R
    ops : arithmetic of the other arguments

    Returns
    -------
    margin, size : arrays with the shape of theta
    """
    hand = any_hand(design.device, delay.whole_samples, theta, ops, fractional=delay.fractional)
    required = hand.required(design.gains)
    return room(design.coupling, design.device, required, factor, theta, ops), required.size


def hand_curve(
    plant: AnyPlantInHand, gains: Gains, theta: Number, ops: Arithmetic, held: SpringDamper | None = None
) -> Pair:
    """Return F of the loop in a hand, rotated to be real at both ends. The curve of a stable loop makes no turn around
    0.

    Parameters
    ----------
    plant : the device in the hand, over one sample
    gains : K_v and K_p, N s/m and N/m
    theta : omega T, rad, in [0, pi]
    ops : arithmetic of the other arguments
    held : coupling of an impedance display whose virtual tool is held; None for a free tool

    Returns
    -------
    Pair
        Dimensionless. It has the shape of theta.
    """
    loop, sine, half_poles = loop_in_hand(plant, theta, ops), ops.sin(theta / 2), plant.poles / 2
    F = loop.clamped(gains, held) if held is not None and isinstance(loop, ForceInHand) else loop.closed(gains)
    turned = Pair(ops.cos(theta * half_poles), -ops.sin(theta * half_poles))
    return Pair(F.even, sine * F.odd) * turned


def resistance_apart(device: Device) -> bool:
    """Return whether the loop's resistance needs a proof of its own, besides `conditions_margin`."""
    return device.operator is not None and not device.ideal


def resistance_margin(design: Design, omega: Number, ops: Arithmetic) -> Number:
    """Return the loop's resistance in the hand of the least operator; without an operator it is |D|^2 Re G_hh.

    Parameters
    ----------
    design : design; only its device and its gains matter
    omega : angular frequency, rad/s, >= 0
    ops : arithmetic of the other arguments

    Returns
    -------
    Number
        N s/m. It has the shape of omega.
    """
    return loop_response(device_response(design.device, omega, ops), design.gains, ops).resistance


def model_curve(at: DeviceResponse, gains: Gains, ops: Arithmetic) -> Pair:
    """Return a curve that has the zeros of D and no pole to the right of the imaginary axis.

    The curve is D, or j omega D with an integrator. For a handle on a spring, the curve also has the factor
    (k + j omega c) and a positive factor. The curve is real and positive at omega = 0.

    Parameters
    ----------
    at : the device at omega >= 0
    gains : K_v and K_p in numbers of the arithmetic
    ops : arithmetic of the other arguments

    Returns
    -------
    Pair
        Only its argument has a meaning. It has the shape of omega.
    """
    D = loop_response(at, gains, ops).D_scaled
    if not ops.is_zero(gains.position):
        D = Pair(-D.im, D.re)
    return D if at.spring is None else D * Pair(at.spring.y_k, at.omega * at.spring.y_c)


def along_drive(at: DeviceResponse, gains: Gains) -> Number:
    """Return Re(D conj(e A H)) with e = 1 + y Z_2. It does not depend on K_p and is regular at omega = 0.

    The integrator's term e K_p A H/(j omega) is perpendicular to e A H. If Re(D conj(e A H)) > 0, D is therefore not 0
    for any K_p. With D = e W + Z_2 the result is |e|^2 Re(W conj(A H)) + Re(Z_2 conj(e A H)).

    Parameters
    ----------
    at : the device at omega >= 0
    gains : gains; only K_v matters, N s/m

    Returns
    -------
    Number
        N s/m. It has the shape of omega.
    """
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


def across_position(plant: Plant, gains: Gains, theta: Number, ops: Arithmetic) -> tuple[Number, Number]:
    """Return Im(F conj P)/theta and |F_0|^2 |P|^2/theta^2 with P = dF/dK_p. Neither depends on K_p.

    For F and F_0, the function uses the velocity loop alone, times 1 - e^{-j theta}. Both results are regular at
    theta = 0. Where the first result is not 0, F is not 0 for any K_p.

    Parameters
    ----------
    plant : a device without a hand, over one sample
    gains : gains; only K_v matters, N s/m
    theta : omega T, rad, in [0, pi]
    ops : arithmetic of the other arguments

    Returns
    -------
    across, product2 : m/N and (m/N)^2, each with the shape of theta
    """
    velocity_loop = return_difference(plant, theta, ops, position=False)
    P, slope = return_difference(plant, theta, ops, position=True).position, difference_slope(theta, ops)
    F = velocity_loop.closed(gains) * slope
    return im_conj_product(F, P), (velocity_loop.open * slope).abs2() * P.abs2()


def sensitivity_sufficient_margin(plant: Plant, gains: Gains, theta: Number, limit: Number, ops: Arithmetic) -> Number:
    """Return (limit Im(F conj P) - |F_0||P|)/theta. Where it is positive, |S| < limit for all K_p.

    Parameters
    ----------
    plant : a device without a hand, over one sample
    gains : gains; only K_v matters, N s/m
    theta : omega T, rad, in [0, pi]
    limit : greatest permitted |S|
    ops : arithmetic of the other arguments

    Returns
    -------
    Number
        m/N. It has the shape of theta.
    """
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
