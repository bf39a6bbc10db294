"""How far a design is from the limit of each claim about its coupling, on a device, in double precision."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from vctune.analysis.before_wall import worst_before_wall
from vctune.analysis.in_hands import (
    RatioInAnyHand,
    RatioInHand,
    least_on_grid,
    least_ratio_before_wall,
    least_ratios_in_any_hand,
    least_ratios_of_devices,
)
from vctune.analysis.multiples import least_ratio_in_worlds, least_ratio_with_walls
from vctune.model.demands import Demands
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains, SpringDamper
from vctune.proof.claims.any_hand import ANY_HAND, WALL_IN_ANY_HAND
from vctune.proof.claims.claim import ClaimId
from vctune.proof.claims.hands import HANDS
from vctune.proof.claims.wall_in_hands import WALL_IN_HANDS
from vctune.proof.claims.walls import WALLS
from vctune.proof.claims.worlds import WORLDS

Ratio = RatioInHand | RatioInAnyHand
Least = Callable[[Demands, Device, Gains, AnyCoupling], Ratio]


def least_of_devices(
    claim: ClaimId, demands: Demands, devices: Sequence[Device], gains: Gains, coupling: AnyCoupling
) -> list[Ratio]:
    """Return the least ratio of a claim on each device: the number by which the coupling may be divided before the
    claim fails, and of a wall the least multiple that is unstable."""
    if claim == HANDS.id:  # devices of the same form are evaluated together
        assert demands.hands is not None
        return [each[0] for each in least_ratios_of_devices(devices, demands.hands, gains, coupling)]
    return [LEAST[claim](demands, device, gains, coupling) for device in devices]


def _on_grid(demands: Demands, device: Device, gains: Gains, coupling: AnyCoupling) -> Ratio:
    """An estimate for every passive environment; `least_of_devices` climbs."""
    assert demands.hands is not None
    return least_on_grid(device, demands.hands, gains, coupling)


def _in_any_hand(_demands: Demands, device: Device, gains: Gains, coupling: AnyCoupling) -> Ratio:
    return least_ratios_in_any_hand(device, gains, coupling)[0]


def _in_worlds(demands: Demands, device: Device, gains: Gains, coupling: AnyCoupling) -> Ratio:
    assert demands.hands is not None and demands.worlds is not None
    return least_ratio_in_worlds(device, demands.hands, gains, coupling, demands.worlds)


def _with_walls(demands: Demands, device: Device, gains: Gains, coupling: AnyCoupling) -> Ratio:
    assert demands.hands is not None and demands.walls_met is not None
    return least_ratio_with_walls(device, demands.hands, gains, coupling, demands.walls_met)


def _wall_in_any_hand(_demands: Demands, device: Device, _gains: Gains, coupling: AnyCoupling) -> Ratio:
    assert isinstance(coupling, SpringDamper)
    return least_ratio_before_wall(device, coupling)


def _wall_in_hands(demands: Demands, device: Device, _gains: Gains, coupling: AnyCoupling) -> Ratio:
    assert demands.hands is not None and isinstance(coupling, SpringDamper)
    worst = worst_before_wall(device, coupling, demands.hands)
    return RatioInHand(worst.value, worst.theta / device.sample_time, worst.hand)


LEAST: dict[ClaimId, Least] = {
    ANY_HAND.id: _in_any_hand, HANDS.id: _on_grid, WORLDS.id: _in_worlds, WALLS.id: _with_walls,
    WALL_IN_ANY_HAND.id: _wall_in_any_hand, WALL_IN_HANDS.id: _wall_in_hands,
}  # fmt: skip
