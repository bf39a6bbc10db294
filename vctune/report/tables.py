"""The tables of a page: requirements, claims with their values, and assumptions."""

from __future__ import annotations

from dataclasses import asdict
from typing import NamedTuple

from vctune.analysis.demands import ratio_minima, unmodelled_maxima
from vctune.document.records.certificate_json import InnerLoopRecord
from vctune.document.records.design_json import DesignRecord
from vctune.document.schema.number_units import unit_of
from vctune.model.device import Device
from vctune.model.display import ADMITTANCE
from vctune.model.hands import QUANTITIES
from vctune.model.numbers.units import hertz
from vctune.model.parts import PART_NUMBERS, PARTS
from vctune.model.problem import Problem
from vctune.proof.claims.registry import CLAIMS, ClaimId
from vctune.report.typography import quantity, span


class Line(NamedTuple):
    """A row of a table of requirements: label, value, unit and note."""

    label: str
    value: str
    unit: str = ""
    note: str = ""


class ClaimLine(NamedTuple):
    """A claim: its label, its sentence, its verdict, the computed value and the limit of this value."""

    label: str
    claim: str
    verdict: str
    found: str
    asked: str


def asked(problem: Problem) -> dict[str, list[Line]]:
    """Return device, constraints with objective, and hands with environments as rows, by the titles of their tables."""
    return {"Device": _device(problem), "Constraints": _demands(problem), "Hands": _hands(problem)}


def _device(problem: Problem) -> list[Line]:
    device, uncertain, units = problem.device, problem.uncertainty, problem.units
    widths = dict(uncertain.half_widths) if uncertain is not None else {}
    lines = []
    if device.kind is not ADMITTANCE:
        lines.append(Line("display", device.kind.name, "", device.kind.makes.format(force=units.force_name)))
    for key, number in device.numbers().items():
        unit = unit_of(tuple(key.split(".")), units)
        known = f"± {100 * widths[key]:.4g} %" if widths.get(key) else ""
        lines.append(Line(units.translated(PART_NUMBERS[key].label), *quantity(float(number), unit), known))
    if (servo := device.servo) is not None:
        held = {"velocity": "held over a sample", "position": "interpolated over a sample"}[servo.command]
        lines += [Line("servo: order", str(servo.order)), Line("command", servo.command, "", held)]
    else:
        measured = device.velocity is None or device.velocity.source == "measured"
        lines += [Line("velocity", "measured" if measured else "from the position"), Line("hold", device.hold)]
    if uncertain is not None and uncertain.unmodelled:
        radii = [radius for _, radius in uncertain.unmodelled]
        lines.append(Line("unmodelled, radius", *span(min(radii), max(radii))))
    return lines


def _demands(problem: Problem) -> list[Line]:
    wanted, stable, kind = problem.transparency, problem.stability, problem.device.kind
    lines = [Line(kind.ratio, f"≥ {stable.safety_factor:g}", "", "the safety factor")]
    if kind.own_loop:
        lines.append(
            Line("|S| of the sampled loop", f"≤ {stable.max_sensitivity:g}", "", "up to the Nyquist frequency")
        )
    if problem.passive:
        lines.append(Line("stability band", *span(*stable.band.hz, "Hz"), "for any passive hand"))
    norm = {"rms": "mean", "peak": "greatest"}[wanted.norm]
    weights = ", ".join(f"{getattr(wanted.weights, term):g}" for term in kind.terms)
    return [
        *lines,
        Line("transparency band", *span(*wanted.band.hz, "Hz"), f"{norm} error"),
        Line("reference impedance Z_0", *quantity(wanted.reference_impedance, problem.units.damping)),
        Line("weights", weights, "", ", ".join(kind.terms)),
    ]


