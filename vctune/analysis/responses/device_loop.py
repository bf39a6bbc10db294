"""Provide the transfer functions of a device's sampled loop, without a hand or in a hand, with their units."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.analysis.responses.plant_states import PlantStates, plant_states, servo_states, velocity_states
from vctune.analysis.responses.states import INPUT, Row, Signal, closed, filtered, matrices, substituted, total
from vctune.analysis.responses.transfer import StateSpace, Transfer
from vctune.analysis.sampled_loop import Complex, loop_gain
from vctune.markup import html_table
from vctune.model.coupling import trapezoidal
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains, SpringDamper
from vctune.model.hands import Hand
from vctune.model.loop.filters import low_pass_coefficients
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.pair import EvenOdd
from vctune.model.numbers.units import UNITS, Units
from vctune.model.sampled.hand_loop import AnyLoopInHand, CommandInHand, LoopInHand, loop_in_hand, seen_in_hand
from vctune.model.sampled.impedance_display import ForceInHand, firmware_filter, spring_damper_admittance
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand
from vctune.model.sampled.worlds.loop_in_worlds import offered_at

LET_GO = Hand(0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Loop:
    """The sampled loop of a device with all its parts: filter, delay, actuator, structure and sensor.

    The environment is at rest. The frequencies reach Nyquist, pi/T.

    Attributes
    ----------
    device : device with plain numbers, SI units; the hand takes the place of its least operator
    gains : K_v, N s/m, and K_p, N/m
    coupling : coupling, for Z_c; None if Z_c is not needed
    hand : hand at the handle, with M, kg, B, N s/m, and K, N/m; None for a device without a hand
    """

    device: Device
    gains: Gains
    coupling: AnyCoupling | None = None
    hand: Hand | None = None

    @property
    def L(self) -> Transfer:
        """Open loop L = K_v G_v + K_p G_x, from the acting force to the force that the law returns."""
        self._require_loop("L")
        signals = Signal("force", self._units.force), Signal("answer", self._units.force)

        def realised() -> StateSpace:
            plant = self._law_alone()
            return self._matrices(plant.states, self._answer(plant), signals)

        return Transfer("L", "1", self.device, self._open_loop, realised)

    @property
    def S(self) -> Transfer:
        """Sensitivity S = 1/(1 + L), from a disturbance of the commanded force to the commanded force."""
        self._require_loop("S")
        signals = Signal("disturbance", self._units.force), Signal("command", self._units.force)

        def realised() -> StateSpace:
            plant = self._law_alone()
            command = total([(1.0, {INPUT: 1.0}), (-1.0, self._answer(plant))])
            return self._matrices(closed(plant.states, command), command, signals)

        return Transfer("S", "1", self.device, lambda theta: 1 / (1 + self._open_loop(theta)), realised)

    @property
    def Z_seen(self) -> Transfer:
        """The impedance of the loop in a hand, as the environment of an admittance display or a servo sees it.

        Z_seen is the response of the sensed force to the environment's velocity. A resistance is positive. The hand
        requires R = -Re Z_seen of the coupling.
        """
        hand = self.hand
        if hand is None:
            raise ValueError("Z_seen: no hand is at the handle, and nothing is sensed; state one, hand=Hand(M, B, K)")
        if not self.device.kind.senses_force:
            raise ValueError("Z_seen: an impedance display meets its environment by its motion; take Y_seen")
        signals = Signal("velocity", self._units.speed), Signal("sensed force", self._units.force)

        def realised() -> StateSpace:
            if self.device.servo is not None:
                servo = servo_states(self.device, hand)
                return self._matrices(servo.states, servo.felt, signals)
            plant = plant_states(self.device, hand)
            return self._matrices(self._driven(plant), plant.felt, signals)

        return Transfer("Z_seen", self._units.damping, self.device, self._seen, realised)

    @property
    def Y_seen(self) -> Transfer:
        """The admittance of an impedance display, as its environment sees it, from force to differenced position."""
        if self.device.kind.senses_force:
            raise ValueError("Y_seen: an admittance display meets its environment by its force; take Z_seen")
        signals = Signal("force", self._units.force), Signal("velocity", self._units.speed)

        def realised() -> StateSpace:
            plant = plant_states(self.device, self.hand or LET_GO)
            command = total([(1.0, {INPUT: 1.0}), (-1.0, self._answer(plant))])
            return self._matrices(closed(plant.states, command), {"difference": 1.0}, signals)

        def met(theta: Floats) -> Complex:
            found = self._held(theta)
            assert isinstance(found, ForceInHand)
            return -0.5j * np.sin(theta / 2) * _quotient(found.met, found.closed(self.gains), theta)

        return Transfer("Y_seen", self._units.mobility, self.device, met, realised)

    @property
    def Z_c(self) -> Transfer:
        """The impedance of the virtual coupling in its discrete form."""
        if self.coupling is None:
            raise ValueError("Z_c: the loop has no coupling; state one, coupling=Coupling(b_c, m_c, b_0)")
        signals = Signal("velocity", self._units.speed), Signal("coupling force", self._units.force)
        coupling, device = self.coupling, self.device

        def response(theta: Floats) -> Complex:
            if isinstance(coupling, SpringDamper):
                low_pass = firmware_filter(device, theta, FLOATS)
                admittance = spring_damper_admittance(coupling, device.sample_time, low_pass, theta, FLOATS)
                return np.asarray(1 / (admittance.re + 1j * admittance.im))
            found = offered_at(coupling, device.sample_time, theta, FLOATS)
            return np.asarray(found.resistance + 1j * found.reactance / np.cos(theta / 2))

        def realised() -> StateSpace:
            states, force = _coupling_states(device, coupling)
            return self._matrices(states, force, signals)

        return Transfer("Z_c", self._units.damping, device, response, realised)

    @property
    def motion(self) -> Transfer:
        """The response of a servo's handle velocity to the commanded velocity."""
        servo = self.device.servo
        if servo is None:
            raise ValueError("motion: the device is no servo; its loop is L, its sensitivity S")
        alone = replace(self.device.sensing_at_once, servo=replace(servo, stiffness=None, radii=()))
        # a damper of 1 N s/m resists with the velocity of the handle
        felt = Loop(alone, self.gains, hand=Hand(0.0, 1.0, 0.0)).Z_seen
        speed = self._units.speed
        signals = Signal("commanded velocity", speed), Signal("velocity", speed)
        return replace(
            felt, symbol="motion", unit="1", realised=lambda: replace(
                felt.state_space, inputs=(str(signals[0]),), outputs=(str(signals[1]),)
            )
        )  # fmt: skip

    @property
    def _units(self) -> Units:
        return UNITS[self.device.units]

    def _require_loop(self, symbol: str) -> None:
        if not self.device.kind.own_loop:
            raise ValueError(f"{symbol}: the loop of a servo is its vendor's; take motion, or Z_seen in a hand")

    def _law_alone(self) -> PlantStates:
        """Return the plant with the outputs that the law needs. If K_p is 0, the only output is the velocity."""
        made = plant_states if self.gains.position else velocity_states
        return made(self.device, self.hand or LET_GO)

    def _answer(self, plant: PlantStates) -> Row:
        """Return the force that the law commands while the environment is at rest."""
        return total([(float(self.gains.velocity), plant.velocity), (float(self.gains.position), plant.position)])

    def _driven(self, plant: PlantStates) -> dict[str, Row]:
        """Return the states for a moving environment. The law then acts on the errors of velocity and position."""
        T, K_v, K_p = float(self.device.sample_time), float(self.gains.velocity), float(self.gains.position)
        command = total([(K_v + K_p * T / 2, {INPUT: 1.0}), (K_p, {"error": 1.0}), (-K_v, plant.velocity)])
        error = total([(1.0, {"error": 1.0, INPUT: T}), (-1.0, substituted(plant.moved, command))])
        return closed(plant.states, command) | {"error": error}

    def _held(self, theta: Floats) -> AnyLoopInHand:
        device, servo = self.device, self.device.servo
        if servo is not None:  # the nominal response, not the disc around it
            device = replace(device, servo=replace(servo, radii=()))
        return loop_in_hand(plant_in_hand(device, self.hand or LET_GO, delays_of(device), FLOATS), theta, FLOATS)

    def _open_loop(self, theta: Floats) -> Complex:
        if self.hand is None:
            return loop_gain(self.device, self.gains, theta / self.device.sample_time)
        found = self._held(theta)
        assert not isinstance(found, CommandInHand)
        answered = found.velocity.scaled(self.gains.velocity)
        if isinstance(found, LoopInHand):
            answered = answered + found.position.scaled(self.gains.position)
        return _quotient(answered, found.open, theta)

    def _seen(self, theta: Floats) -> Complex:
        found = seen_in_hand(self._held(theta), self.gains)
        return np.asarray(-(found.lost + 1j * found.swing / np.sin(theta / 2)) / found.size)

    def _matrices(self, states: dict[str, Row], output: Row, signals: tuple[Signal, Signal]) -> StateSpace:
        units = {name: self._units.of(OF_STATE.get(name.partition("[")[0].split()[0], "force")) for name in states}
        return matrices(states, output, units, signals, float(self.device.sample_time))

    def _repr_html_(self) -> str:
        return html_table("loop", [(type(each).__name__, str(each)) for each in self._parts if each is not None])

    @property
    def _parts(self) -> tuple[Device, Gains, AnyCoupling | None, Hand | None]:
        return self.device, self.gains, self.coupling, self.hand


