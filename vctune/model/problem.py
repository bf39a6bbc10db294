"""Define a design problem with all defaults filled in, which the rest of vctune takes as input. SI units."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from math import pi
from typing import Literal

from vctune.model.demands import Demands
from vctune.model.device import Device, unit_of_number
from vctune.model.experiment import Experiment
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.hands import Hand, Hands, passive_hand
from vctune.model.numbers.units import UNITS, Units, hertz
from vctune.model.transparency import TERMS, TermName, Terms
from vctune.model.worlds import Worlds, WorldsMet

Norm = Literal["rms", "peak"]
# Hands that a problem requires: any passive hand; a box of hands, in the sampled loop; or both
Criterion = Literal["passive", "hands", "both"]
# Human hands on a linear device, from no hand to a firm grip (model/README.md, section 14)
HUMAN_HANDS = Hands(Hand(0.0, 0.0, 0.0), Hand(0.5, 30.0, 3000.0))


@dataclass(frozen=True, slots=True)
class Range:
    """The permitted values of a variable. If min = max, the variable is fixed."""

    min: float
    max: float

    @property
    def fixed(self) -> bool:
        """Whether the variable is fixed."""
        return self.min == self.max

    def times(self, factor: float) -> Range:
        """Return this range in another unit."""
        return Range(self.min * factor, self.max * factor)


@dataclass(frozen=True, slots=True)
class Band:
    """A closed band of angular frequencies, rad/s."""

    min: float
    max: float

    @property
    def hz(self) -> tuple[float, float]:
        """The edges of the band, Hz."""
        return hertz(self.min), hertz(self.max)


ABSENT = Range(0.0, 0.0)  # The range of a variable that a display does not have


@dataclass(frozen=True, slots=True)
class Bounds:
    """The ranges of the design variables; `ABSENT` for a variable that the kind of display lacks."""

    velocity: Range  # K_v, N s/m; absent on a servo
    position: Range  # K_p, N/m; absent on an impedance display and on a servo
    damping: Range  # b_c, N s/m
    mass: Range  # m_c, kg, and b_0, N s/m; absent on an impedance display
    drag: Range
    stiffness: Range = ABSENT  # k_c, N/m, of an impedance display; absent on all others

    @property
    def fixed(self) -> bool:
        """Whether every variable is fixed."""
        return all(getattr(self, field.name).fixed for field in fields(self))


@dataclass(frozen=True, slots=True)
class Transparency:
    """The objective (model/README.md, section 8): band, reference impedance Z_0 [N s/m], norm, weights."""

    band: Band
    reference_impedance: float
    norm: Norm
    weights: Terms


@dataclass(frozen=True, slots=True)
class Stability:
    """The requirements (design/README.md, section 1)."""

    band: Band  # band of Llewellyn's conditions; no claim about an impedance display or a servo depends on it
    safety_factor: float  # least permitted Re Z_c / R; for an impedance display Re (1/Z_c) / R
    max_sensitivity: float  # greatest permitted |S| of the sampled loop; without effect for a servo
    criterion: Criterion = "passive"  # hands that the problem requires
    rest: bool = False  # whether the device must rest between the steps of its encoder (`vctune.model.rest`)
    calm: bool = False  # whether no kick may keep the device moving, as simulated (`vctune.simulation.kicks`)
    damping_ratio: float | None = None  # least ratio of every oscillation in the stated hands; None for none


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """The uncertainty of the device: how far its parameters and its response may deviate from the stated values."""

    half_widths: tuple[tuple[str, float], ...]  # shares of the stated values
    objective: Literal["nominal", "worst"]
    unmodelled: tuple[tuple[float, float], ...] = ()
    ranges: tuple[tuple[str, Range], ...] = ()  # of parameters whose range is stated instead of a share

    @property
    def keys(self) -> tuple[str, ...]:
        """The keys of the parameters that may deviate."""
        return tuple(key for key, _ in (*self.half_widths, *self.ranges))

    def in_units(self, impedance: float, time: float) -> Uncertainty:
        """Return the uncertainty in other units of impedance, N s/m, and time, s."""
        return replace(
            self,
            unmodelled=tuple((hz * time, radius) for hz, radius in self.unmodelled),
            ranges=tuple((key, ends.times(1 / unit_of_number(key, impedance, time))) for key, ends in self.ranges),
        )


@dataclass(frozen=True, slots=True)
class Problem:
    """A design problem, and the experiments in which to simulate its design.

    The design does not depend on the experiments.

    See design/README.md, section 1; document/README.md, section 1.

    The constraints apply to the nominal device or, with `uncertainty`, to every device of its box. They apply with
    every environment that is passive in its discrete form or, with `worlds`, with every environment of that box.
    """

    name: str
    description: str
    device: Device
    bounds: Bounds
    transparency: Transparency
    stability: Stability
    uncertainty: Uncertainty | None = None
    experiments: tuple[Experiment, ...] = ()
    hands: Hands = HUMAN_HANDS
    worlds: Worlds | None = None
    rigid: bool = False  # whether the environment is rigid, so that the coupling of an impedance display is a wall

    @property
    def units(self) -> Units:
        """The names and units of the problem's quantities."""
        return UNITS[self.device.units]

    @property
    def passive(self) -> bool:
        """Whether the problem requires any passive hand on the band, on an admittance display."""
        return self.stability.criterion != "hands" and self.device.kind.banded

    @property
    def alone(self) -> bool:
        """Whether the claim about any passive hand is one with nothing behind the coupling."""
        return self.passive and self.worlds is not None

    @property
    def any_hand(self) -> bool:
        """Whether the problem requires any passive hand at every frequency, on an impedance display."""
        return self.stability.criterion != "hands" and not self.device.kind.banded

    @property
    def passive_hand(self) -> str:
        """The hands of a claim about any passive hand, in words."""
        return passive_hand(self.device.counted_on, self.units)

    @property
    def hands_met(self) -> Hands | None:
        """The box of hands in which the sampled loop must be stable; None if the claim for any passive hand suffices.

        That claim suffices with the criterion "passive". On an impedance display it includes these hands, so that it
        suffices with the criterion "both" as well.
        """
        return None if self.stability.criterion == "passive" or self.any_hand else self.hands

    @property
    def worlds_met(self) -> WorldsMet | None:
        """The required linear environments and the safety factor; None for every passive environment."""
        return self.demands.worlds_met

    @property
    def demands(self) -> Demands:
        """The claims to prove for a design."""
        stability = self.stability
        return Demands(
            device=self.device.modelled,
            band=(stability.band.min, stability.band.max),
            factor=stability.safety_factor,
            max_sensitivity=stability.max_sensitivity,
            passive=self.passive,
            any_hand=self.any_hand,
            hands=self.hands_met,
            worlds=self.worlds,
            rigid=self.rigid,
            rest=stability.rest,
            damping_ratio=stability.damping_ratio,
        )

    @property
    def counted(self) -> tuple[TermName, ...]:
        """The terms that the error counts: those with a weight, without what an impedance display itself adds.

        Without a K_v to choose, no design changes its two terms of free motion; without a structure, K_v changes one.
        """
        weights, own = self.transparency.weights, set[TermName]()
        if self.device.kind.inverse and weights.coupling > 0:
            own = {"tracking"} if self.device.structure is None else own
            own = {"tracking", "admittance"} if self.bounds.velocity.fixed else own
        return tuple(term for term in TERMS if getattr(weights, term) > 0 and term not in own)

    @property
    def apart(self) -> tuple[TermName, ...]:
        """The terms with a weight that the error does not count: what is felt of the device itself when free."""
        weights = self.transparency.weights
        return tuple(term for term in TERMS if getattr(weights, term) > 0 and term not in self.counted)

    @property
    def weights(self) -> Terms:
        """The weights of the terms of the error, 0 for a term that the error does not count."""
        return Terms(**{term: getattr(self.transparency.weights, term) * (term in self.counted) for term in TERMS})

    @property
    def nyquist(self) -> float:
        """The Nyquist frequency, half the sampling rate, rad/s."""
        return pi / self.device.sample_time

    @property
    def fixed_design(self) -> tuple[Gains, AnyCoupling]:
        """The gains and the coupling of a problem that fixes every variable; otherwise the lower ends of the ranges."""
        kind = self.device.kind
        fixed = [getattr(self.bounds, name).min for name in kind.names]
        return Gains(*fixed[:2]), kind.coupling(*fixed[2:])

    def in_units(self, impedance: float, time: float) -> Problem:
        """Return the problem in other units of impedance and time, without its experiments.

        Parameters
        ----------
        impedance : float
            The new unit of impedance, N s/m, > 0.
        time : float
            The new unit of time, s, > 0.

        Returns
        -------
        Problem
            Its angular frequencies are in rad per unit of time, and its other frequencies in cycles per unit of time.
            If the device's sample time is the unit, T is 1.
        """
        Z, t = 1 / impedance, 1 / time
        bounds, transparency, stability = self.bounds, self.transparency, self.stability
        return replace(
            self,
            device=self.device.in_units(impedance, time),
            bounds=Bounds(
                velocity=bounds.velocity.times(Z),
                position=bounds.position.times(Z / t),
                damping=bounds.damping.times(Z),
                mass=bounds.mass.times(Z * t),
                drag=bounds.drag.times(Z),
                stiffness=bounds.stiffness.times(Z / t),
            ),
            transparency=replace(
                transparency,
                band=Band(transparency.band.min / t, transparency.band.max / t),
                reference_impedance=transparency.reference_impedance * Z,
            ),
            stability=replace(
                stability,
                band=Band(stability.band.min / t, stability.band.max / t),
            ),
            uncertainty=self.uncertainty and self.uncertainty.in_units(impedance, time),
            experiments=(),
            hands=self.hands.in_units(impedance, time),
            worlds=self.worlds and self.worlds.in_units(impedance, time),
        )