def _hands(problem: Problem) -> list[Line]:
    lines, least, units = [], problem.device.operator, problem.units
    if problem.hands_met is not None:
        lines.append(Line("every hand", "", "", "of this box, at every frequency"))
        for name, ends in problem.hands.ranges.items():
            lines.append(Line(units.translated(name), *span(*ends, units.of(QUANTITIES[name]))))
    if problem.worlds is not None:
        lines.append(Line(f"with {problem.worlds.in_words(units)}", ""))
    if problem.any_hand:
        lines.append(Line("any passive hand", "", "", "at every frequency"))
    if problem.passive:
        lines.append(Line("any passive hand", "", "", "on the stability band"))
        for name, number in (asdict(least) if least is not None else {}).items():
            lines.append(Line(f"that has at least the {units.translated(name)}", *quantity(number, units.of(name))))
    return lines


def claim_lines(record: DesignRecord, problem: Problem) -> list[ClaimLine]:
    """Return each claim of a design with its computed value and limit; an empty list without a design."""
    return [
        ClaimLine(CLAIMS[claim.id].label, claim.claim, claim.verdict, *_value_and_limit(claim.id, record, problem))
        for claim in (record.certificate.claims if record.certificate is not None else [])
    ]


def _value_and_limit(claim: ClaimId, record: DesignRecord, problem: Problem) -> tuple[str, str]:
    """Return the computed value of a claim and its limit, as texts."""
    loop, design = record.inner_loop, record.design
    if claim == "unmodelled" and design is not None:
        return f"peak {quantity(float(-unmodelled_maxima(problem, design[0]).value[0]))}", "< 1"
    if claim == "sensitivity" and loop is not None:
        return f"peak {peak_in_words(loop)}", f"≤ {problem.stability.max_sensitivity:g}"
    if claim == "stable" and loop is not None:
        return "; ".join([str(quantity(loop.spectral_radius)), *margins_in_words(loop)]), "< 1"
    found = _least_ratio(claim, record, problem)
    return found, f"≥ {problem.stability.safety_factor:g}" if found else ""


def _least_ratio(claim: ClaimId, record: DesignRecord, problem: Problem) -> str:
    """Return the least ratio that a claim bounds, in words; "" for other claims."""
    proof, units = record.certificate, problem.units
    assert proof is not None and record.design is not None, "a claim is about a design"
    hands, any_hand = proof.hands, proof.any_hand
    found = ""
    if claim in ("passive", "any_hand"):
        if any_hand is not None:
            found = in_place(any_hand.min_ratio, any_hand.worst_hz)
        elif hands is None or hands.min_ratio != proof.min_ratio:
            found = in_place(proof.min_ratio, proof.worst_hz)
        else:
            least = ratio_minima(problem, *record.design)
            found = in_place(float(least.value[0]), hertz(float(least.omega[0])))
            found += "" if problem.uncertainty is None else ", of the nominal device"
    elif claim in ("hands", "worlds") and hands is not None:
        found = f"{in_place(hands.min_ratio, hands.worst_hz)}, in the hand of {hands.worst_hand.in_words(units)}"
        if hands.worst_world is not None:
            world = hands.worst_world.row(None, units)
            found += f", with {world.value} {world.unit}"
    elif claim == "walls" and hands is not None and (walls := hands.walls) is not None:
        found = f"{in_place(walls.min_ratio, walls.worst_hz)}, in the hand of {walls.worst_hand.in_words(units)}"
        found += f"; multiplier with its corner at {quantity(walls.corner_hz, 'Hz')}"
    return f"least ratio {found}" if found else ""


def peak_in_words(loop: InnerLoopRecord) -> str:
    """Return the peak of |S| and its frequency."""
    return in_place(loop.peak_sensitivity, loop.peak_sensitivity_hz)


def margins_in_words(loop: InnerLoopRecord) -> list[str]:
    """Return the finite margins of a velocity loop."""
    sizes = {
        "gain": quantity(loop.gain_margin_db, "dB", 3),
        "phase": quantity(loop.phase_margin_deg, "deg", 3),
        "delay": quantity(loop.delay_margin_s, "s", 3),
    }
    return [f"{name} margin {size}" for name, size in sizes.items() if size.value != "none"]


def in_place(value: float | None, hz: float | None) -> str:
    """Return an extremum and its frequency; without a frequency it is the limit for high frequencies."""
    where = "where ω → ∞" if hz is None else f"at {quantity(hz, 'Hz')}"
    return f"{quantity(value)} {where}"


