"""What a margin is about: a design with its constraints, perhaps in a hand, in the numbers of one arithmetic."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, dataclass, replace
from functools import cache, lru_cache, partial

import numpy as np

from vctune.model.demands import Demands
from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.gains import Gains
from vctune.model.hands import HAND, Hand
from vctune.model.numbers.arithmetic import FLOATS, Arithmetic, Number
from vctune.model.numbers.units import KEYS
from vctune.model.sampled.circle import split_delay
from vctune.model.sampled.hand_loop import room
from vctune.model.sampled.impedance_display import Required
from vctune.model.sampled.plant_in_hand import (
    AnyPlantInHand,
    Delays,
    PlantInHand,
    ServoInHand,
    delays_of,
    plant_in_hand,
)
from vctune.model.sampled.servo_plant import ServoPlant
from vctune.model.sampled.velocity_loop import PlantLetGo, plant_let_go
from vctune.model.worlds import WorldsMet
from vctune.proof.box_tests import Margin
from vctune.proof.boxes import SAMPLES_BEFORE, WHOLE_SAMPLES, Values, coupling_of, gains_of, shared
from vctune.proof.enclosures.intervals import ENCLOSURES, Enclosure, decimal
from vctune.proof.enclosures.taylor_functions import TAYLOR

NO_HAND = Hand(0, 0, 0)
# The name of the row with the share y of the coupling, from 1/safety_factor to 1
COUPLING_SHARE = "share of the coupling"


def values_of(gains: Gains) -> Values:
    """Return gains by name, and a coupling of 0, for margins that do not depend on the coupling."""
    numbers = zip(KEYS, (*map(decimal, astuple(gains)), 0, 0, 0), strict=True)
    return dict(numbers)


@dataclass(frozen=True, slots=True)
class Case:
    """One case of a claim. Over boxes its numbers are polynomials, and it stands for all cases of each box."""

    demands: Demands  # the constraints, in floats
    design: Design
    factor: Number  # numbers of the constraints in the case's arithmetic
    max_sensitivity: Number
    met: WorldsMet | None
    share: Number  # share of the coupling
    delays: Delays
    values: Values  # other numbers by name: hand, shares, bounds
    let_go: Callable[[], PlantLetGo]  # the sampled mechanism without a hand, and in the hand
    held: Callable[[], AnyPlantInHand]
    ops: Arithmetic

    @property
    def hand(self) -> Hand:
        """The hand."""
        return Hand.of(self.values)

    def radius(self, omega: Number) -> Number:
        """Return the radius of the disc of unmodelled dynamics; 0 if the device is known exactly."""
        known = self.demands.device.unmodelled
        return self.ops.interpolated(omega / (2 * self.ops.pi), known.radii) if known is not None else 0 * omega

    def room(self, required: Required, theta: Number) -> Number:
        """Return the margin between what the coupling offers and a requirement, times a positive number."""
        return room(self.design.coupling, self.design.device, required, self.factor, theta, self.ops)


def case_at(
    design: Design,
    demands: Demands,
    hand: Hand | None = None,
    share: float = 1.0,
    *,
    number: Callable[[Number], Number] = lambda x: x,
    ops: Arithmetic = FLOATS,
) -> Case:
    """Return one case at a point; a hand may have arrays of numbers."""
    own, exact, delays = design.device, design.converted(number), delays_of(design.device)
    whole, fraction = split_delay(own.delay, own.sample_time)
    exactly = hand and hand.mapped(number)
    return Case(
        demands=demands,
        design=exact,
        factor=number(demands.factor),
        max_sensitivity=number(demands.max_sensitivity),
        met=_met(demands, number),
        share=number(share),
        delays=delays,
        values={} if exactly is None else exactly.by_key,
        let_go=cache(lambda: plant_let_go(exact.device, whole, ops, fractional=fraction > 0)),
        held=cache(lambda: plant_in_hand(exact.device, exactly or NO_HAND, delays, ops)),
        ops=ops,
    )


# The case of the decimals that the numbers print as, in enclosures
exact_case = partial(case_at, number=decimal, ops=ENCLOSURES)


@lru_cache(maxsize=64)
def cases_over(
    demands: Demands, uncertain: tuple[str, ...] = (), delays: Delays | None = None
) -> Callable[[Values], Case]:
    """Return the case of boxes as a function of the values of their rows and of the other numbers of the design."""
    delays = delays_of(demands.device) if delays is None else delays
    let_go, held = _let_go(demands.device, uncertain), _held(demands.device, uncertain, delays)
    exact, factor = demands.device.converted(decimal), decimal(demands.factor)
    limit = decimal(demands.max_sensitivity)
    met = _met(demands, decimal)

    def case(v: Values) -> Case:
        before, device = v.get(SAMPLES_BEFORE), exact.with_numbers({key: v[f"device.{key}"] for key in uncertain})
        return Case(
            demands=demands,
            design=Design(device, gains_of(v), coupling_of(v)),
            factor=factor,
            max_sensitivity=limit,
            met=met,
            share=v.get(COUPLING_SHARE, 1),
            delays=delays if before is None else replace(delays, loop=before, felt=before),
            values=v,
            let_go=lambda: let_go(v),
            held=lambda: held(v),
            ops=TAYLOR,
        )

    return case


def _met(demands: Demands, number: Callable[[Number], Number]) -> WorldsMet | None:
    worlds = demands.worlds
    return None if worlds is None else WorldsMet(worlds.converted(number), number(demands.factor))


def over(
    margin: Callable[[Case, Number], Number],
    demands: Demands,
    uncertain: tuple[str, ...] = (),
    delays: Delays | None = None,
) -> Margin:
    """Return a margin of cases, or a curve, as a function of the rows of boxes."""
    case = cases_over(demands, uncertain, delays)
    return lambda frequency, v: margin(case(v), frequency)


def _held(nominal: Device, uncertain: tuple[str, ...], delays: Delays) -> Callable[[Values], AnyPlantInHand]:
    """Return the device in a hand as a function of values. Boxes with equal hands and devices share one computation."""
    exact, rows = nominal.converted(decimal), HAND + tuple(f"device.{key}" for key in uncertain)

    if nominal.servo is not None:  # the hand does not affect the servo's motion

        def servo_of(*numbers: Number) -> ServoPlant:
            servo = exact.with_numbers(dict(zip(uncertain, numbers, strict=True)))
            found = plant_in_hand(servo, NO_HAND, delays, TAYLOR)
            assert isinstance(found, ServoInHand)
            return found.plant

        alone, known = rows[len(HAND) :], cache(servo_of)
        return lambda v: ServoInHand(shared(servo_of, [v[name] for name in alone]) if alone else known(), Hand.of(v))

    def plant(*numbers: Number) -> AnyPlantInHand:
        values = dict(zip(rows, numbers, strict=True))
        device = exact.with_numbers({key: values[f"device.{key}"] for key in uncertain})
        return plant_in_hand(device, Hand.of(values), delays, TAYLOR)

    def of_values(v: Values) -> AnyPlantInHand:
        found: AnyPlantInHand = shared(plant, [v[name] for name in rows])
        if SAMPLES_BEFORE in v and isinstance(found, PlantInHand):
            before = v[SAMPLES_BEFORE]
            return replace(found, delays=replace(delays, loop=before, felt=before))
        return found

    return of_values


def _let_go(nominal: Device, uncertain: tuple[str, ...]) -> Callable[[Values], PlantLetGo]:
    """Return the sampled device without a hand as a function of values."""
    exact = nominal.converted(decimal)
    whole, fraction = split_delay(nominal.delay, nominal.sample_time)

    if not uncertain:
        known = cache(lambda: plant_let_go(exact, whole, TAYLOR, fractional=fraction > 0))
        return lambda v: known()
    any_delay = "delay" in uncertain

    def of_numbers(whole: Number, *numbers: Number) -> PlantLetGo:
        one = exact.with_numbers(dict(zip(uncertain, numbers, strict=True)))
        return plant_let_go(one, whole, TAYLOR, fractional=any_delay or fraction > 0)

    def plant(v: Values) -> PlantLetGo:
        rows = [v[f"device.{key}"] for key in uncertain]
        samples = [Enclosure(np.asarray(v[WHOLE_SAMPLES], float))] if any_delay else []
        found: PlantLetGo = shared(of_numbers if any_delay else partial(of_numbers, whole), [*samples, *rows])
        return found

    return plant
