"""The transfer functions of a device's sampled loop as arrays over frequency, without a hand or in a hand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import pi
from typing import TYPE_CHECKING

import numpy as np

from vctune.analysis.extrema import Floats, round_at_resonance
from vctune.analysis.sampled_loop import Complex, loop_gain
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains, SpringDamper
from vctune.model.hands import Hand
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.pair import EvenOdd
from vctune.model.numbers.units import UNITS, Units
from vctune.model.sampled.hand_loop import AnyLoopInHand, CommandInHand, LoopInHand, loop_in_hand, seen_in_hand
from vctune.model.sampled.impedance_display import ForceInHand, firmware_filter, spring_damper_admittance
from vctune.model.sampled.loop_in_worlds import offered_at
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand

if TYPE_CHECKING:
    import control

POINTS, DECADES = 1600, 5.0  # Number of drawn frequencies, and number of decades below Nyquist
SPLINE = 3  # Order of python-control's interpolation
LET_GO = Hand(0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Response:
    """A transfer function at frequencies up to Nyquist."""

    symbol: str  # symbol of the transfer function
    omega: Floats  # frequency, rad/s, in ascending order, shape (n,)
    values: Complex  # complex values, in `unit`, shape (n,)
    unit: str  # unit of the values; "1" if they are dimensionless
    sample_time: float  # T, s

    @property
    def hz(self) -> Floats:
        """The frequencies, Hz."""
        return self.omega / (2 * pi)

    def to_control(self) -> control.FrequencyResponseData:
        """Return the response as python-control's object, with dt in s (needs the extra `control`)."""
        import control

        return control.FrequencyResponseData(
            self.values, self.omega, dt=self.sample_time, smooth=self.omega.size > SPLINE, name=self.symbol
        )

    def __repr__(self) -> str:
        return f"Response({self.symbol} [{self.unit}], {self.omega.size} frequencies{self._band})"

    @property
    def _band(self) -> str:
        return f", {self.hz[0]:.4g} to {self.hz[-1]:.4g} Hz" if self.omega.size else ""


@dataclass(frozen=True, slots=True, eq=False)
class Transfer:
    """A transfer function of the sampled loop."""

    symbol: str  # symbol of the function, such as L, S or Z_c
    unit: str  # unit of the values; "1" if they are dimensionless
    device: Device = field(repr=False)  # device of the loop, with plain numbers
    response: Callable[[Floats], Complex] = field(repr=False)  # values at angles theta = omega T

    def at(self, omega: Floats | None = None, *, hz: Floats | float | None = None) -> Response:
        """Return the values at frequencies, in rad/s or in hertz; by default at those of the report's figures, up to
        Nyquist."""
        grid = up_to_nyquist(self.device)
        if omega is not None or hz is not None:
            grid = np.atleast_1d(np.asarray(omega if hz is None else 2 * pi * np.asarray(hz), float))
        T = float(self.device.sample_time)
        values = np.asarray(self.response(grid * T) + 0 * grid, np.complex128)
        return Response(self.symbol, grid, values, self.unit, T)

    def to_control(self) -> control.FrequencyResponseData:
        """Return `at()` as python-control's object, with dt in s (needs the extra `control`)."""
        return self.at().to_control()


def up_to_nyquist(device: Device) -> Floats:
    """Return five decades of frequencies up to Nyquist, rad/s, with more of them around a structure's resonance."""
    top = 0.5 / float(device.sample_time)
    return 2 * pi * round_at_resonance(device, np.geomspace(top * 10.0**-DECADES, top, POINTS))


@dataclass(frozen=True, slots=True)
class Loop:
    """The sampled loop of a device with all its parts: filter, delay, actuator, structure and sensor.

    The environment is at rest. The frequencies reach Nyquist, pi/T.

    Attributes
    ----------
    device : Device
        Device with plain numbers, SI units; the hand takes the place of its least operator.
    gains : Gains
        K_v, N s/m, and K_p, N/m.
    coupling : AnyCoupling, optional
        Coupling, for Z_c; None if Z_c is not needed.
    hand : Hand, optional
        Hand at the handle, with M, kg, B, N s/m, and K, N/m; None for a device without a hand.
    """

    device: Device
    gains: Gains
    coupling: AnyCoupling | None = None
    hand: Hand | None = None

    @property
    def L(self) -> Transfer:
        """Open loop L = K_v G_v + K_p G_x, from the acting force to the force that the law returns."""
        self._require_loop("L")

        return Transfer("L", "1", self.device, self._open_loop)

    @property
    def S(self) -> Transfer:
        """Sensitivity S = 1/(1 + L), from a disturbance of the commanded force to the commanded force."""
        self._require_loop("S")

        return Transfer("S", "1", self.device, lambda theta: 1 / (1 + self._open_loop(theta)))

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

        return Transfer("Z_seen", self._units.damping, self.device, self._seen)

    @property
    def Y_seen(self) -> Transfer:
        """The admittance of an impedance display, as its environment sees it, from force to differenced position."""
        if self.device.kind.senses_force:
            raise ValueError("Y_seen: an admittance display meets its environment by its force; take Z_seen")

        def met(theta: Floats) -> Complex:
            found = self._held(theta)
            assert isinstance(found, ForceInHand)
            return -0.5j * np.sin(theta / 2) * _quotient(found.met, found.closed(self.gains), theta)

        return Transfer("Y_seen", self._units.mobility, self.device, met)

    @property
    def Z_c(self) -> Transfer:
        """The impedance of the virtual coupling in its discrete form."""
        if self.coupling is None:
            raise ValueError("Z_c: the loop has no coupling; state one, coupling=Coupling(b_c, m_c, b_0)")
        coupling, device = self.coupling, self.device

        def response(theta: Floats) -> Complex:
            if isinstance(coupling, SpringDamper):
                if not device.differences:
                    raise ValueError("Z_c: damper and spring act on two signals, a measured velocity and the position")
                low_pass = firmware_filter(device, theta, FLOATS)
                admittance = spring_damper_admittance(coupling, device.sample_time, low_pass, theta, FLOATS)
                return np.asarray(1 / (admittance.re + 1j * admittance.im))
            found = offered_at(coupling, device.sample_time, device.rule, theta, FLOATS)
            return np.asarray(found.resistance + 1j * found.reactance / np.cos(theta / 2))

        return Transfer("Z_c", self._units.damping, device, response)

    @property
    def motion(self) -> Transfer:
        """The response of a servo's handle velocity to the commanded velocity."""
        servo = self.device.servo
        if servo is None:
            raise ValueError("motion: the device is no servo; its loop is L, its sensitivity S")
        alone = replace(self.device.sensing_at_once, servo=replace(servo, stiffness=None, radii=()))
        # a damper of 1 N s/m resists with the velocity of the handle
        felt = Loop(alone, self.gains, hand=Hand(0.0, 1.0, 0.0)).Z_seen
        return replace(felt, symbol="motion", unit="1")

    @property
    def _units(self) -> Units:
        return UNITS[self.device.units]

    def _require_loop(self, symbol: str) -> None:
        if not self.device.kind.own_loop:
            raise ValueError(f"{symbol}: the loop of a servo is its vendor's; take motion, or Z_seen in a hand")

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


def _quotient(above: EvenOdd, below: EvenOdd, theta: Floats) -> Complex:
    """Return the quotient of two numbers even + j s odd as complex numbers."""
    sin = 1j * np.sin(theta / 2)
    return np.asarray((above.even + sin * above.odd) / (below.even + sin * below.odd))
