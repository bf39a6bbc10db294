"""Llewellyn's conditions next to omega = 0 and towards infinity, where ratio is 0/0 or its terms grow (DESIGN 1.6)."""

from __future__ import annotations

from collections.abc import Callable

from flint import arb

from vctune.model.limits import EndLimit, high_frequency_limit, low_frequency_limit
from vctune.model.loop import hold_response, loop_response
from vctune.model.pair import re_conj_product
from vctune.model.quantities import Coupling, Device, Gains
from vctune.proof.balls import BALLS, box, coupling_ball, device_ball, gains_ball
from vctune.proof.interval import Verdict, prove_boxes

SHRINK = 4.0
STEPS = 120
END_BOXES = 64


def low_end_verdict(device: Device, gains: Gains, coupling: Coupling) -> Verdict:
    """Compare the exact limits of Re Z_c and R for omega -> 0; undecided where they are equal."""
    exact, law = device_ball(device), gains_ball(gains)
    return _compare(low_frequency_limit(exact, law, coupling_ball(coupling), integrator=gains.position > 0))


def high_end_verdict(device: Device, gains: Gains, coupling: Coupling) -> Verdict:
    """Compare the exact limits of Re Z_c and R for omega -> inf (hold "lag", no delay)."""
    if device.damping == 0:
        return Verdict.REFUTED if gains.velocity > 0 else Verdict.UNDECIDED
    return _compare(high_frequency_limit(device_ball(device), gains_ball(gains), coupling_ball(coupling)))


def _compare(limit: EndLimit) -> Verdict:
    if limit.coupling < limit.required:
        return Verdict.REFUTED
    return Verdict.PROVED if limit.coupling > limit.required else Verdict.UNDECIDED


def prove_low_end(device: Device, gains: Gains, coupling: Coupling, factor: float, below: float) -> float | None:
    """Return an omega_0 <= below such that Re G_hh > 0 and Re Z_c >= factor R on (0, omega_0], or None.

    Both sides of 2 Re D Re Z_c >= factor N are divided by omega^2 where they vanish together, so that a box that
    contains 0 can be evaluated. N is `modulus_excess`.
    """
    exact, law, virtual = device_ball(device), gains_ball(gains), coupling_ball(coupling)
    integrator, threshold = gains.position > 0, arb(repr(factor))
    if gains.velocity == 0 and not integrator:  # no loop, R = 0
        return below if device.damping > 0 else None

    def holds(omega: arb) -> bool:
        hold = hold_response(exact, omega, BALLS)
        loop = loop_response(exact, law, omega, hold, integrator=integrator)
        weight = (loop.C.abs2() * loop.D.abs2()).sqrt() + re_conj_product(loop.C, loop.D)
        if coupling.drag > 0:
            return bool(loop.re_D > 0 and 2 * loop.re_D * virtual.drag * weight > threshold * loop.turn * loop.turn)
        if integrator and device.damping > 0:
            return False
        lever = virtual.damping * virtual.damping + (virtual.mass * omega) * (virtual.mass * omega)
        coupling_slope = virtual.damping * virtual.mass * virtual.mass / lever
        re_C = loop.re_D - exact.damping
        turn = exact.mass * omega * re_C if integrator else exact.damping * law.velocity * hold.im + exact.mass * re_C
        return bool(loop.re_D > 0 and 2 * loop.re_D * coupling_slope * weight > threshold * turn * turn)

    return _largest(holds, below)


def prove_high_end(device: Device, gains: Gains, coupling: Coupling, factor: float, above: float) -> float | None:
    """Return an omega_1 >= above such that the conditions hold on [omega_1, inf), hold "lag", no delay; or None.

    Everything is written in v = 1/omega, in which omega C, D/omega and Re Z_c are smooth at v = 0.
    """
    exact, law, virtual = device_ball(device), gains_ball(gains), coupling_ball(coupling)
    half, threshold = exact.sample_time / 2, arb(repr(factor))

    def holds(v: arb) -> bool:
        decay = 1 / (v * v + half * half)
        re_C_over_v = (law.velocity - law.position * half) * decay * v
        omega_im_C = -(law.velocity * half + law.position * v * v) * decay
        re_D = exact.damping + re_C_over_v * v
        im_D_v = exact.mass + omega_im_C * v * v
        product = (re_C_over_v * re_C_over_v + omega_im_C * omega_im_C) * (re_D * v * re_D * v + im_D_v * im_D_v)
        excess = product.sqrt() - (re_C_over_v * v * re_D + omega_im_C * im_D_v)
        mass2 = virtual.mass * virtual.mass
        damping_v = virtual.damping * v
        re_Z_c = virtual.drag + virtual.damping * mass2 / (damping_v * damping_v + mass2)
        return bool(re_D > 0 and 2 * re_D * re_Z_c > threshold * excess)

    edge = _largest(holds, 1 / above)
    return None if edge is None else 1 / edge


def _largest(holds: Callable[[arb], bool], start: float) -> float | None:
    """Return the greatest start, start/4, start/16, ... such that `holds` is proved from 0 to there."""

    def decide(low: float, high: float) -> Verdict:
        return Verdict.PROVED if holds(box(low, high)) else Verdict.UNDECIDED

    edge = start
    for _ in range(STEPS):
        if prove_boxes(decide, 0.0, edge, END_BOXES).verdict is Verdict.PROVED:
            return edge
        edge /= SHRINK
    return None
