"""The constants of a device at each frequency, from which the page's script computes responses for any gains."""

from __future__ import annotations

from base64 import b64encode
from math import inf, pi
from typing import Any

import numpy as np

from vctune.analysis.demands import response
from vctune.analysis.extrema import Floats
from vctune.analysis.resonance import with_resonance
from vctune.analysis.sampled_loop import Complex, return_difference_at
from vctune.document.records.design_json import DesignRecord
from vctune.model.device import Device
from vctune.model.gains import Gains, SpringDamper
from vctune.model.hand_arrays import stacked
from vctune.model.hands import Hand
from vctune.model.loop.affine import Affine, LoopConstants, loop_constants
from vctune.model.loop.device_response import device_response
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.pair import EvenOdd, Pair
from vctune.model.problem import Problem
from vctune.model.sampled.any_hand import any_hand
from vctune.model.sampled.hand_loop import LoopInHand, loop_in_hand, required_in_hand
from vctune.model.sampled.impedance_display import firmware_filter, spring_damper_admittance, spring_forms
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand
from vctune.model.transparency import log_quadrature
from vctune.report.figures.curves import frequencies

INTERVALS = 8  # Number of intervals of the transparency band with Gauss's nodes in each
CURVE_POINTS = 100  # Least number of frequencies of the curves in addition to the nodes
# Number of angles of the sampled loop up to Nyquist, and number of additional angles for each sample of delay and for
# four more samples
LOOP_ANGLES, PER_SAMPLE = 120, 16
HAND_ANGLES, LOWEST = 128, 1e-3  # Number of angles of the grid in each hand, and its smallest angle, rad


