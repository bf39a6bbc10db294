"""The margins and curves of the claims as functions of a frequency and of numbers by name, for boxes of both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, lru_cache, partial
from math import inf

import numpy as np

from vctune.model.device import Device
from vctune.model.gains import Coupling, SpringDamper
from vctune.model.hands import HAND, STIFFNESS, Hand
from vctune.model.loop.device_response import DeviceResponse, device_response
from vctune.model.loop.llewellyn import required_resistance
from vctune.model.loop.loop import loop_response
from vctune.model.numbers.arithmetic import Number
from vctune.model.numbers.pair import Pair
from vctune.model.problem import Demands
from vctune.model.sampled.any_hand import any_hand
from vctune.model.sampled.circle import split_delay
from vctune.model.sampled.hand_loop import NextToRest, loop_in_hand, required_in_hand, room
from vctune.model.sampled.impedance_display import Required
from vctune.model.sampled.loop_in_worlds import posed, sum_of
from vctune.model.sampled.plant_in_hand import (
    AnyPlantInHand,
    Delays,
    PlantInHand,
    ServoInHand,
    delays_of,
    plant_in_hand,
    plants_in_spring,
)
from vctune.model.sampled.servo_plant import ServoPlant
from vctune.model.sampled.velocity_loop import PlantLetGo, plant_let_go, return_difference, unturned
from vctune.model.worlds import WorldsMet
from vctune.proof.box_tests import Curve, Margin
from vctune.proof.boxes import FREQUENCY, SAMPLES_BEFORE, WHOLE_SAMPLES, Values, coupling_of, gains_of, shared
from vctune.proof.claims.margins_of_claims import (
    Design,
    LoopDelay,
    across_position,
    along_drive,
    any_hand_before_wall,
    any_hand_margin,
    clamped_margin,
    conditions_of,
    hand_curve,
    hand_margin,
    high_margin,
    limp_hand_curve,
    limp_hand_margin,
    limp_margins_in_worlds,
    limp_strip_of_walls,
    low_margin,
    margin_in_spring,
    margins_in_worlds,
    model_curve,
    resistance_margin,
    sensitivity_margin,
    sensitivity_sufficient_margin,
    strip_of_walls,
    unmodelled_margin,
    wall_curve,
)
from vctune.proof.claims.walls import COUPLING_SHARE, limp_walls_margin, walls_margins
from vctune.proof.enclosures.intervals import Enclosure, decimal
from vctune.proof.enclosures.taylor_functions import TAYLOR as OPS

# The names of the rows for the shares of rho (model/README.md, section 14)
SHARES = "share of the integrator", "share of the hand's stiffness in the rest"
# The names of the two rows that both begin at 0 in a box of hands next to rest: the angle and the stiffness
AT_REST = (FREQUENCY, STIFFNESS)


NO_HAND = Hand(0, 0, 0)
# The names of the rows of a straight line that bounds R in all hands (`vctune.proof.claims.cells`)
OFFSET, SLOPE = "offset of the bound", "slope of the bound"


@dataclass(frozen=True, slots=True)
class Claims:
    """The claims about one device as functions of a frequency and a design, on enclosures."""

    conditions: Margin  # margins that must be positive; `sensitivity` is a function of theta
    conditions_near_zero: Margin  # margin near omega = 0; where it is positive, `conditions` hold
    conditions_near_infinity: Margin  # `conditions` at omega = 1/v, as a function of v; for hold "lag" without delay
    clamped: tuple[Margin, Margin]
    sensitivity: Margin
    unmodelled: Margin  # margin in theta that must be positive if the device's response is not known exactly
    resistance: Margin  # the loop's resistance, N s/m, which must be positive for every coupling
    in_hand: Margin  # margins in theta; at every theta and in every hand, one of them must be positive
    above_bound: Margin  # margin in theta, `OFFSET` and `SLOPE`
    any_hand: tuple[Margin, Margin]
    before_wall: Margin  # of the coupling as a wall in any passive hand
    required_in_hands: Margin  # the least feasible Re Z_c in a hand, N s/m, as a function of theta
    poles_in_limp_hand: Curve  # the same curve without the pole of a free position; `limp_hand`: its real part
    limp_hand: Margin
    poles_in_hand: Curve  # curve, as a function of a hand and theta, that must not turn around 0
    required: Margin  # the least feasible Re Z_c, N s/m, where the resistance is positive in the whole box
    sensitivity_any_position: Margin  # margin, valid also near theta = 0
    model_poles: Curve  # curves, as functions of omega and of theta, that must not turn around 0
    sampled_poles: Curve
    model_any_position: Margin  # margins; where they are positive, the curve is not 0 for any K_p > 0
    sampled_any_position: Margin


@lru_cache(maxsize=64)
def claims_of(demands: Demands, uncertain: tuple[str, ...] = ()) -> Claims:
    """Return each claim about a device as a function of a frequency and of values by name."""
    device, plant = _devices(demands.device, uncertain)
    factor, limit = decimal(demands.factor), decimal(demands.max_sensitivity)

    def at(omega: Number, v: Values) -> DeviceResponse:
        return device_response(device(v), omega, OPS)

    def required(omega: Number, v: Values) -> Number:
        return required_resistance(loop_response(at(omega, v), gains_of(v), OPS), OPS)

    def sampled_curve(theta: Enclosure, v: Values) -> Pair:
        sampled, gains = plant(v), gains_of(v)
        parts = return_difference(sampled, theta, OPS, position=not OPS.is_zero(gains.position))
        return unturned(sampled, parts.closed(gains), theta, OPS)

    def radius_at(omega: Number) -> Number:
        known = demands.device.unmodelled
        return OPS.interpolated(omega / (2 * OPS.pi), known.radii) if known is not None else Enclosure(0.0)

    def unmodelled(theta: Number, v: Values) -> Number:
        radius = radius_at(theta / device(v).sample_time)
        return unmodelled_margin(plant(v), gains_of(v), theta, radius, OPS)

    in_hand = _plant_in_hand(demands.device, uncertain, delays_of(demands.device))

    def required_in_hands(theta: Number, v: Values) -> Number:
        required = required_in_hand(loop_in_hand(in_hand(v), theta, OPS), gains_of(v))
        return required.lost / required.size

    def design(v: Values) -> Design:
        return Design(device(v), gains_of(v), coupling_of(v))

    return Claims(
        conditions=lambda omega, v: conditions_of(demands)(design(v), omega, factor, OPS),
        conditions_near_zero=lambda omega, v: low_margin(design(v), omega, factor, OPS),
        conditions_near_infinity=lambda inverse, v: high_margin(design(v), inverse, factor, OPS),
        sensitivity=lambda theta, v: sensitivity_margin(plant(v), gains_of(v), theta, limit, OPS),
        unmodelled=unmodelled,
        clamped=(
            lambda omega, v: 1 - radius_at(omega),
            lambda omega, v: clamped_margin(design(v), omega, radius_at(omega), OPS),
        ),
        resistance=lambda omega, v: resistance_margin(design(v), omega, OPS),
        above_bound=_above_bound(demands),
        in_hand=hands_margins(demands, uncertain, delays_of(demands.device)),
        any_hand=any_hand_margins(demands, uncertain, delays_of(demands.device)),
        before_wall=any_hand_before_walls(demands, uncertain, delays_of(demands.device)),
        required_in_hands=required_in_hands,
        poles_in_hand=wall_curves(demands, uncertain, delays_of(demands.device))
        if demands.rigid
        else lambda theta, v: hand_curve(in_hand(v), gains_of(v), theta, OPS),
        poles_in_limp_hand=lambda theta, v: limp_hand_curve(in_hand(v), gains_of(v), theta, OPS)[0],
        limp_hand=lambda theta, v: limp_hand_curve(in_hand(v), gains_of(v), theta, OPS)[1],
        required=required,
        sensitivity_any_position=lambda theta, v: sensitivity_sufficient_margin(
            plant(v), gains_of(v), theta, limit, OPS
        ),
        model_poles=lambda omega, v: model_curve(at(omega, v), gains_of(v), OPS),
        sampled_poles=sampled_curve,
        model_any_position=lambda omega, v: along_drive(at(omega, v), gains_of(v)),
        sampled_any_position=lambda theta, v: across_position(plant(v), gains_of(v), theta, OPS)[0],
    )


def hands_margins(
    demands: Demands,
    uncertain: tuple[str, ...],
    delays: Delays,
    lead: float = 0.0,
) -> Margin:
    """Return margins in every hand, one of which must be positive at each point."""
    in_hand, factor = _plant_in_hand(demands.device, uncertain, delays), decimal(demands.factor)
    device = _uncertain_device(demands.device, uncertain)

    def design(v: Values) -> Design:
        coupling, share = coupling_of(v), v.get(COUPLING_SHARE)
        if share is not None and isinstance(coupling, Coupling):
            coupling = coupling.times(share)
        return Design(device(v), gains_of(v), coupling)

    if demands.worlds is None:
        return lambda theta, v: hand_margin(in_hand(v), design(v), theta, factor, OPS)
    plain, worlds = demands.worlds, demands.worlds.converted(decimal)
    if plain.corner is not None:

        def with_walls(theta: Number, v: Values) -> tuple[Number, ...]:
            stated, met = Design(device(v), gains_of(v), coupling_of(v)), WorldsMet(worlds, factor)
            strip = strip_of_walls(in_hand(v), stated, theta, v.get(COUPLING_SHARE, 1), met, OPS)
            return walls_margins(strip, met, plain, lead, stated.device.sample_time, theta, OPS)

        return with_walls
    names = posed(plain, demands.factor)

    def margins(theta: Number, v: Values) -> tuple[Number, ...]:
        found = margins_in_worlds(in_hand(v), design(v), theta, WorldsMet(worlds, factor), OPS)
        return tuple(sum_of(getattr(found, name)) for name in names)

    return margins


def margins_in_spring(demands: Demands, uncertain: tuple[str, ...], delays: Delays) -> Margin | None:
    """Return two margins that are both positive only where the claim holds in hands of every stiffness; None for a
    servo and for a box of environments, which have none."""
    if demands.worlds is not None or not demands.device.kind.own_loop:
        return None
    device, factor = _uncertain_device(demands.device, uncertain), decimal(demands.factor)

    def margins(theta: Number, v: Values) -> tuple[Number, ...]:
        design = Design(device(v), gains_of(v), coupling_of(v))
        plants = plants_in_spring(design.device, Hand.of(v), delays, OPS)
        if SAMPLES_BEFORE in v:
            there = replace(delays, loop=v[SAMPLES_BEFORE], felt=v[SAMPLES_BEFORE])
            plants = replace(plants[0], delays=there), replace(plants[1], delays=there)
        return margin_in_spring(plants, design, theta, factor, OPS)

    return margins


def bounded_in_hands(device: Device) -> Margin:
    """Return the margin |F|^2 (offset + slope theta - R), positive where R in a hand lies below a straight line."""
    in_hand = _plant_in_hand(device, (), delays_of(device))

    def margin(theta: Number, v: Values) -> Number:
        required = required_in_hand(loop_in_hand(in_hand(v), theta, OPS), gains_of(v))
        return (v[OFFSET] + v[SLOPE] * theta) * required.size - required.lost

    return margin


def bounded_in_any_hand(device: Device) -> Margin:
    """Return the margin that is positive where a straight line bounds R in any passive hand on an impedance display."""
    exact, delays = device.converted(decimal), delays_of(device)

    def margin(theta: Number, v: Values) -> Number:
        hand = any_hand(exact, delays.loop, theta, OPS, fractional=delays.loop_fractional)
        required = hand.required(gains_of(v))
        return (v[OFFSET] + v[SLOPE] * theta) * required.size - required.lost

    return margin


def _above_bound(demands: Demands) -> Margin:
    """Return the margin by which a coupling exceeds a bound of R in all hands."""
    device, factor = demands.device.converted(decimal), decimal(demands.factor)

    def margin(theta: Number, v: Values) -> Number:
        bound = Required(v[OFFSET] + v[SLOPE] * theta, Enclosure(1.0))
        return room(coupling_of(v), device, bound, factor, theta, OPS)

    return margin


def limp_hands_margins(
    demands: Demands, uncertain: tuple[str, ...], delays: Delays, lead: float = 0.0
) -> Margin | None:
    """Return the margin of `hands_margins` for theta near 0, a hand without stiffness and K_p = 0, if it has one."""
    in_hand, factor = _plant_in_hand(demands.device, uncertain, delays), decimal(demands.factor)
    device = _uncertain_device(demands.device, uncertain)

    def at(theta: Number, v: Values) -> tuple[PlantInHand, Design, Number, NextToRest]:
        plant, design = in_hand(v), Design(device(v), gains_of(v), coupling_of(v))
        assert isinstance(plant, PlantInHand)  # only a velocity loop has K_p
        integrator, others = v[SHARES[0]], 1 - v[SHARES[0]]
        stiffness = (v[HAND[2]] + design.gains.position) * (plant.sample_time * plant.sample_time / plant.mass)
        turned, spring = others * (1 - v[SHARES[1]]), others * v[SHARES[1]]
        return plant, design, theta, NextToRest(2 * OPS.sin(theta / 2) + stiffness, turned, spring, integrator)

    if demands.worlds is None:
        return lambda theta, v: limp_hand_margin(*at(theta, v), factor, OPS)
    worlds = demands.worlds.converted(decimal)
    if demands.worlds.corner is not None:

        def with_walls(theta: Number, v: Values) -> Number:
            met = WorldsMet(worlds, factor)
            strip = limp_strip_of_walls(*at(theta, v), v.get(COUPLING_SHARE, 1), met, OPS)
            return limp_walls_margin(strip, met, lead, device(v).sample_time, theta, OPS)

        return with_walls if demands.worlds.high.mass < inf else None

    names = [name for name in posed(demands.worlds, demands.factor) if name in ("resistive", "above")]

    def margins(theta: Number, v: Values) -> tuple[Number, ...]:
        found = limp_margins_in_worlds(*at(theta, v), WorldsMet(worlds, factor), OPS)
        return tuple(sum_of(getattr(found, name)) for name in names)

    return margins if names else None


def any_hand_margins(demands: Demands, uncertain: tuple[str, ...], delays: Delays) -> tuple[Margin, Margin]:
    """Return the two margins that must be positive for any passive hand on an impedance display (`any_hand_margin`)."""
    device, factor = _uncertain_device(demands.device, uncertain), decimal(demands.factor)
    delay = LoopDelay(delays.loop, delays.loop_fractional)

    def margins(theta: Number, v: Values) -> tuple[Number, Number]:
        return any_hand_margin(Design(device(v), gains_of(v), coupling_of(v)), delay, theta, factor, OPS)

    return lambda theta, v: margins(theta, v)[0], lambda theta, v: margins(theta, v)[1]


def any_hand_before_walls(demands: Demands, uncertain: tuple[str, ...], delays: Delays) -> Margin:
    """Return the margin that must be positive for a wall in any passive hand, for each share of factor times it."""
    device, factor = _uncertain_device(demands.device, uncertain), decimal(demands.factor)
    delay = LoopDelay(delays.loop, delays.loop_fractional)

    def margin(theta: Number, v: Values) -> Number:
        design = Design(device(v), gains_of(v), coupling_of(v))
        return any_hand_before_wall(design, delay, theta, factor * v.get(COUPLING_SHARE, 1), OPS)

    return margin


def wall_curves(demands: Demands, uncertain: tuple[str, ...], delays: Delays) -> Curve:
    """Return the curve that must not turn around 0 for a wall in every hand, for each share of factor times it."""
    in_hand, factor = _plant_in_hand(demands.device, uncertain, delays), decimal(demands.factor)

    def curve(theta: Number, v: Values) -> Pair:
        wall = coupling_of(v)
        assert isinstance(wall, SpringDamper)
        return wall_curve(in_hand(v), wall, factor * v.get(COUPLING_SHARE, 1), theta, OPS)

    return curve


def _uncertain_device(nominal: Device, uncertain: tuple[str, ...]) -> Callable[[Values], Device]:
    """Return the device as a function of a claim's values."""
    exact = nominal.converted(decimal)
    return lambda v: exact.with_numbers({key: v[f"device.{key}"] for key in uncertain})


