"""Define the device and its parts. SI units."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import GetPydanticSchema
from pydantic_core.core_schema import literal_schema

from vctune.model.display import DISPLAYS, STEPPED, Display, DisplayName
from vctune.model.fields import Internal, Key, Listed, NotNegative, Positive, record
from vctune.model.gains import Rule
from vctune.model.hands import LeastOperator
from vctune.model.numbers.arithmetic import Number
from vctune.model.numbers.units import UnitSystem
from vctune.model.parts import (
    INERT,
    LATENCY,
    NUMBERS,
    OF_FIRMWARE,
    PART_NUMBERS,
    PARTS,
    UNMODELLED_KEYS,
    Actuator,
    ForceSensor,
    Servo,
    Structure,
    Unmodelled,
    VelocityEstimate,
)

Hold = Literal["zoh", "lag"]
# Kinds of command: the force of a motor, or the velocity or position that a servo follows
Commanded = Literal["force", "velocity", "position"]


def unit_of_number(key: str, impedance: Number, time: Number) -> Number:
    """Return the unit of a parameter of a device, by its key, where impedance and time are the units of these."""
    quantity = "time" if key == LATENCY else PART_NUMBERS[key].quantity
    units = {"mass": impedance * time, "damping": impedance, "stiffness": impedance / time}
    return (units | {"time": time, "rate": 1 / time, "ratio": 1.0})[quantity]


@record
class Device:
    """The mechanism Z_d = mass s + damping, its parts, and the firmware that samples and holds."""

    # model/README.md, sections 1, 15 and 17; of a servo, mass is 1 and damping 0, and both have no effect
    mass: Annotated[Positive, Key("Moving mass, kg.")]
    damping: Annotated[NotNegative, Key("Viscous damping, N s/m.")]
    sample_time: Annotated[Positive, Key("Sample time of the velocity loop, s.")]
    delay: Annotated[
        NotNegative,
        Key(
            "Delay between sampling and actuation, s, without the delay of the hold; at most 200 sample times, "
            "uncertainty included."
        ),
    ] = 0.0
    hold: Annotated[Hold, Key("Hold: exact zero-order hold, or the paper's first-order lag 2/(2+sT).")] = "zoh"
    operator: Internal[LeastOperator | None] = None  # the least operator, a load that is always at the handle
    velocity: Annotated[VelocityEstimate | None, Key("Default: measured without delay.")] = None
    actuator: Annotated[Actuator | None, Key("Default: the force follows the command without lag.")] = None
    force_sensor: Annotated[ForceSensor | None, Key("Default: the force is sensed without delay.")] = None
    structure: Annotated[
        Structure | None,
        Listed(3),
        Key(
            "A handle on a spring, or as [[device.structure]] a chain of up to three springs from the motor to the "
            "handle. Default: rigid."
        ),
    ] = None
    structure_2: Annotated[
        Structure | None, Key("The second [[device.structure]], as messages and [uncertainty] call it. Default: none.")
    ] = None
    structure_3: Annotated[Structure | None, Key("The third one. Default: none.")] = None
    unmodelled: Internal[Unmodelled | None] = None  # one response from the uncertainty set; None for the nominal one
    display: Annotated[
        DisplayName,
        GetPydanticSchema(lambda *_: literal_schema(["admittance", "impedance"])),
        Key('Kind of display. "admittance": force in, velocity out. "impedance": motion in, force out.'),
    ] = "admittance"
    servo: Internal[Servo | None] = None
    summed: Internal[bool] = False  # whether the firmware's x_e is x_e + T v_e, as ROS 2's, not the trapezoidal sum
    rule: Internal[Rule] = "trapezoid"  # how the firmware integrates the coupling
    units: Annotated[
        UnitSystem,
        Key(
            "Kind of motion of the handle. For a rotary device (a wheel, a knob, a joint), read kg m2, rad and N m for "
            "every kg, m and N of this file. The mass is then the moment of inertia. The keys keep their names."
        ),
    ] = "linear"
    friction: Annotated[
        NotNegative | None,
        Key("Dry (Coulomb) friction of the motor, N. No proof of stability counts on it. Default: not stated."),
    ] = None

    def __repr__(self) -> str:
        values = {each.name: (getattr(self, each.name), each.default) for each in fields(self)}
        told = [(name, value) for name, (value, default) in values.items() if value is not default]
        return f"Device({', '.join(f'{name}={value!r}' for name, value in told)})"

    @property
    def kind(self) -> Display:
        """The kind of display: admittance (force in, motion out), impedance (motion in, force out), or servo."""
        return STEPPED if self.rule == "euler" else DISPLAYS[self.display]

    @property
    def commanded(self) -> Commanded:
        """The quantity that the firmware commands."""
        return "force" if self.servo is None else self.servo.command

    @property
    def differences(self) -> bool:
        """Whether the firmware's velocity is the difference of the position."""
        source = None if self.velocity is None else self.velocity.source
        return source == "difference" or (source is None and self.kind.differences)

    @property
    def coupling_may_drive(self) -> bool:
        """Whether the coupling may have Re 1/Z_c < 0, as on an impedance display with two low-passes of the velocity
        or with sections."""
        known = self.velocity
        if not self.kind.inverse or known is None:
            return False
        filtered = known.filter_hz is not None or known.filter_coefficient is not None
        return self.coupling_may_turn or (filtered and known.filter_order > 1)

    @property
    def coupling_may_turn(self) -> bool:
        """Whether 1/Z_c may have a pole outside the unit circle, as with sections that turn by more than two low-passes
        of the velocity."""
        return self.kind.inverse and self.velocity is not None and self.velocity.sections is not None

    @property
    def bare(self) -> Device:
        """The device with a free handle."""
        return replace(self, operator=None)

    @property
    def ideal(self) -> bool:
        """Whether the device is rigid and measures, actuates and senses without delay."""
        others = (getattr(self, part) is None for part in PARTS if part not in ("servo", "force_sensor"))
        return self.unmodelled is None and all(others) and not self.senses_late

    @property
    def modelled(self) -> Device:
        """The device with its nominal response."""
        return self if self.unmodelled is None else replace(self, unmodelled=None)

    @property
    def undisturbed(self) -> Device:
        """The device without a disc around its response, whose middle it is."""
        servo = self.servo
        return self.modelled if servo is None else replace(self, servo=replace(servo, radii=()))

    @property
    def with_operator(self) -> Device:
        """The device whose handle carries its least operator: for a rigid device, Z_d + Z_h takes the place of Z_d."""
        if self.operator is None:
            return self
        if self.structure is not None:
            return replace(self, structure=replace(self.structure, load=self.operator), operator=None)
        mass, damping = self.mass + self.operator.mass, self.damping + self.operator.damping
        return replace(self, mass=mass, damping=damping, operator=None)

    @property
    def loops(self) -> tuple[Device, ...]:
        """The devices whose velocity loops must be stable on their own: with a free handle and with the least
        operator."""
        if not self.kind.own_loop:
            return ()
        return (self,) if self.operator is None else (self.bare, self.with_operator)

    @property
    def modes(self) -> tuple[Structure, ...]:
        """The springs from the motor to the handle."""
        return tuple(each for each in (self.structure, self.structure_2, self.structure_3) if each is not None)

    @property
    def at_handle(self) -> bool:
        """Whether the firmware reads position and velocity of the handle, behind the springs, not of the motor."""
        return self.velocity is not None and self.velocity.at == "handle"

    @property
    def motor_mass(self) -> Number:
        """The mass that the motor drives directly, kg. A rigid device has its whole mass there."""
        mass = self.mass
        for each in self.modes:
            mass = mass - each.handle_mass
        return mass

    @property
    def counted_on(self) -> LeastOperator | None:
        """What a proof of any passive hand counts on in every hand. An impedance display may meet any mass, and the
        bound of a flexible one counts on nothing."""
        if self.operator is None or not self.kind.inverse:
            return self.operator
        damping = self.operator.damping
        return None if self.structure is not None or damping == 0 else LeastOperator(0.0, damping)

    @property
    def least_damping(self) -> Number:
        """b + b_h, the damping of the device in the hand of its least operator, N s/m."""
        return self.damping if self.operator is None else self.damping + self.operator.damping

    def number(self, key: str) -> Number:
        """Return a parameter of the device by its key."""
        of: Any = self
        for name in key.split("."):
            of = getattr(of, name) if of is not None else None
        return of

    def numbers(self) -> dict[str, Number]:
        """Return the numbers that the device has, by their keys of `NUMBERS`."""
        found = {key: self.number(key) for key in NUMBERS if self.servo is None or key not in INERT}
        return {key: number for key, number in found.items() if number is not None}

    def _varying(self) -> dict[str, Number]:
        """Return all parameters of the device: those of the mechanism, of the firmware, and of the unmodelled
        response."""
        perturbed = {key: self.number(key) for key in UNMODELLED_KEYS if self.unmodelled is not None}
        return self.numbers() | self._exact() | perturbed

    def _exact(self) -> dict[str, Number]:
        return {key: number for key in (*OF_FIRMWARE, LATENCY) if (number := self.number(key)) is not None}

    def with_numbers(self, numbers: Mapping[str, Number]) -> Device:
        """Return the device with some of its numbers replaced, by their keys. The device must have their parts."""
        parts: dict[str, dict[str, Number]] = {}
        own: dict[str, Any] = {}
        for key, number in numbers.items():
            part, _, name = key.rpartition(".")
            (parts.setdefault(part, {}) if part else own)[name] = number
        own |= {part: replace(getattr(self, part), **changed) for part, changed in parts.items()}
        return replace(self, **own)

    def converted(self, number: Callable[[Number], Number]) -> Device:
        """Return the device with its numbers in another arithmetic. The radii of its discs stay floats."""
        same = self.with_numbers({key: number(value) for key, value in self._varying().items()})
        return same._with_hands(lambda hand: LeastOperator(number(hand.mass), number(hand.damping)))

    def in_units(self, impedance: Number, time: Number) -> Device:
        """Return the device in other units of impedance and time."""
        numbers = self.numbers() | self._exact()
        scaled = {key: value / unit_of_number(key, impedance, time) for key, value in numbers.items()}
        same = self.with_numbers(scaled)
        if same.friction is not None:
            same = replace(same, friction=same.friction * time / impedance)
        if same.servo is not None:
            radii = tuple((hz * time, radius) for hz, radius in same.servo.radii)
            same = replace(same, servo=replace(same.servo, radii=radii))
        if same.unmodelled is not None:
            radii = tuple((hz * time, radius) for hz, radius in same.unmodelled.radii)
            same = replace(same, unmodelled=replace(same.unmodelled, radii=radii))
        return same._with_hands(lambda hand: LeastOperator(hand.mass / (impedance * time), hand.damping / impedance))

    def _with_hands(self, changed: Callable[[LeastOperator], LeastOperator]) -> Device:
        """Return the device after applying a function to its least operator and to the load on its handle."""
        structure = self.structure
        if structure is not None and structure.load is not None:
            structure = replace(structure, load=changed(structure.load))
        return replace(self, structure=structure, operator=self.operator and changed(self.operator))

    @property
    def digital(self) -> bool:
        """Whether the firmware has a filter of given coefficients, which is designed for one sample time."""
        filters = (part for part in (self.velocity, self.force_sensor) if part is not None)
        return any(part.sections is not None or part.filter_coefficient not in (None, 1) for part in filters)

    @property
    def loop_lag(self) -> Number:
        """The lag of hold and delay at low frequency, T/2 + `latency`, s, without the lags of other parts."""
        return self.sample_time / 2 + self.latency

    @property
    def delay_key(self) -> str:
        """The key of the number that `latency` returns."""
        return "delay" if self.servo is None else "servo.delay"

    @property
    def divided(self) -> bool:
        """Whether only the latency of a servo is known, which is divided into delay and lag in any way."""
        return self.servo is not None and self.servo.latency is not None

    @property
    def stated_delay(self) -> Number:
        """The delay that a file states under `delay_key`, s: for a servo without a bandwidth its whole latency."""
        return self.latency if self.servo is None or self.servo.latency is None else self.servo.latency

    @property
    def sensing(self) -> ForceSensor:
        """The force sensor. A device without one gets an ideal sensor."""
        return self.force_sensor if self.force_sensor is not None else ForceSensor()

    @property
    def senses_late(self) -> bool:
        """Whether the device has a force sensor with a low-pass, a delay or a filter."""
        sensor = self.sensing
        at_once = isinstance(sensor.delay, float) and sensor.delay == 0
        others = sensor.bandwidth_hz, sensor.filter_coefficient, sensor.sections
        return not at_once or any(each is not None for each in others)

    @property
    def sensing_at_once(self) -> Device:
        """The device with an ideal force sensor."""
        return replace(self, force_sensor=None)

    @property
    def sensed_latency(self) -> Number:
        """The sum of the delays of device and force sensor, s. It does not contain the lags of low-passes."""
        return self.latency if self.force_sensor is None else self.latency + self.force_sensor.delay

    @property
    def interpolates(self) -> bool:
        """Whether a servo interpolates between positions that are trapezoidal sums of velocities. Interpolated between
        x += T v by Euler, it moves as by the held velocity v."""
        return self.servo is not None and self.servo.command == "position" and self.rule == "trapezoid"

    @property
    def latency(self) -> Number:
        """The delay from sampling to actuation, in addition to the hold, s: `delay`, or that of the servo."""
        return self.delay if self.servo is None else self.servo.delay


def devices_as_one(devices: Sequence[Device], shape: tuple[int, ...] = (-1,)) -> Device:
    """Return several devices as one device. Its numbers are arrays of shape (n,), or floats where all devices agree."""
    first, *others = devices
    if not others:
        return first
    columns = {key: [device.number(key) for device in devices] for key in first._varying()}
    return first.with_numbers(
        {key: np.reshape(np.array(each, float), shape) for key, each in columns.items() if len(set(each)) > 1}
    )