def frequency_model(problem: Problem, record: DesignRecord) -> dict[str, Any]:
    """Return the constants of the frequency model, and the weights of the error's quadrature."""
    band, axis = problem.transparency.band, frequencies(problem)
    nodes, weights = log_quadrature(band.min, band.max, INTERVALS)
    places = [2 * pi * axis[:: max(1, axis.size // CURVE_POINTS)], [band.min, band.max]]
    proof, edges = record.certificate, problem.stability.band
    places.append([edge for edge in (edges.min, edges.max) if 0 < edge < inf])
    if proof is not None and proof.worst_hz and proof.worst_hz > 0:
        places.append([2 * pi * proof.worst_hz])
    omega = np.unique(np.concatenate([nodes, *places]))
    share = np.zeros(omega.size)
    share[np.searchsorted(omega, nodes)] = weights
    at = device_response(problem.device.modelled, omega, FLOATS)
    known = loop_constants(at)
    nodes_of = {"hz": _numbers(omega / (2 * pi)), "weight": _numbers(share)}
    if problem.device.kind.inverse:
        return nodes_of | _force_model(problem.device, known, omega)
    if not problem.device.kind.own_loop:
        loop = response(problem.device, Gains(0.0, 0.0), omega)
        return nodes_of | {"C": _pair(loop.C_scaled, omega), "miss": _pair(loop.miss_scaled, omega)}
    sensor_im = None if at.sensor is None else -omega * at.sensor.lag
    return {
        **nodes_of,
        "controller": _affine(known.controller, omega),
        "C": None if sensor_im is None else _affine(known.C, omega),
        "sensor_im": None if sensor_im is None else _numbers(sensor_im),
        "D": _affine(known.D, omega),
        "miss": _affine(known.miss, omega),
        "numerator": None if problem.device.structure is None else _affine(known.numerator, omega),
    }


def _force_model(device: Device, known: LoopConstants, omega: Floats) -> dict[str, Any]:
    """Return the constants of an impedance display. Its factors of k_c replace the factors of K_p of an admittance
    display."""
    theta = omega * device.sample_time
    low_pass, drive = firmware_filter(device, theta, FLOATS), known.controller.velocity
    damper, spring = (
        1 / _complex(spring_damper_admittance(SpringDamper(*one), device.sample_time, low_pass, theta, FLOATS))
        for one in ((1.0, 0.0), (0.0, 1.0))
    )

    def at_rigid_wall(number: Affine) -> Affine:
        if number.velocity is None:
            return number
        stiff = _complex(number.velocity) * spring / damper
        return Affine(number.constant, number.velocity, Pair(stiff.real, stiff.imag))

    assert drive is not None
    coupling = Affine(None, Pair(damper.real, damper.imag), Pair(spring.real, spring.imag))
    return {
        "drive": _pair(drive, omega),
        "coupling": _affine(coupling, omega),
        "D": _affine(at_rigid_wall(known.D), omega),
        "numerator": _affine(at_rigid_wall(known.numerator), omega),
    }


def _complex(pair: Pair) -> Complex:
    return np.asarray(pair.re + 1j * pair.im)


def sampled_loop(device: Device, record: DesignRecord) -> dict[str, Any] | None:
    """Return the parts of the sampled loop's return difference; None for a servo, which has no loop of its own."""
    if not device.kind.own_loop:
        return None
    theta, loop = np.geomspace(1e-5 * pi, pi, LOOP_ANGLES), record.inner_loop
    spaced = int(PER_SAMPLE * (4 + device.delay / device.sample_time))
    theta = np.union1d(theta, np.linspace(0.0, pi, spaced + 1)[1:])
    if loop is not None and loop.peak_sensitivity_hz:
        theta = np.union1d(theta, min(2 * pi * loop.peak_sensitivity_hz * device.sample_time, pi))
    if device.structure is not None:
        theta = np.union1d(
            theta, np.minimum(with_resonance(device, theta / device.sample_time) * device.sample_time, pi)
        )
    parts = return_difference_at(device.bare.modelled, theta / device.sample_time, position=True)
    return {
        "theta": _numbers(theta),
        **{name: _pair(getattr(parts, name), theta) for name in ("open", "velocity", "position")},
    }


def in_hands(device: Device, met: list[Hand | None], worst: list[float]) -> dict[str, Any]:
    """Return the parts of the loop in each of several hands, at angles up to Nyquist and at the worst frequencies."""
    theta = np.geomspace(LOWEST, pi, HAND_ANGLES)
    theta = np.unique(np.concatenate([[0.0], theta, [min(each * device.sample_time, pi) for each in worst]]))
    delays = delays_of(device)
    if device.kind.inverse:
        # at 0, the return difference in a hand without stiffness is 0; at the next angle R has reached its limit
        theta = theta[theta > 0]
        offered = [of + 0 * theta for form in spring_forms(device, theta, FLOATS) for of in form]
        required = [_required(device, hand, theta) for hand in met]
        return {"theta": _numbers(theta), "offered": _numbers(np.stack(offered, axis=-1)), "required": required}
    hands = [hand for hand in met if hand is not None]
    loop = loop_in_hand(plant_in_hand(device, stacked(hands, (-1, 1)), delays, FLOATS), theta, FLOATS)
    if not device.kind.own_loop:
        asked = required_in_hand(loop, Gains(0.0, 0.0))
        return {"theta": _numbers(theta), "required": [_numbers(each) for each in asked.lost / asked.size]}
    assert isinstance(loop, LoopInHand), "of an admittance display"
    shape = (len(hands), theta.size)
    parts = {name: getattr(loop, name) for name in ("open", "velocity", "position")}
    parts["felt"] = _felt(loop, device.sample_time, theta)
    return {"theta": _numbers(theta), **{name: _even_odd(part, shape) for name, part in parts.items()}}


def _felt(loop: LoopInHand, sample_time: float, theta: Floats) -> EvenOdd:
    """Return the factor f in P = f (2 j s K_v + T c K_p), with s and c the sine and cosine of theta/2."""
    square, cos = np.sin(theta / 2) ** 2, np.cos(theta / 2)
    with np.errstate(all="ignore"):
        odd = np.where(
            square < 0.5, loop.seen_position.odd / (sample_time * cos), -loop.seen_velocity.even / (2 * square)
        )
    return EvenOdd(loop.seen_velocity.odd / 2, odd, square)


def _required(device: Device, hand: Hand | None, theta: Floats) -> str:
    """Return R/s^2 in a hand, or in any passive hand, as five coefficients at each angle."""
    delays, unit = delays_of(device), device.mass / device.sample_time

    def at(K_v: float) -> tuple[Floats, Floats]:
        gains = Gains(K_v, 0.0)
        if hand is None:
            found = any_hand(device, delays.loop, theta, FLOATS, fractional=delays.loop_fractional).required(gains)
        else:
            loop = loop_in_hand(plant_in_hand(device, hand, delays, FLOATS), theta, FLOATS)
            found = required_in_hand(loop, gains)
        return found.lost + 0 * theta, found.size + 0 * theta

    (lost, size), (lost_above, size_above), (_, size_below) = at(0.0), at(unit), at(-unit)
    slope, bend = (size_above - size_below) / (2 * unit), (size_above + size_below - 2 * size) / (2 * unit * unit)
    return _numbers(np.stack([lost, (lost_above - lost) / unit, size, slope, bend], axis=-1))


def numbered(constants: Any, numbers: dict[str, int]) -> Any:
    """Return constants in which each array, a text of `_numbers`, is replaced by its number."""
    if isinstance(constants, str):
        return numbers.setdefault(constants, len(numbers))
    if isinstance(constants, dict):
        return {key: numbered(each, numbers) for key, each in constants.items()}
    return [numbered(each, numbers) for each in constants] if isinstance(constants, list) else constants


def _affine(number: Affine, omega: Floats) -> dict[str, str | None]:
    parts = {"constant": number.constant, "velocity": number.velocity, "position": number.position}
    return {name: None if part is None else _pair(part, omega) for name, part in parts.items()}


def _pair(number: Pair, like: Floats) -> str:
    """Return the complex values of a number as text; real and imaginary parts alternate."""
    return _numbers(np.stack([number.re + 0 * like, number.im + 0 * like], axis=-1))


def _even_odd(number: EvenOdd, shape: tuple[int, int]) -> list[str]:
    """Return a text for each hand, in which the even and the odd parts at the angles alternate."""
    parts = np.stack([np.broadcast_to(part, shape) for part in (number.even, number.odd)], axis=-1)
    return [_numbers(each, 5) for each in parts]


def _numbers(values: Floats, size: int = 6) -> str:
    """Return the number of bytes for each double, and then the highest bytes of the rounded doubles, the least
    significant first, in base 64."""
    whole = np.ascontiguousarray(values, dtype="<f8").view("<u8").ravel() + np.uint64(1 << (63 - 8 * size))
    return f"{size}{b64encode(whole.astype('<u8').view('u1').reshape(-1, 8)[:, 8 - size :].tobytes()).decode()}"
