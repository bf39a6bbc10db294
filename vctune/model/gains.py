"""Define a design: the gains of the velocity loop and the virtual coupling. SI units."""

from __future__ import annotations

from math import inf
from typing import Annotated, Literal

import numpy as np

from vctune.model.fields import Found, FoundPositive, Key, PositiveOrNull, Shown, record
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.pair import Pair

# How the firmware integrates a coupling: by the trapezoidal rule or, with mass M and drag D alone, M a + D v = F by
# Euler's (model/README.md, section 3)
Rule = Literal["trapezoid", "euler"]


def coupling_impedance(coupling: Coupling, omega: Number) -> Pair:
    """Return the coupling's impedance Z_c(j omega) (model/README.md, section 3; paper eq. 17)."""
    b_c, m_c = coupling.damping, coupling.mass
    reactance = m_c * omega
    if coupling.rigid:
        return Pair(coupling.drag + 0 * omega, reactance)
    quotient = reactance / (b_c * b_c + reactance * reactance)
    return Pair(coupling.drag + b_c * reactance * quotient, b_c * b_c * quotient)


def sampled_resistance(coupling: Coupling, sample_time: Number, rule: Rule, theta: Number, ops: Arithmetic) -> Number:
    """Return Re Z_c of the coupling in the firmware: s is (2/T)(z - 1)/(z + 1) or, by Euler, Z_c is as in README."""
    if rule == "euler":
        sin = ops.sin(theta / 2)
        return coupling.drag * ops.cos(theta) + coupling.mass / sample_time * (2 * (sin * sin))
    if coupling.rigid:  # the mass of a rigid coupling is a pure reactance
        return coupling.drag + 0 * theta
    b_c, reactance, cos = coupling.damping, coupling.mass * (2 * ops.sin(theta / 2)) / sample_time, ops.cos(theta / 2)
    squared, slack = reactance * reactance, b_c * cos
    return coupling.drag + b_c * (squared / (slack * slack + squared))


def sampled_reactance(coupling: Coupling, sample_time: Number, rule: Rule, theta: Number, ops: Arithmetic) -> Number:
    """Return cos(theta/2) Im Z_c of the coupling in the firmware, N s/m. The product is regular at theta = pi."""
    if rule == "euler":
        cos = ops.cos(theta / 2)
        return (coupling.mass / sample_time - coupling.drag) * (2 * ops.sin(theta / 2) * (cos * cos))
    reactance = coupling.mass * (2 * ops.sin(theta / 2)) / sample_time
    if coupling.rigid:
        return reactance
    slack = coupling.damping * ops.cos(theta / 2)
    squared = slack * slack
    return reactance * squared / (squared + reactance * reactance)


def stepped(coupling: Coupling, sample_time: Number, rule: Rule) -> tuple[Number, Number]:
    """Return step s and decay p of the branch beside the drag, f[k] = p f[k-1] + s (v[k] - v[k-1])."""
    if rule == "euler":
        return coupling.mass / sample_time - coupling.drag, 0
    if coupling.rigid:
        return 2 * coupling.mass / sample_time, -1
    a = sample_time * coupling.damping / (2 * coupling.mass)
    return coupling.damping / (1 + a), (1 - a) / (1 + a)


@record
class Gains:
    """The velocity loop's law K = velocity + position/s (paper eq. 3).

    K_v of an impedance display is the injected damping; K_p of it is 0, and both are 0 on a servo.
    """

    velocity: Annotated[Found, Key("K_v, N s/m."), Shown("velocity K_v", digits=8, of="damping")]
    position: Annotated[Found, Key("K_p, N/m."), Shown("position K_p", digits=8, of="stiffness")]

    @property
    def closed(self) -> bool:
        """Whether the gains close a loop. The gains must be plain numbers."""
        return bool(self.velocity != 0 or self.position != 0)


@record
class Coupling:
    """The virtual coupling: damping b_c and mass m_c in series, with a drag b_0 in parallel (paper eq. 17).

    An infinite damping makes it rigid, with mass and drag alone.
    """

    damping: Annotated[
        PositiveOrNull,
        Key("b_c, N s/m; inf for a coupling with only mass and drag."),
        Shown("damping b_c", digits=8, of="damping"),
    ]
    mass: Annotated[FoundPositive, Key("m_c, kg."), Shown("mass m_c", digits=8, of="mass")]
    drag: Annotated[Found, Key("b_0, N s/m."), Shown("drag b_0", digits=8, of="damping")] = 0.0

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


@record
class SpringDamper:
    """The virtual coupling of an impedance display: a spring and a damper in parallel (model/README.md, section 15)."""

    damping: Annotated[Found, Key("b_c, N s/m."), Shown("damping b_c", digits=8, of="damping")]
    stiffness: Annotated[FoundPositive, Key("k_c, N/m."), Shown("stiffness k_c", digits=8, of="stiffness")]

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
