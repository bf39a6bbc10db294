"""The tables of a page: requirements, and claims with their values."""

from __future__ import annotations

from dataclasses import asdict
from typing import NamedTuple

from vctune.analysis.demands import ratio_minima, unmodelled_maxima
from vctune.document.records.certificate_json import InnerLoopRecord, WallsRecord
from vctune.document.records.design_json import DesignRecord
from vctune.document.schema.number_units import unit_of
from vctune.model.device import Device
from vctune.model.display import ADMITTANCE
from vctune.model.hands import QUANTITIES
from vctune.model.numbers.units import hertz
from vctune.model.parts import PART_NUMBERS, PARTS
from vctune.model.problem import Problem
from vctune.proof.claims.registry import CLAIMS, ClaimId
from vctune.report.typography import in_place, limit, quantity, span


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
    """Return the computed value of a claim, rounded to the safe side, and its limit, as texts."""
    loop, design = record.inner_loop, record.design
    if claim == "unmodelled" and design is not None:
        return f"peak {limit(float(-unmodelled_maxima(problem, design[0]).value[0]), up=True)}", "< 1"
    if claim == "sensitivity" and loop is not None:
        return f"peak {peak_in_words(loop)}", f"≤ {problem.stability.max_sensitivity:g}"
    if claim == "stable" and loop is not None:
        return "; ".join([str(limit(loop.spectral_radius, up=True)), *margins_in_words(loop)]), "< 1"
    found = _least_ratio(claim, record, problem)
    return (f"least ratio {found}", f"≥ {problem.stability.safety_factor:g}") if found else ("", "")


def _least_ratio(claim: ClaimId, record: DesignRecord, problem: Problem) -> str:
    """Return the least ratio that a claim bounds, in words; "" for other claims."""
    proof, units = record.certificate, problem.units
    assert proof is not None and record.design is not None, "a claim is about a design"
    hands = proof.hands
    if claim == "any_hand" and proof.any_hand is not None:
        return in_place(proof.any_hand.min_ratio, proof.any_hand.worst_hz)
    if claim == "passive":
        if hands is None or hands.min_ratio != proof.min_ratio:
            return in_place(proof.min_ratio, proof.worst_hz)
        least = ratio_minima(problem, *record.design)
        found = in_place(float(least.value[0]), hertz(float(least.omega[0])))
        return found + ("" if problem.uncertainty is None else ", of the nominal device")
    part = hands.walls if hands is not None and claim == "walls" else hands if claim in ("hands", "worlds") else None
    if part is None:
        return ""
    found = f"{in_place(part.min_ratio, part.worst_hz)}, in the hand of {part.worst_hand.in_words(units)}"
    if isinstance(part, WallsRecord):
        return f"{found}; multiplier with its corner at {quantity(part.corner_hz, 'Hz')}"
    world = part.worst_world and part.worst_world.row(None, units)
    return f"{found}, with {world.value} {world.unit}" if world else found


def peak_in_words(loop: InnerLoopRecord) -> str:
    """Return the peak of |S| and its frequency."""
    return in_place(loop.peak_sensitivity, loop.peak_sensitivity_hz, up=True)


def margins_in_words(loop: InnerLoopRecord) -> list[str]:
    """Return the finite margins of a velocity loop."""
    sizes = {
        "gain": limit(loop.gain_margin_db, "dB", 3),
        "phase": limit(loop.phase_margin_deg, "deg", 3),
        "delay": limit(loop.delay_margin_s, "s", 3),
    }
    return [f"{name} margin {size}" for name, size in sizes.items() if size.value != "none"]


def dynamics(device: Device) -> str:
    """Return the dynamics that a device's loop contains, in words."""
    if (servo := device.servo) is not None:
        stated = [f"a servo of {quantity(servo.bandwidth_hz, 'Hz')} and order {servo.order}"]
        stated += [f"delay {quantity(servo.delay, 's')}"]
        stated += [f"a {servo.command} command every {quantity(device.sample_time, 's')}"]
    else:
        stated = [f"hold “{device.hold}” of {quantity(device.sample_time, 's')}"]
        stated += [f"delay {quantity(device.delay, 's')}"] if device.delay > 0 else []
    parts = [part.stated for key, part in PARTS.items() if key != "servo" and getattr(device, key) is not None]
    return ", ".join([*stated, *parts])
