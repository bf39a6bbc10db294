"""What a design is about: the device, its velocity loop and its virtual coupling. SI units."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

from vctune.model.arithmetic import Number

Hold = Literal["zoh", "lag"]


@dataclass(frozen=True, slots=True)
class LeastOperator:
    """The least impedance Z_h = mass s + damping of the hand that is always at the handle.

    Attributes
    ----------
    mass : m_h, kg, >= 0
    damping : b_h, N s/m, >= 0
    """

    mass: Number
    damping: Number


@dataclass(frozen=True, slots=True)
class Device:
    """An admittance display: Z_d = mass s + damping, sampled and held (model/README.md, section 1).

    Attributes
    ----------
    mass : kg, > 0
    damping : N s/m, >= 0
    sample_time : s, > 0
    delay : s, >= 0, from sampling to actuation, beyond the hold
    hold : "zoh", the exact (1-e^{-sT})/(sT), or "lag", the paper's 2/(2+sT)
    operator : what is always at the handle; None if nothing need be
    """

    mass: Number
    damping: Number
    sample_time: Number
    delay: Number = 0.0
    hold: Hold = "zoh"
    operator: LeastOperator | None = None

    @property
    def bare(self) -> Device:
        """The device when it is let go."""
        return replace(self, operator=None)

    @property
    def with_operator(self) -> Device:
        """The device with its least operator absorbed: W = Z_d + Z_h in place of Z_d."""
        if self.operator is None:
            return self
        mass, damping = self.mass + self.operator.mass, self.damping + self.operator.damping
        return replace(self, mass=mass, damping=damping, operator=None)

    def converted(self, number: Callable[[Number], Number]) -> Device:
        """Return the device in numbers of another arithmetic."""
        operator = self.operator and LeastOperator(number(self.operator.mass), number(self.operator.damping))
        mass, damping, sample_time, delay = map(number, (self.mass, self.damping, self.sample_time, self.delay))
        return Device(
            mass=mass, damping=damping, sample_time=sample_time, delay=delay, hold=self.hold, operator=operator
        )

    @property
    def loops(self) -> tuple[Device, ...]:
        """The devices whose velocity loops must be stable by themselves."""
        return (self,) if self.operator is None else (self.bare, self.with_operator)

    @property
    def loop_lag(self) -> Number:
        """tau = T/2 + delay, the loop's low-frequency lag, s."""
        return self.sample_time / 2 + self.delay


@dataclass(frozen=True, slots=True)
class Gains:
    """The velocity loop's law K = velocity + position/s, in N s/m and N/m (paper eq. 3)."""

    velocity: Number
    position: Number

    @property
    def closed(self) -> bool:
        """Whether there is a loop at all; of plain numbers."""
        return bool(self.velocity != 0 or self.position != 0)


@dataclass(frozen=True, slots=True)
class Coupling:
    """The virtual coupling: damping b_c and mass m_c in series, beside a drag b_0 (paper eq. 17).

    Attributes
    ----------
    damping : b_c, N s/m
    mass : m_c, kg
    drag : b_0, N s/m
    """

    damping: Number
    mass: Number
    drag: Number
