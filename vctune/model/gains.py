"""Define a design: the gains of the velocity loop and the virtual coupling. SI units."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np

from vctune.model.numbers.arithmetic import Number


@dataclass(frozen=True, slots=True)
class Gains:
    """The velocity loop's law K = velocity + position/s (paper eq. 3).

    Attributes
    ----------
    velocity : K_v, N s/m; on an impedance display the injected damping; 0 on a servo
    position : K_p, N/m; 0 on an impedance display and on a servo
    """

    velocity: Number
    position: Number

    @property
    def closed(self) -> bool:
        """Whether the gains close a loop. The gains must be plain numbers."""
        return bool(self.velocity != 0 or self.position != 0)


@dataclass(frozen=True, slots=True)
class Coupling:
    """The virtual coupling: damping b_c and mass m_c in series, with a drag b_0 in parallel (paper eq. 17).

    Attributes
    ----------
    damping : b_c, N s/m, > 0; inf for a rigid coupling, which has mass and drag alone
    mass : m_c, kg
    drag : b_0, N s/m
    """

    damping: Number
    mass: Number
    drag: Number

    @property
    def rigid(self) -> bool:
        """Whether b_c is infinite. In every arithmetic an infinite b_c is a plain float or an array of floats."""
        damping = self.damping
        if isinstance(damping, np.ndarray):
            return bool(damping.size) and bool(np.isinf(damping).all())
        return isinstance(damping, float) and damping == inf

    def times(self, share: Number) -> Coupling:
        """Return the coupling whose impedance is the impedance of this coupling times a share."""
        return Coupling(self.damping if self.rigid else self.damping * share, self.mass * share, self.drag * share)


@dataclass(frozen=True, slots=True)
class SpringDamper:
    """The virtual coupling of an impedance display: a spring and a damper in parallel (model/README.md, section 15)."""

    damping: Number  # b_c, N s/m, >= 0
    stiffness: Number  # k_c, N/m

    @property
    def rigid(self) -> bool:
        """Whether the coupling is rigid; False, because a spring never is."""
        return False


# The coupling between device and virtual world: `SpringDamper` for an impedance display, `Coupling` for an admittance
# display and for a servo
AnyCoupling = Coupling | SpringDamper


def series_coupling(coupling: AnyCoupling) -> Coupling:
    """Return a coupling after asserting that it belongs to an admittance display or a servo."""
    assert not isinstance(coupling, SpringDamper)
    return coupling