def assumptions(problem: Problem) -> list[str]:
    """Return the assumptions of a problem's certificate (model/README.md, section 11)."""
    device, uncertain = problem.device, problem.uncertainty
    within = "with exactly the parameters above" if uncertain is None else "with any parameters in the box above"
    moves = {"linear": "moves along one axis and is linear", "rotary": "turns about one axis and is linear"}[
        device.units
    ]
    lines = [
        f"The device {moves}, {within}: {'no dry friction, no backlash,' * (device.servo is None)} no saturated motor.",
        f"The loop contains only these dynamics: {_stated(device)}. All other parts are ideal: no quantisation of the "
        "encoder, no rounding.",
    ]
    if device.servo is not None:
        lines.append(
            "The servo does not yield: however hard the hand pushes, the motion follows only the command. A load on "
            "the hand's side of the force sensor is a part of the hand, operator.mass; a load on the robot's side has "
            "no effect."
        )
    if uncertain is not None and uncertain.unmodelled:
        lines.append(
            "In addition, the mechanism's response may deviate by the radius above, independently at each frequency"
            + ("; the claim in the box of hands does not cover this." if problem.hands_met is not None else ".")
        )
    if problem.any_hand:
        lines.append(
            "The hand is any linear, time-invariant, passive hand. The claim is about the exact sampled loop at every "
            "frequency, including aliasing. It includes neither friction nor the encoder's rounding, which determine "
            "whether the handle chatters."
        )
    if problem.passive:
        lines.append(
            "The hand is any linear, time-invariant, passive hand. The claim is about the stability band in the "
            "frequency model, which has no aliasing. Outside the proved band such a hand can make the handle oscillate."
        )
    if problem.hands_met is not None:
        lines.append(
            "A hand of the box is a linear mass, damper and spring that do not change while the hand holds the handle. "
            "The claim is about the exact sampled loop at every frequency, including aliasing. It does not cover a "
            "hand outside the box."
        )
    if problem.worlds is not None:
        linear = problem.worlds.linear.in_words(problem.units)
        lines.append(
            f"The environment is one of {linear}: a mass, a damper and a spring, stepped by the trapezoidal rule, "
            + (
                "that do not change. The spring may be a wall: a force that depends only on the position and rises "
                "with slopes within the range of stiffness. A wall is one-sided or piecewise linear, at any position, "
                "and is stepped by the trapezoidal rule or by backward Euler. The claim covers neither a wall that "
                "moves, nor a damper that acts on one side, nor an environment outside the box."
                if problem.worlds.walls
                else "linear and unchanging. The claim covers neither a one-sided wall nor an environment "
                "outside the box."
            )
        )
        return [problem.units.translated(line) for line in lines]
    lines.append(
        "The environment is passive as it runs in the firmware, sample by sample, and may be a one-sided wall. A mass "
        "that is stepped explicitly is not passive."
        if problem.hands_met is not None or problem.any_hand
        else "The environment is passive as it runs in the firmware. A mass that is stepped explicitly is not passive."
    )
    return [problem.units.translated(line) for line in lines]


def _stated(device: Device) -> str:
    if (servo := device.servo) is not None:
        low_pass = f"a servo of {quantity(servo.bandwidth_hz, 'Hz')} and order {servo.order}"
        late = f"a {servo.command} command every {quantity(device.sample_time, 's')}"
        stated = [low_pass, f"delay {quantity(servo.delay, 's')}", late]
        return ", ".join([*stated, *_parts(device)])
    stated = [f"hold “{device.hold}” of {quantity(device.sample_time, 's')}"]
    stated += [f"delay {quantity(device.delay, 's')}"] if device.delay > 0 else []
    return ", ".join([*stated, *_parts(device)])


def _parts(device: Device) -> list[str]:
    """Return the names of the parts that a device has in addition to a servo."""
    return [part.stated for key, part in PARTS.items() if key != "servo" and getattr(device, key) is not None]
