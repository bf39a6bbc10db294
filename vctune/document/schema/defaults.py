"""Compute defaults from the device's own scales, so that a change of units does not change them. See
document/README.md, section 1."""

from __future__ import annotations

from dataclasses import replace
from math import inf, pi, sqrt
from typing import Any

from vctune.document.schema.problem_schema import (
    ExperimentTable,
    OperatorTable,
    ProblemDocument,
    ServoDeviceTable,
    StabilityTable,
    ToolTable,
    UncertaintyTable,
    WorldsTable,
)
from vctune.document.schema.rules import FASTEST
from vctune.model.device import Device
from vctune.model.experiment import Experiment, Friction, usual_share
from vctune.model.hands import Hand, Hands, LeastOperator
from vctune.model.loop.limits import lags
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.units import UnitSystem
from vctune.model.parts import PARTS, Servo, VelocityEstimate
from vctune.model.problem import (
    ABSENT,
    HUMAN_HANDS,
    Band,
    Bounds,
    Criterion,
    Problem,
    Range,
    Stability,
    Transparency,
    Uncertainty,
)
from vctune.model.rest import greatest_at_rest
from vctune.model.servo import delays_in_latency, lightest_mass
from vctune.model.worlds import EVERY_WORLD, World, Worlds

BRISTLES = 1e5  # Stiffness of the bristles of a friction with stiction on a linear device, N/m


def resolve(document: ProblemDocument, default_name: str) -> Problem:
    """Return the problem that a valid document states, with all defaults filled in."""
    tool = _tool(document.tool)
    hands = _hands(document.operator or OperatorTable(), document.device.units).with_tool(tool)
    operator = LeastOperator(hands.low.mass, hands.low.damping) if hands.low.mass or hands.low.damping else None
    device = replace(device_of(document.device), rule=document.coupling.rule)
    if device.servo is not None:
        radii = tuple(document.uncertainty.unmodelled)
        device = replace(device, servo=replace(device.servo, radii=radii))
    rigid = document.environment is not None and device.kind.inverse
    # a servo has the criterion "hands" only, and a file with [environment] unless it states another (rules.py)
    worlds = None if rigid else _worlds(document.environment)
    stated = "criterion" in document.stability.model_fields_set
    has_a_choice = device.kind.own_loop and (document.environment is None or rigid or stated)
    criterion = document.stability.criterion if has_a_choice else "hands"
    # with nothing behind, the claim about any passive hand counts on no operator
    operator = operator if criterion != "hands" and (document.environment is None or rigid) else None
    device = replace(device, operator=operator)
    loop_lags = lags(device, FLOATS)
    lag = float(loop_lags.drive) + max(0.0, float(loop_lags.estimate))  # a filter with lead has a negative lag

    objective = document.transparency
    f1, f2 = objective.band_hz or (share / lag for share in device.kind.band)
    middle_omega = 2 * pi * sqrt(f1 * f2)
    greatest = hands.high
    resistance = max(greatest.stiffness * lag, greatest.damping, greatest.mass / lag) or 1.0
    Z_0 = objective.reference_impedance or (resistance if device.servo else device.mass * middle_omega)
    transparency = Transparency(Band(2 * pi * f1, 2 * pi * f2), Z_0, objective.norm, objective.weights)
    stability = _stability(document.stability, criterion, device, lag, transparency.band.min)
    return Problem(
        name=document.name if document.name is not None else default_name,
        description=document.description,
        device=device,
        bounds=_bounds(document, device, lag, Z_0, middle_omega),
        transparency=transparency,
        stability=stability,
        uncertainty=_uncertainty(document.uncertainty, device),
        experiments=tuple(_experiment(table, device, worlds, tool) for table in document.experiment),
        hands=hands,
        worlds=worlds,
        rigid=rigid,
    )