def _plant_in_hand(nominal: Device, uncertain: tuple[str, ...], delays: Delays) -> Callable[[Values], AnyPlantInHand]:
    """Return the device in a hand as a function of values. Boxes with equal hands and devices share one computation."""
    exact, rows = nominal.converted(decimal), HAND + tuple(f"device.{key}" for key in uncertain)

    if nominal.servo is not None:  # the hand does not affect the servo's motion

        def servo_of(*numbers: Number) -> ServoPlant:
            found = plant_in_hand(exact.with_numbers(dict(zip(uncertain, numbers, strict=True))), NO_HAND, delays, OPS)
            assert isinstance(found, ServoInHand)
            return found.plant

        alone, known = rows[len(HAND) :], cache(servo_of)
        return lambda v: ServoInHand(shared(servo_of, [v[name] for name in alone]) if alone else known(), Hand.of(v))

    def plant(*numbers: Number) -> AnyPlantInHand:
        values = dict(zip(rows, numbers, strict=True))
        device = exact.with_numbers({key: values[f"device.{key}"] for key in uncertain})
        return plant_in_hand(device, Hand.of(values), delays, OPS)

    def of_values(v: Values) -> AnyPlantInHand:
        found: AnyPlantInHand = shared(plant, [v[name] for name in rows])
        if SAMPLES_BEFORE in v and isinstance(found, PlantInHand):
            before = v[SAMPLES_BEFORE]
            return replace(found, delays=replace(delays, loop=before, felt=before))
        return found

    return of_values


def _devices(
    nominal: Device, uncertain: tuple[str, ...]
) -> tuple[Callable[[Values], Device], Callable[[Values], PlantLetGo]]:
    """Return the device and its sampled plant as functions of a claim's values."""
    exact = nominal.converted(decimal)
    whole, fraction = split_delay(nominal.delay, nominal.sample_time)

    if not uncertain:
        known = cache(lambda: plant_let_go(exact, whole, OPS, fractional=fraction > 0))
        return lambda v: exact, lambda v: known()
    any_delay = "delay" in uncertain

    def of_numbers(whole: Number, *numbers: Number) -> PlantLetGo:
        one = exact.with_numbers(dict(zip(uncertain, numbers, strict=True)))
        return plant_let_go(one, whole, OPS, fractional=any_delay or fraction > 0)

    def plant(v: Values) -> PlantLetGo:
        rows = [v[f"device.{key}"] for key in uncertain]
        samples = [Enclosure(np.asarray(v[WHOLE_SAMPLES], float))] if any_delay else []
        found: PlantLetGo = shared(of_numbers if any_delay else partial(of_numbers, whole), [*samples, *rows])
        return found

    return _uncertain_device(nominal, uncertain), plant
