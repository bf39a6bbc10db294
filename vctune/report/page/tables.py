"""The tables of a page: requirements, claims and their margins, assumptions, and how the design feels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import NamedTuple

from vctune.analysis.demands import ratio_minima, unmodelled_maxima
from vctune.analysis.feel import FREE_HZ, NO_LOOP, SPEED, WALL_HZ, Feel, feel
from vctune.document.records.certificate_json import CertificateRecord, InnerLoopRecord, WorldRecord
from vctune.document.records.design_json import DesignRecord
from vctune.document.schema.number_units import unit_of
from vctune.model.device import Device
from vctune.model.display import ADMITTANCE
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.hands import QUANTITIES
from vctune.model.numbers.frequency import hertz
from vctune.model.numbers.units import Units
from vctune.model.parts import PART_NUMBERS, PARTS, Servo
from vctune.model.problem import Band, Problem
from vctune.proof.claims.registry import CLAIMS, ClaimId
from vctune.report.typography import Quantity, quantity, span


class Line(NamedTuple):
    """A row of a table: label, value, unit and note."""

    label: str
    value: str
    unit: str = ""
    note: str = ""


class ClaimLine(NamedTuple):
    """A claim in a table: its label, its sentence, its verdict, the computed value and the limit of this value."""

    label: str
    claim: str
    verdict: str
    found: str
    asked: str


class FeelLine(NamedTuple):
    """A quantity that describes how the design feels, with its unit, and the same quantity of the bare device."""

    label: str
    design: str
    bare: str = ""


def asked(problem: Problem) -> dict[str, list[Line]]:
    """Return device, constraints with objective, and hands with environments as rows, by the titles of their tables."""
    return {"Device": _device(problem), "Constraints": _demands(problem), "Hands": _hands(problem)}


def _device(problem: Problem) -> list[Line]:
    device, uncertain, units = problem.device, problem.uncertainty, problem.units
    widths = dict(uncertain.half_widths) if uncertain is not None else {}
    lines = []
    for key, number in device.numbers().items():
        unit = unit_of(tuple(key.split(".")), units)
        known = f"± {100 * widths[key]:.4g} %" if widths.get(key) else ""
        lines.append(Line(units.translated(PART_NUMBERS[key].label), *quantity(float(number), unit), known))
    display = []
    if device.kind is not ADMITTANCE:
        display = [Line("display", device.kind.name, "", device.kind.makes.format(force=units.force_name))]
    lines = [*display, *lines, *(_own_loop(device) if device.servo is None else _servo(device.servo))]
    if uncertain is not None and uncertain.unmodelled:
        radii = [radius for _, radius in uncertain.unmodelled]
        lines.append(Line("unmodelled, radius", *span(min(radii), max(radii))))
    return lines


def _own_loop(device: Device) -> list[Line]:
    estimate = device.velocity
    known = "measured" if estimate is None or estimate.source == "measured" else "from the position"
    return [Line("velocity", known), Line("hold", device.hold)]


def _servo(servo: Servo) -> list[Line]:
    held = {"velocity": "held over a sample", "position": "interpolated over a sample"}[servo.command]
    return [Line("servo: order", str(servo.order)), Line("command", servo.command, "", held)]


def _demands(problem: Problem) -> list[Line]:
    wanted, stable, kind = problem.transparency, problem.stability, problem.device.kind
    lines = [Line(kind.ratio, f"≥ {stable.safety_factor:g}", "", "the safety factor")]
    if kind.own_loop:
        limit = f"≤ {stable.max_sensitivity:g}"
        lines.append(Line("|S| of the sampled loop", limit, "", "up to the Nyquist frequency"))
    if problem.passive:
        lines.append(Line("stability band", *_band(stable.band), "for any passive hand"))
    norm = {"rms": "mean", "peak": "greatest"}[wanted.norm] + " error"
    weights = ", ".join(f"{getattr(wanted.weights, term):g}" for term in kind.terms)
    return [
        *lines,
        Line("transparency band", *_band(wanted.band), norm),
        Line("reference impedance Z_0", *quantity(wanted.reference_impedance, problem.units.damping)),
        Line("weights", weights, "", ", ".join(kind.terms)),
    ]


def _hands(problem: Problem) -> list[Line]:
    lines, met, least, units = [], problem.hands_met, problem.device.operator, problem.units
    if met is not None:
        lines.append(Line("every hand", "", "", "of this box, at every frequency"))
        for name, ends in met.ranges.items():
            lines.append(Line(units.translated(name), *span(*ends, units.of(QUANTITIES[name]))))
    if problem.worlds is not None:
        lines.append(Line(f"with every environment of {problem.worlds.in_words(units)}", ""))
    if problem.any_hand:
        lines.append(Line("any passive hand", "", "", "at every frequency"))
    if problem.passive:
        lines.append(Line("any passive hand", "", "", "on the stability band"))
        for name, number in (asdict(least) if least is not None else {}).items():
            lines.append(Line(f"that has at least the {units.translated(name)}", *quantity(number, units.of(name))))
    return lines


def _band(band: Band) -> Quantity:
    return span(*band.hz, "Hz")


@dataclass(frozen=True, slots=True)
class ClaimData:
    """The data for the rows of the claims."""

    proof: CertificateRecord  # records of the certificate and of the velocity loop; `loop` is None for a servo
    loop: InnerLoopRecord | None
    problem: Problem  # problem that the record states
    gains: Gains  # the design
    coupling: AnyCoupling

    @property
    def factor(self) -> str:
        """The limit of a ratio, as text."""
        return f"≥ {self.problem.stability.safety_factor:g}"


def claim_lines(record: DesignRecord, problem: Problem) -> list[ClaimLine]:
    """Return each claim of a design with its computed value and limit; an empty list without a design."""
    proof, loop, design = record.certificate, record.inner_loop, record.design
    if proof is None or design is None:
        return []
    known = ClaimData(proof, loop, problem, *design)
    shown = []
    for claim in proof.claims:
        found, wanted = VALUE_AND_LIMIT.get(claim.id, _nothing)(known)
        shown.append(ClaimLine(CLAIMS[claim.id].label, claim.claim, claim.verdict, found, wanted))
    return shown


def _nothing(_known: ClaimData) -> tuple[str, str]:
    return "", ""


def _least_in_hands(known: ClaimData) -> tuple[str, str]:
    hands, units = known.proof.hands, known.problem.units
    if hands is None:
        return "", ""
    hand = hands.worst_hand.in_words(units)
    world = f", with {_world(hands.worst_world, units)}" if hands.worst_world else ""
    return f"least ratio {_at(hands.min_ratio, hands.worst_hz)}, in the hand of {hand}{world}", known.factor


def _least_at_walls(known: ClaimData) -> tuple[str, str]:
    hands, units = known.proof.hands, known.problem.units
    if hands is None or hands.walls is None:
        return "", ""
    walls = hands.walls
    place = f"{_hz(walls.worst_hz)}, in the hand of {walls.worst_hand.in_words(units)}"
    multiplier = f"multiplier with its corner at {quantity(walls.corner_hz, 'Hz')}"
    return f"least ratio {quantity(walls.min_ratio)}, {place}; {multiplier}", known.factor


def _world(world: WorldRecord, units: Units) -> str:
    """Return the environment in which the ratio is least, in words."""
    row = world.row(None, units)
    return f"{row.value} {row.unit}"


def _peak_sensitivity(known: ClaimData) -> tuple[str, str]:
    loop = known.loop
    assert loop is not None, "a claim about it is made"
    peak = _at(loop.peak_sensitivity, loop.peak_sensitivity_hz)
    return f"peak {peak}", f"≤ {known.problem.stability.max_sensitivity:g}"


def _radius_and_margins(known: ClaimData) -> tuple[str, str]:
    loop = known.loop
    assert loop is not None, "a claim about it is made"
    margins = (
        ("gain", loop.gain_margin_db, "dB"),
        ("phase", loop.phase_margin_deg, "deg"),
        ("delay", loop.delay_margin_s, "s"),
    )
    left = [f"{name} {quantity(value, unit, 3)}" for name, value, unit in margins if value is not None]
    return f"{quantity(loop.spectral_radius)}" + (f"; margins: {', '.join(left)}" if left else ""), "< 1"


def _peak_unmodelled(known: ClaimData) -> tuple[str, str]:
    return f"peak {quantity(float(-unmodelled_maxima(known.problem, known.gains).value[0]))}", "< 1"


def _least_in_any_hand(known: ClaimData) -> tuple[str, str]:
    """Return the least ratio in any passive hand; for an admittance display, the least ratio on the band."""
    proof, problem = known.proof, known.problem
    if proof.any_hand is not None:
        return f"least ratio {_at(proof.any_hand.min_ratio, proof.any_hand.worst_hz)}", known.factor
    if proof.hands is None or proof.hands.min_ratio != proof.min_ratio:
        return f"least ratio {_at(proof.min_ratio, proof.worst_hz)}", known.factor
    least = ratio_minima(problem, known.gains, known.coupling)
    which = "" if problem.uncertainty is None else ", of the nominal device"
    return f"least ratio {_at(float(least.value[0]), hertz(float(least.omega[0])))}{which}", known.factor


# Functions that return a claim's computed value and its limit as texts, by the identifier of the claim
VALUE_AND_LIMIT: dict[ClaimId, Callable[[ClaimData], tuple[str, str]]] = {
    "passive": _least_in_any_hand,
    "sensitivity": _peak_sensitivity,
    "stable": _radius_and_margins,
    "unmodelled": _peak_unmodelled,
    "any_hand": _least_in_any_hand,
    "hands": _least_in_hands,
    "worlds": _least_in_hands,
    "walls": _least_at_walls,
}


def _at(value: float | None, hz: float | None) -> str:
    return f"{quantity(value)}, {_hz(hz)}"


def _hz(hz: float | None) -> str:
    return "where ω → ∞" if hz is None else f"at {quantity(hz, 'Hz')}"


def assumptions(problem: Problem) -> list[str]:
    """Return the assumptions of a problem's certificate (model/README.md, section 11)."""
    device, uncertain = problem.device, problem.uncertainty
    within = "with exactly the parameters above" if uncertain is None else "with any parameters in the box above"
    moves = {"linear": "moves along one axis and is linear", "rotary": "turns about one axis and is linear"}[
        device.units
    ]
    lines = [
        f"The device {moves}, {within}: {'no dry friction, no backlash,' * (device.servo is None)} no saturated motor.",
        f"The loop contains only these dynamics: {_stated(device)}. All other parts are ideal.",
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


def feel_lines(problem: Problem, gains: Gains, coupling: AnyCoupling) -> list[FeelLine]:
    """Return the rows that compare how a design and the bare device feel (analysis/README.md, section 1)."""
    here, units = feel(problem.device, gains, coupling), problem.units
    if problem.device.servo is not None:
        return _feel_of_servo(here, units)
    bare = feel(problem.device, *NO_LOOP)
    lines = [
        FeelLine(f"apparent {name} in free motion at {hz:g} Hz", _felt(ours[k], unit), _felt(theirs[k], unit))
        for name, unit, ours, theirs in (
            (units.mass_name, units.mass, here.mass, bare.mass),
            ("damping", units.damping, here.damping, bare.damping),
        )
        for k, hz in enumerate(FREE_HZ)
    ]
    walls = (
        (here.static_stiffness, bare.static_stiffness, "at rest"),
        (here.stiffness, bare.stiffness, f"{WALL_HZ:g} Hz"),
    )
    lines += [
        FeelLine(f"stiffest wall felt, {where}", _felt(ours, units.stiffness), _felt(theirs, units.stiffness))
        for ours, theirs, where in walls
    ]
    force = f"{units.force_name} for a steady {SPEED:g} {units.speed}"
    lines.append(FeelLine(force, _felt(here.force, units.force), _felt(bare.force, units.force)))
    ends = _felt(here.tracking_bandwidth, "Hz"), _felt(bare.tracking_bandwidth, "Hz")
    lines.append(FeelLine("bandwidth of tracking", *ends))
    late = [
        ("loop latency", here.loop_latency),
        (f"{units.force_name}-path latency at {WALL_HZ:g} Hz", here.force_latency),
    ]
    # the motion of an impedance display responds at once, and its force path is the loop
    if not problem.device.kind.senses_force:
        late = late[:1]
    return lines + [
        FeelLine(label, *(("", "") if seconds is None else (str(quantity(seconds, "s", 3)), "no loop")))
        for label, seconds in late
    ]


def _feel_of_servo(here: Feel, units: Units) -> list[FeelLine]:
    """Return the rows for a servo. There is no bare device to compare with, because without a coupling a servo stands
    still."""
    rows = [
        (f"apparent {name} in free motion at {hz:g} Hz", _felt(of[k], unit))
        for name, unit, of in ((units.mass_name, units.mass, here.mass), ("damping", units.damping, here.damping))
        for k, hz in enumerate(FREE_HZ)
    ]
    rows.append((f"{units.force_name} for a steady {SPEED:g} {units.speed}", _felt(here.force, units.force)))
    rows.append(("bandwidth of tracking", _felt(here.tracking_bandwidth, "Hz")))
    late = "" if here.loop_latency is None else str(quantity(here.loop_latency, "s", 3))
    return [FeelLine(*row) for row in [*rows, ("latency from command to motion", late)]]


def _felt(value: float | None, unit: str) -> str:
    if value is None:
        return "above Nyquist"
    return str(quantity(0.0 if abs(value) <= 1e-12 else value, unit))
