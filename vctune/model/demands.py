"""The constraints on a design, which the claims of a certificate prove."""

from __future__ import annotations

from dataclasses import dataclass

from vctune.model.device import Device
from vctune.model.hands import Hands
from vctune.model.worlds import Worlds, WorldsMet


@dataclass(frozen=True, slots=True)
class Demands:
    """The constraints on a design."""

    device: Device  # the device
    band: tuple[float, float]  # band of Llewellyn's conditions, rad/s
    factor: float  # safety factor g, the least permitted Re Z_c / R; for an impedance display Re (1/Z_c) / R
    max_sensitivity: float  # greatest permitted |S| of the sampled loop; without effect for a servo
    passive: bool = True  # whether the constraints include any passive hand on an admittance display, on the band
    any_hand: bool = False
    hands: Hands | None = None  # box of hands in which the sampled loop must be stable at every frequency
    worlds: Worlds | None = None  # box of environments with which the loop must be stable in these hands
    rigid: bool = False  # whether the environment is rigid, so that the coupling of an impedance display is a wall
    damping_ratio: float | None = None  # least ratio of every oscillation in these hands; None for none
    rest: bool = False  # whether the device must rest between the steps of its encoder

    @property
    def alone(self) -> bool:
        """Whether the claim about any passive hand is one with nothing behind the coupling."""
        return self.passive and self.worlds is not None

    @property
    def worlds_met(self) -> WorldsMet | None:
        """The required linear environments and the safety factor; None for every passive environment."""
        return None if self.worlds is None else WorldsMet(self.worlds.linear, self.factor)

    @property
    def walls_met(self) -> WorldsMet | None:
        """The required environments including walls, and the safety factor; None without a multiplier for walls."""
        worlds = self.worlds
        return None if worlds is None or worlds.corner is None else WorldsMet(worlds, self.factor)