def _bounds(document: ProblemDocument, device: Device, lag: float, Z_0: float, middle_omega: float) -> Bounds:
    """Return the ranges of the design variables."""
    kind, worlds = device.kind, _worlds(document.environment)
    alone = worlds is not None and worlds.nothing  # a damper in series with nothing holds nothing
    usual = {
        "velocity": (0.0, 0.0),
        "damping": (inf, inf) if alone else (0.0 if kind.inverse else 1e-6 * Z_0, 1e6 * Z_0),
        "mass": (1e-6 * Z_0 / middle_omega, 1e6 * Z_0 / middle_omega),
        "drag": (0.0, 1e3 * Z_0),
        "stiffness": (1e-6 * Z_0 * middle_omega, 1e6 * Z_0 * middle_omega),
    }
    stated = {key: getattr(getattr(document, table), key) for table, key in (key.split(".") for key in kind.stated)}
    if kind.banded:
        loop_impedance = device.mass / lag + device.damping
        least = min(1e-8 * device.mass / device.sample_time, 1e-5 * loop_impedance)
        fixed = all(isinstance(stated[key], float) for key in ("velocity", "position", "damping", "mass"))
        drag_is_free = not fixed and (alone or document.stability.criterion != "passive")
        usual["velocity"] = least, 2 * loop_impedance
        usual["position"] = 0.0, 2 * loop_impedance / lag
        usual["drag"] = 0.0, Z_0 if drag_is_free else 0.0
    absent = dict.fromkeys(("velocity", "position", "damping", "mass", "drag"), ABSENT)
    if device.rule == "euler":
        absent["damping"] = Range(inf, inf)
    found = absent | {key: _range(value, *usual[key]) for key, value in stated.items()}
    lightest = lightest_mass(device, found["drag"].min)
    if found["damping"].min == inf and not found["mass"].fixed and lightest <= found["mass"].max:
        found["mass"] = Range(max(found["mass"].min, lightest), found["mass"].max)
    stiffest, key = greatest_at_rest(device), "stiffness" if kind.inverse else "position"
    if document.stability.rest and stiffest is not None and not found[key].fixed:
        found[key] = Range(min(found[key].min, stiffest), min(found[key].max, stiffest))
    return Bounds(**found)


def _hands(table: OperatorTable, units: UnitSystem) -> Hands:
    """Return the hands of a table."""
    greatest = HUMAN_HANDS.high.numbers if units == "linear" else dict.fromkeys(HUMAN_HANDS.high.numbers, 0.0)
    ranges = {name: _range(getattr(table, name), 0.0, high) for name, high in greatest.items()}
    low, high = (Hand(**{name: getattr(each, end) for name, each in ranges.items()}) for end in ("min", "max"))
    return Hands(low, high)


def _tool(table: ToolTable | None) -> Hands | None:
    """Return the tools of a table; None without a tool."""
    if table is None:
        return None
    mass, damping = _range(table.mass, 0.0, 0.0), _range(table.damping, 0.0, 0.0)
    tools = Hands(Hand(mass.min, damping.min, 0.0), Hand(mass.max, damping.max, 0.0))
    return tools if mass.max or damping.max else None


def _worlds(table: WorldsTable | None) -> Worlds | None:
    """Return the environments of a table; None, that is, every passive environment, if no key differs from its
    default."""
    if table is None:
        return None
    mass, stiffness = (_range(stated, 0.0, inf) for stated in (table.mass, table.stiffness))
    low, high = World(mass.min, table.damping.min, stiffness.min), World(mass.max, inf, stiffness.max)
    worlds = Worlds(low, high, table.walls, None if table.corner_hz is None else 2 * pi * table.corner_hz)
    return None if worlds == EVERY_WORLD else worlds


def _stability(table: StabilityTable, criterion: Criterion, device: Device, lag: float, slowest: float) -> Stability:
    """Return the constraints."""
    if table.band_hz is not None:
        low, high = table.band_hz
        band = Band(2 * pi * low, 2 * pi * high if high < inf else inf)
    else:
        band = Band(slowest, 2 * pi * (0.05 / lag if device.kind.banded else 0.5 / device.sample_time))
    stated = table.model_dump(exclude={"band_hz", "criterion"})
    return Stability(band, criterion=criterion, **stated)


