"""What a design is about: the device, its velocity loop and its virtual coupling. SI units."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from vctune.model.arithmetic import Number

Hold = Literal["zoh", "lag"]


@dataclass(frozen=True, slots=True)
class Device:
    """An admittance display: Z_d = mass s + damping, sampled and held (DESIGN 1.1).

    Attributes
    ----------
    mass : kg, > 0
    damping : N s/m, >= 0
    sample_time : s, > 0
    delay : s, >= 0, from sampling to actuation, beyond the hold
    hold : "zoh", the exact (1-e^{-sT})/(sT), or "lag", the paper's 2/(2+sT)
    """

    mass: Number
    damping: Number
    sample_time: Number
    delay: Number
    hold: Hold

    @property
    def lag(self) -> Number:
        """tau = T/2 + delay, the loop's low-frequency lag, s."""
        return self.sample_time / 2 + self.delay


@dataclass(frozen=True, slots=True)
class Gains:
    """The velocity loop's law K = velocity + position/s, in N s/m and N/m (paper eq. 3)."""

    velocity: Number
    position: Number


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
