"""The tables of a page: requirements, and the values of claims."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from vctune.analysis.demands import ratio_minima, unmodelled_maxima
from vctune.design.prepared import pose
from vctune.design.records.certificate import InnerLoopRecord
from vctune.design.records.claims import HandsRecord, WallRecord, WallsRecord
from vctune.design.records.design import DesignRecord
from vctune.document.schema.number_units import unit_of
from vctune.model.device import Device
from vctune.model.display import ADMITTANCE
from vctune.model.hands import QUANTITIES
from vctune.model.numbers.units import OF_KEYS, hertz
from vctune.model.parts import PART_NUMBERS, PARTS
from vctune.model.problem import Problem
from vctune.model.worlds import OVER_LIMIT
from vctune.proof.claims.band import ALONE
from vctune.proof.claims.claim import ClaimId
from vctune.proof.claims.damping import DAMPING
from vctune.proof.claims.poles import STABLE
from vctune.proof.claims.registry import BEFORE_WALL, IN_HANDS
from vctune.proof.claims.sensitivity import SENSITIVITY, UNMODELLED
from vctune.proof.claims.walls import WALLS
from vctune.report.curves import Required
from vctune.report.style import in_place, limit, quantity


class Line(NamedTuple):
    """A row of a table of requirements: label, value, unit and note."""

    label: str
    value: str
    unit: str = ""
    note: str = ""


def asked(problem: Problem) -> dict[str, list[Line]]:
    """Return device, constraints with objective, and hands with environments as rows, by the titles of their tables."""
    return {
        "Device": _device(problem),
        "Constraints": _demands(problem),
        "Hands": _hands(problem),
        "Design": _ranges(problem),
    }


def _ranges(problem: Problem) -> list[Line]:
    """Return what the design may choose: the range of each variable, or the number that the file gives."""
    lines = []
    for key in problem.device.kind.stated:
        bounds, unit = getattr(problem.bounds, key.partition(".")[2]), problem.units.of(OF_KEYS[key])
        label = f"{key.partition('.')[2]} {problem.device.kind.symbol(key)}"
        if bounds.fixed:
            lines.append(Line(label, *quantity(bounds.min, unit), "given"))
        else:
            lines.append(Line(label, *quantity(bounds.min, unit, to=bounds.max), "free"))
    return lines


def _device(problem: Problem) -> list[Line]:
    device, uncertain, units = problem.device, problem.uncertainty, problem.units
    widths = dict(uncertain.half_widths) if uncertain is not None else {}
    ranges = dict(uncertain.ranges) if uncertain is not None else {}
    lines = []
    if device.kind is not ADMITTANCE:
        lines.append(Line("display", device.kind.name, "", device.kind.makes.format(force=units.force_name)))
    for key, number in device.numbers().items():
        if key == device.delay_key and device.divided:
            note = "divided into delay and lag in any way"
            lines.append(Line("servo: latency", *quantity(device.stated_delay, "s"), note))
            continue
        value = quantity(float(number), unit := unit_of(tuple(key.split(".")), units))
        known = f"± {100 * widths[key]:.4g} %" if widths.get(key) else ""
        if key in ranges:
            known = " ".join(quantity(ranges[key].min, unit, to=ranges[key].max))
        lines.append(Line(units.translated(PART_NUMBERS[key].label), *value, known))
    if (servo := device.servo) is not None:
        held = {"velocity": "held over a sample", "position": "interpolated over a sample"}[servo.command]
        lines += [Line("servo: order", str(servo.order)), Line("command", servo.command, "", held)]
    else:
        measured = not device.differences
        lines += [Line("velocity", "measured" if measured else "from the position"), Line("hold", device.hold)]
    if uncertain is not None and uncertain.unmodelled:
        radii = [radius for _, radius in uncertain.unmodelled]
        lines.append(Line("unmodelled, radius", *quantity(min(radii), to=max(radii))))
    return lines


def _demands(problem: Problem) -> list[Line]:
    wanted, stable, kind = problem.transparency, problem.stability, problem.device.kind
    limited = kind.ratio if problem.worlds is None else OVER_LIMIT
    limited = "multiple of the wall that is stable" if problem.rigid else limited
    lines = [Line(limited, f"≥ {stable.safety_factor:g}", "", "the safety factor")]
    if kind.own_loop and not problem.rigid:  # a wall closes no velocity loop
        most = f"≤ {stable.max_sensitivity:g}"
        lines.append(Line("|S| of the sampled loop", most, "", "up to the Nyquist frequency"))
    if stable.damping_ratio is not None:
        lines.append(Line("damping ratio", f"≥ {stable.damping_ratio:g}", "", "of every oscillation"))
    if stable.calm:
        lines.append(Line("kicks that keep it moving", "none", "", "simulated, not proved"))
    if problem.passive:
        lines.append(_band("stability band", stable.band.hz, "for any passive hand"))
    weights = ", ".join(f"{getattr(wanted.weights, term):g}" for term in kind.terms)
    norm = {"rms": "mean", "peak": "greatest"}[wanted.norm]
    return [
        *lines,
        _band("transparency band", wanted.band.hz, f"{norm} error"),
        Line("reference impedance Z_0", *quantity(wanted.reference_impedance, problem.units.damping)),
        Line("weights", weights, "", ", ".join(kind.terms)),
    ]


def _band(label: str, ends: tuple[float, float], note: str) -> Line:
    return Line(label, *quantity(ends[0], "Hz", to=ends[1]), note)


def _hands(problem: Problem) -> list[Line]:
    lines, units = [], problem.units
    if problem.hands_met is not None:
        lines.append(Line("every hand", "", "", "of this box, at every frequency"))
        for name, (low, high) in problem.hands.ranges.items():
            lines.append(Line(units.translated(name), *quantity(low, units.of(QUANTITIES[name]), to=high)))
        if problem.hands.tool is not None:
            lines.append(Line(f"with {problem.hands.tool.as_tool(units)}", "", "", "in every hand"))
    if problem.worlds is not None:
        lines.append(Line(f"with {problem.worlds.in_words(units)}", ""))
    if problem.any_hand:
        lines.append(Line(problem.passive_hand, "", "", "at every frequency"))
    if problem.rigid:
        lines.append(Line("the coupling is a wall", "", "", "its far end does not move"))
    if problem.passive:
        behind = " with nothing behind" if problem.alone else ""
        lines.append(Line(f"{problem.passive_hand}{behind}", "", "", "on the stability band"))
    return lines


def found(claim: ClaimId, record: DesignRecord, problem: Problem, required: Sequence[Required]) -> tuple[str, str]:
    """Return the computed value of a claim, rounded to the safe side, and its limit, as texts."""
    loop, proof, units, stability = record.inner_loop, record.certificate, record.units, problem.stability
    if claim == UNMODELLED.id and record.design is not None:
        return f"peak {limit(float(-unmodelled_maxima(problem, record.design[0]).value[0]), up=True)}", "< 1"
    if claim == ALONE.id and record.design is not None:
        minima = (ratio_minima(case, *record.design) for case in pose(problem).cases)
        ratio, at = min((float(each.value[0]), float(each.omega[0])) for each in minima)
        return f"least ratio {in_place(ratio, hertz(at))}", f"≥ {stability.safety_factor:g}"
    if claim == SENSITIVITY.id and loop is not None:
        return f"peak {peak_in_words(loop)}", f"≤ {stability.max_sensitivity:g}"
    if claim == DAMPING.id:
        seen = "" if record.ringing is None else f"least ratio {limit(record.ringing.damping_ratio)} (estimated)"
        return seen, f"≥ {stability.damping_ratio:g}"
    if claim == STABLE.id and loop is not None:
        return "; ".join([str(limit(loop.spectral_radius, up=True)), *margins_in_words(loop)]), "< 1"
    hands, where = proof.hands if proof is not None else None, ""
    least: Required | HandsRecord | WallsRecord | WallRecord | None
    least = next((each for each in required if each.claim == claim), None)
    if proof is not None and proof.wall is not None and claim in BEFORE_WALL:
        least, hand = proof.wall, proof.wall.worst_hand
        where = "" if hand is None else f", in the hand of {hand.in_words(units)}"
    if hands is not None and claim in IN_HANDS:
        least = hands.walls if claim == WALLS.id and hands.walls is not None else hands
        where = f", in the hand of {least.worst_hand.in_words(units)}"
        if isinstance(least, WallsRecord):
            where += f"; multiplier with its corner at {quantity(least.corner_hz, 'Hz')}"
        elif least.worst_world is not None:
            world = least.worst_world.row(None, units)
            where += f", with {world.value} {world.unit}"
    return _least(least, where, problem)


def _least(
    least: Required | HandsRecord | WallsRecord | WallRecord | None, where: str, problem: Problem
) -> tuple[str, str]:
    """Return a least ratio with its place, and the safety factor; empty texts without one."""
    if least is None:
        return "", ""
    bounded = least.min_ratio is not None or (problem.worlds is None and not problem.rigid)
    reached = f"{in_place(least.min_ratio, least.worst_hz)}{where}" if bounded else "no limit"
    return f"least ratio {reached}", f"≥ {problem.stability.safety_factor:g}"


def peak_in_words(loop: InnerLoopRecord) -> str:
    """Return the peak of |S| and its frequency."""
    return in_place(loop.peak_sensitivity, loop.peak_sensitivity_hz, up=True)


def margins_in_words(loop: InnerLoopRecord) -> list[str]:
    """Return the finite margins of a velocity loop."""
    sizes = {"gain": (loop.gain_margin_db, "dB"), "phase": (loop.phase_margin_deg, "deg")}
    sizes["delay"] = loop.delay_margin_s, "s"
    return [f"{name} margin {limit(*size, 3)}" for name, size in sizes.items() if size[0] is not None]


def dynamics(device: Device) -> str:
    """Return the dynamics that a device's loop contains, in words."""
    if (servo := device.servo) is not None:
        stated = [f"a servo of {quantity(servo.bandwidth_hz, 'Hz')} and order {servo.order}"]
        stated += [f"delay {quantity(servo.delay, 's')}"]
        if device.divided:
            stated = [f"a servo of order {servo.order}", f"latency {quantity(device.stated_delay, 's')}"]
        stated += [f"a {servo.command} command every {quantity(device.sample_time, 's')}"]
    else:
        stated = [f"hold “{device.hold}” of {quantity(device.sample_time, 's')}"]
        stated += [f"delay {quantity(device.delay, 's')}"] if device.delay > 0 else []
    parts = [part.stated for key, part in PARTS.items() if key != "servo" and getattr(device, key) is not None]
    return ", ".join([*stated, *parts])