def device_of(table: Device | ServoDeviceTable) -> Device:
    """Return the device of a table, without its least operator, the radii of a servo, and parts that are ideal."""
    if isinstance(table, ServoDeviceTable):
        # mass 1 and damping 0: the motion of a servo does not depend on them
        servo = table.servo if table.servo.bandwidth_hz is not None else _divided(table.servo, table.sample_time)
        parts = {"servo": servo, "force_sensor": table.force_sensor}
        device = Device(1.0, 0.0, table.sample_time, display="servo", units=table.units, **parts)  # type: ignore[arg-type]
    else:
        estimate = table.velocity or VelocityEstimate()
        source = "difference" if table.kind.differences and estimate.source is None else estimate.source
        usual = source == "measured" and not table.kind.differences
        device = replace(table, velocity=replace(estimate, source=None if usual else source))
    absent: dict[str, Any] = {key: None for key, of in PARTS.items() if getattr(device, key) == of.ideal}
    return replace(device, **absent)


def _divided(servo: Servo, T: float) -> Servo:
    """Return a servo of which only the latency is known, in the middle of its divisions into delay and lag."""
    if servo.delay == 0:
        return replace(servo, bandwidth_hz=FASTEST / T)
    return replace(servo, delay=sum(delays_in_latency(servo.delay, T)) / 2, latency=servo.delay)


def _uncertainty(table: UncertaintyTable, device: Device) -> Uncertainty | None:
    """Return the uncertainty; None if no parameter of the device varies and there is no disc."""
    widths = table.model_dump(by_alias=True, exclude={"objective", "unmodelled"})
    moving = tuple((key, width) for key, width in widths.items() if isinstance(width, float) and width > 0)
    ranges = tuple((key, Range(**ends)) for key, ends in widths.items() if isinstance(ends, dict))
    if device.servo is not None and device.servo.latency is not None:
        shortest, longest = delays_in_latency(device.servo.latency, device.sample_time)
        moving += (("servo.delay", (longest - shortest) / (longest + shortest)),) if longest > shortest else ()
    radii = () if device.servo is not None else tuple(table.unmodelled)
    uncertainty = Uncertainty(moving, table.objective, radii, ranges)
    some = any(device.number(key) for key, _ in moving) or any(not ends.fixed for _, ends in ranges)
    return uncertainty if uncertainty.unmodelled or some else None


def _range(value: Any, low: float, high: float) -> Range:
    """Return the range of a variable: [low, high] if the file states nothing, a fixed value, or the stated range."""
    if value is None:
        return Range(low, high)
    if isinstance(value, float):
        return Range(value, value)
    return Range(value.min, inf if value.max is None else value.max)


def _experiment(table: ExperimentTable, device: Device, worlds: Worlds | None, tool: Hands | None) -> Experiment:
    """Return an experiment, whose friction and encoder have the device's defaults, its environment the rule that is
    proved, and its hand the mass of the greatest tool."""
    friction, environment, hand, sensors = table.friction, table.environment, table.operator, table.sensors
    count = (device.velocity.resolution if device.velocity is not None else None) or 0.0
    if sensors.position_resolution is None:
        sensors = replace(sensors, position_resolution=count)
    if friction is None and device.friction:
        friction = Friction(device.friction)
    if tool is not None:
        hand = replace(hand, mass=hand.mass + tool.high.mass)
    if environment.rule is None and not environment.rigid:
        proved = worlds is not None and environment.mass > 0 and (worlds.walls or not environment.wall)
        environment = replace(environment, rule="trapezoid" if proved else "backward")
    if friction is not None:
        stiction = friction.coulomb if friction.stiction is None else friction.stiction
        usual = BRISTLES * usual_share(device.mass, device.units)
        stiffness = usual if friction.stiffness is None and stiction > friction.coulomb else friction.stiffness
        damping = friction.damping
        if damping is None:
            damping = sqrt((stiffness or 0.0) * device.mass)
        friction = replace(friction, stiction=stiction, stiffness=stiffness, damping=damping)
    return Experiment(table.name, environment, hand, friction, sensors, table.actuator.limit, table.baseline)
