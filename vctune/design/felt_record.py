"""Record what the hand feels of a design, the latency of a servo, and the stiffest contact that its design permits."""

from __future__ import annotations

from dataclasses import asdict, replace
from math import floor, inf, log10, pi, prod
from typing import Any, Literal

import numpy as np

from vctune.analysis.contact import drag_at_rest, greatest_drag, stiffest_contact
from vctune.analysis.feel import FREE_HZ, NO_LOOP, WALL_HZ
from vctune.analysis.felt_impedance import impedance_felt
from vctune.design.judging.judge import Judgement, Status, certified
from vctune.document.records.felt_json import ContactRecord, InHandRecord, LatencyPartRecord
from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Coupling, Gains, SpringDamper
from vctune.model.hands import Hands
from vctune.model.loop.filters import force_sections
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.units import finite_hertz
from vctune.model.problem import Problem
from vctune.model.servo import latency, latency_parts
from vctune.model.worlds import World
from vctune.proof.outcome import Verdict
from vctune.simulation.controller import coupling_coefficients

CONTACT = "the stiffest contact"  # Name of a part that a time limit may leave out
RESERVE = 1e-3  # Relative distance between the stiffest contact in double precision and the contact that vctune proves
DIGITS = 4  # Number of significant digits of the stiffest contact


def contact_record(problem: Problem, judgement: Judgement) -> ContactRecord | None:
    """Return the latency of a servo, the drag that contacts require of it, and the stiffest contact of a design; None
    for other displays. Before environments of limited mass no drag is required, since a mass may take its place."""
    hands, worlds = problem.hands_met, problem.worlds
    if problem.device.servo is None or hands is None:
        return None
    devices = list(dict.fromkeys(case.device.modelled for case in judgement.posed.hand_cases))
    factor, K = problem.stability.safety_factor, hands.high.stiffness
    slowest = max(devices, key=_latency)
    parts = {name: seconds for name, seconds in asdict(latency(slowest, FLOATS)).items() if seconds > 0}
    bears = stiffest_contact(devices, hands, judgement.coupling, factor, worlds)
    stiffest, verdict = _stiffest(problem, judgement, hands, bears)
    drags: dict[str, Any] = {}
    if worlds is None or worlds.high.mass == inf:
        most = greatest_drag(devices, hands)
        drags = {
            "rest_drag": factor * drag_at_rest(devices, hands),
            "drag_alone": factor * most.drag,
            "drag_alone_hz": finite_hertz(most.omega),
            "drag_alone_hand": most.hand,
            "own_spring": factor * _own_spring(slowest),
        }
    return ContactRecord(
        stiffness=K,
        safety_factor=factor,
        parts=[
            LatencyPartRecord(
                part=part.label, key=part.key, latency_s=seconds, **({"drag": factor * K * seconds} if drags else {})
            )
            for part, seconds in ((latency_parts(slowest)[name], seconds) for name, seconds in parts.items())
        ],
        latency_s=_latency(slowest),
        stiffest_contact=stiffest,
        stiffest_contact_verdict=verdict,
        **drags,
    )


def _latency(device: Device) -> float:
    return float(latency(device, FLOATS).total)


def _own_spring(device: Device) -> float:
    """Return the drag at rest that the firmware's own spring requires: its stiffness times the latency, N s/m."""
    assert device.servo is not None
    return (device.servo.stiffness or 0.0) * _latency(device.sensing_at_once)


