"""The claims of a certificate, in its order."""

from __future__ import annotations

from vctune.model.demands import Demands
from vctune.proof.claims.any_hand import ANY_HAND, WALL_IN_ANY_HAND
from vctune.proof.claims.band import ALONE, PASSIVE
from vctune.proof.claims.claim import Claim, ClaimId, Quantity
from vctune.proof.claims.damping import DAMPING
from vctune.proof.claims.hands import HANDS
from vctune.proof.claims.poles import STABLE, STABLE_MODEL
from vctune.proof.claims.rest import RESTS
from vctune.proof.claims.sensitivity import SENSITIVITY, UNMODELLED
from vctune.proof.claims.wall_in_hands import WALL_IN_HANDS
from vctune.proof.claims.walls import WALLS
from vctune.proof.claims.worlds import WORLDS
from vctune.proof.device_box import DeviceBox

_ROWS = (
    PASSIVE, ALONE, SENSITIVITY, STABLE_MODEL, STABLE, UNMODELLED, ANY_HAND, HANDS, WORLDS, WALLS, WALL_IN_ANY_HAND,
    WALL_IN_HANDS, DAMPING, RESTS,
)  # fmt: skip
CLAIMS: dict[ClaimId, Claim] = {claim.id: claim for claim in _ROWS}
IN_HANDS = tuple(claim.id for claim in (HANDS, WORLDS, WALLS))  # Claims about the coupling in the hands of a box
BEFORE_WALL = tuple(claim.id for claim in (WALL_IN_ANY_HAND, WALL_IN_HANDS))  # Claims about the coupling as a wall


def claims_about(*quantities: Quantity) -> tuple[ClaimId, ...]:
    """Return the identifiers of the claims that limit given quantities."""
    return tuple(claim.id for claim in CLAIMS.values() if claim.quantity in quantities)


def claims_asked(demands: Demands, box: DeviceBox | None = None) -> list[Claim]:
    """Return the claims that a certificate makes, in their order."""
    return [claim for claim in CLAIMS.values() if claim.asked(demands, box)]