# Quantity of a state by the first word of its name; all other states are forces
OF_STATE = {
    "position": "position",
    "bend": "position",
    "error": "position",
    "velocity": "speed",
    "handle": "speed",
    "difference": "speed",
    "commanded": "speed",
}


def _quotient(above: EvenOdd, below: EvenOdd, theta: Floats) -> Complex:
    """Return the quotient of two numbers even + j s odd as complex numbers."""
    sin = 1j * np.sin(theta / 2)
    return np.asarray((above.even + sin * above.odd) / (below.even + sin * below.odd))


def _coupling_states(device: Device, coupling: AnyCoupling) -> tuple[dict[str, Row], Row]:
    """Return the states of a coupling with a velocity as its input, and the row of its force."""
    T, states = float(device.sample_time), dict[str, Row]()
    velocity: Row = {INPUT: 1.0}
    if isinstance(coupling, SpringDamper):
        stretched = total([(1.0, {"position": 1.0}), (T, velocity)])
        states["position"], estimate = stretched, device.velocity
        if estimate is not None and estimate.filter_hz is not None:
            share, _ = low_pass_coefficients(float(estimate.filter_hz), T, FLOATS)
            velocity = filtered(states, "velocity", velocity, share, estimate.filter_order)
        return states, total([(coupling.damping, velocity), (coupling.stiffness, stretched)])
    step, decay = (float(x) for x in trapezoidal(coupling, T))
    force = total([(1.0, {"force": 1.0}), (step, velocity)])
    states["force"] = total([(decay, force), (-step, velocity)])
    return states, total([(1.0, force), (float(coupling.drag), velocity)])