def _stiffest(
    problem: Problem, judgement: Judgement, hands: Hands, bears: float
) -> tuple[float | None, Literal["proved", "undecided"] | None]:
    """Return the stiffest contact, rounded, and whether it is proved; None if no contact is permitted."""
    if judgement.status is Status.CERTIFIED and (bears == inf or _floored(bears) <= hands.high.stiffness):
        return hands.high.stiffness, "proved"
    stiffest = _floored(bears)
    if bears == inf or stiffest <= hands.low.stiffness:
        return None, None
    posed = judgement.posed
    softer = Hands(hands.low, replace(hands.high, stiffness=stiffest))
    design = Design(posed.demands.device, judgement.gains, judgement.coupling)
    worlds = judgement.certificate.demands.worlds
    found = certified(design, replace(posed.demands, hands=softer, worlds=worlds), posed.box)
    return stiffest, "proved" if found.verdict is Verdict.PROVED else "undecided"


def _floored(stiffness: float) -> float:
    """Return a stiffness, reduced by the share `RESERVE` and rounded down to `DIGITS` digits."""
    reserved = stiffness * (1 - RESERVE)
    if not 0 < reserved < inf:
        return reserved
    unit = 10.0 ** (floor(log10(reserved)) + 1 - DIGITS)
    return float(f"{floor(reserved / unit) * unit:.{DIGITS}g}")


def in_hand_record(problem: Problem, judgement: Judgement) -> InHandRecord:
    """Return what the hand feels of a design."""
    gains, coupling, device, objective = judgement.gains, judgement.coupling, problem.device, problem.transparency
    found: dict[str, bool | float | str] = {}
    if device.kind.own_loop and not device.kind.inverse and gains.closed:
        found["limp"] = gains.position < objective.reference_impedance * objective.band.min
    if problem.nyquist > (omega := 2 * pi * FREE_HZ[0]):
        least = problem.worlds.low if problem.worlds is not None else None
        free = _felt(problem, gains, coupling, omega, least)
        found |= {} if least is None else {"behind": least.in_words(problem.units)}
        found |= {"mass_1hz": free.imag / omega, "damping_1hz": free.real}
        if device.servo is None:
            found["bare_mass_1hz"] = _felt(problem, *NO_LOOP, omega).imag / omega
    wall = problem.worlds.high.stiffness if problem.worlds is not None and problem.worlds.walls else inf
    if wall < inf and problem.nyquist > (omega := 2 * pi * WALL_HZ):
        low = problem.worlds.low if problem.worlds is not None else World(0.0, 0.0, 0.0)
        felt = _felt(problem, gains, coupling, omega, World(low.mass, low.damping, wall))
        found |= {"felt_wall_10hz": omega * (omega * low.mass - felt.imag), "wall": wall}
    if device.servo is not None and not isinstance(coupling, SpringDamper):
        speed, acceleration = first_command(device, coupling)
        found |= {"first_speed": speed, "first_acceleration": acceleration}
    if device.velocity is not None and device.velocity.resolution is not None:
        found["count"] = device.velocity.resolution * _stiffness_of_a_count(gains, coupling, device.sample_time)
    return InHandRecord.model_validate(found)


def first_command(device: Device, coupling: Coupling) -> tuple[float, float]:
    """Return the velocity that a servo at rest is commanded in the first sample of a unit of sensed force, through the
    firmware's filter and with nothing behind, and its rate over this sample."""
    share, T = prod(float(section.now) for section in force_sections(device)), device.sample_time
    speed = share / coupling_coefficients(coupling, T, rule=device.rule)["resistance"]
    return speed, speed / T


def _felt(problem: Problem, gains: Gains, coupling: AnyCoupling, omega: float, world: World | None = None) -> complex:
    """Return the impedance that the hand feels in front of a virtual environment, N s/m."""
    met = world or World(0.0, 0.0, 0.0)
    return complex(impedance_felt(problem.device, gains, coupling, np.array([omega]), met)[0])


def _stiffness_of_a_count(gains: Gains, coupling: AnyCoupling, sample_time: float) -> float:
    """Return the force on the motor that a step of the position causes in its sample, without filters, N/m."""
    if isinstance(coupling, SpringDamper):
        return (gains.velocity + coupling.damping) / sample_time + coupling.stiffness
    return gains.velocity / sample_time + gains.position
