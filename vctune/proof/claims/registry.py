"""The claims of a certificate, each with an identifier that never changes, its statement and the quantity it limits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from vctune.model.display import Display

if TYPE_CHECKING:
    from vctune.model.problem import Demands
    from vctune.proof.device_box import DeviceBox

ClaimId = Literal[
    "passive",
    "alone",
    "sensitivity",
    "stable_model",
    "stable",
    "unmodelled",
    "any_hand",
    "hands",
    "worlds",
    "walls",
    "wall_in_any_hand",
    "wall_in_hands",
    "rests",
]
# Words of the claims in hands about a servo that moves several axes (model/README.md, section 17)
ON_AXES = (
    " On several axes of one servo with the same law it covers hands at every angle to them: symmetric matrices of "
    "mass, damping and stiffness whose eigenvalues lie in these ranges."
)
Quantity = Literal["ratio", "in_hand", "sensitivity", "unmodelled", "poles", "rest"]


@dataclass(frozen=True, slots=True)
class Claim:
    """A statement about a design that a certificate proves or refutes."""

    id: ClaimId  # public name in design.json; once a file contains it, it never changes
    # the statement; {couples} stands for Z_c or 1/Z_c, {spring} for k_c or K_p, {passive} for "any passive hand"
    sentence: str
    quantity: Quantity  # the limited quantity, by the name that the search's constraints use
    margin: str
    witness: str  # description of the place where the claim fails
    label: str  # heading of the claim's row in a report
    explain: str  # meaning of the claim for the reader
    when: str  # the condition `asked` in words: "A certificate makes it ..."
    asked: Callable[[Demands, DeviceBox | None], bool]

    def said_of(self, kind: Display, passive: str = "any passive hand") -> str:
        """Return the claim's statement about a kind of display, with any passive hand in words."""
        return self.sentence.format(couples=kind.couples, passive=passive, spring="k_c" if kind.inverse else "K_p")


# All claims, in the order of a certificate
CLAIMS: dict[ClaimId, Claim] = {
    claim.id: claim
    for claim in (
        Claim(
            id="passive",
            sentence="Re G_hh > 0 and Re Z_c >= safety_factor R on the band",
            quantity="ratio",
            margin="proof.claims.margins_of_claims.conditions_margin",
            witness="a frequency of the stability band",
            label="any passive hand, on the band",
            explain=(
                "Llewellyn's conditions hold in the frequency model, which has no aliasing. At every frequency of the "
                "stability band the device is stable in any passive hand with every passive environment. If "
                "`operator.mass.min` or `operator.damping.min` is above 0, every hand must contain them: the proof "
                "counts on them. Outside the band such a hand can make it oscillate."
            ),
            when='for an admittance display with the criterion "passive" or "both", unless `[environment]` is nothing',
            asked=lambda demands, _: demands.passive and not demands.alone,
        ),
        Claim(
            id="alone",
            sentence="Re G_hh > 0, and the handle passive with nothing behind Z_c / safety_factor, on the band",
            quantity="ratio",
            margin="proof.claims.margins_of_claims.conditions_margin",
            witness="a frequency of the stability band",
            label="any passive hand with nothing behind, on the band",
            explain=(
                "The impedance that a hand meets has a positive real part at every frequency of the stability band, in "
                "the frequency model, which has no aliasing: no passive hand can make the free handle oscillate there. "
                "With a proportional velocity loop the least mass is near K_v m/(K_v + b)."
            ),
            when='for an admittance display with the criterion "passive" or "both", if `[environment]` is nothing',
            asked=lambda demands, _: demands.alone,
        ),
        Claim(
            id="sensitivity",
            sentence="|S| <= max_sensitivity of the sampled loop up to Nyquist",
            quantity="sensitivity",
            margin="proof.claims.margins_of_claims.sensitivity_margin",
            witness="a frequency up to Nyquist",
            label="sensitivity of the velocity loop",
            explain=(
                "The Nyquist curve of the velocity loop stays at least 1/max_sensitivity away from -1. If the loop "
                "changes by less than this distance, the device remains stable when nobody holds it."
            ),
            when="for every device but a servo, whose coupling is not a wall",
            asked=lambda demands, _: demands.device.kind.own_loop and not demands.rigid,
        ),
        Claim(
            id="stable_model",
            sentence="no pole of the frequency model in the closed right half plane",
            quantity="poles",
            margin="proof.claims.margins_of_claims.model_curve",
            witness="if undecided, a frequency where the curve comes close to 0; the proof only counts poles",
            label="poles of the frequency model",
            explain=(
                "The frequency model itself is stable, both without a hand and in the hand of `[operator]`. Without "
                "this claim, `passive` would not imply stability."
            ),
            when='for an admittance display with the criterion "passive" or "both"',
            asked=lambda demands, _: demands.passive,
        ),
        Claim(
            id="stable",
            sentence="spectral radius of the sampled loop below 1",
            quantity="poles",
            margin="model.sampled.velocity_loop.return_difference",
            witness="if undecided, a frequency where the curve comes close to 0; the proof only counts poles",
            label="poles of the sampled loop",
            explain=(
                "The exactly sampled velocity loop is stable, both when nobody holds the device and in the hand of "
                "`[operator]`."
            ),
            when="for every device but a servo, whose coupling is not a wall",
            asked=lambda demands, _: demands.device.kind.own_loop and not demands.rigid,
        ),
        Claim(
            id="unmodelled",
            sentence="|1 - S| r < 1 of the sampled loop up to Nyquist, r the radius of the unmodelled dynamics",
            quantity="unmodelled",
            margin="proof.claims.margins_of_claims.unmodelled_margin",
            witness="a frequency up to Nyquist",
            label="unmodelled dynamics",
            explain=(
                "By the small-gain theorem, no sampled response of the mechanism within the radius of "
                "`uncertainty.unmodelled` around the modelled one makes the velocity loop unstable."
            ),
            when="for every device but a servo, if the file states `uncertainty.unmodelled`",
            asked=lambda demands, box: (
                box is not None and box.nominal.unmodelled is not None and demands.device.kind.own_loop
            ),
        ),
        Claim(
            id="any_hand",
            sentence=("stable in {passive} with every passive environment, Re 1/Z_c >= safety_factor R up to Nyquist"),
            quantity="in_hand",
            margin="proof.claims.margins_of_claims.any_hand_margin",
            witness="a frequency up to Nyquist",
            label="any passive hand, at every frequency",
            explain=(
                "An impedance display is stable in any passive hand with every environment that is passive as it "
                "runs. If `operator.damping.min` is above 0, every hand must have at least this damping: the proof "
                "counts on it, and the device may be unstable in other hands and when nobody holds it. The claim is "
                "about the exact sampled loop, including aliasing."
            ),
            when='for an impedance display with the criterion "passive" or "both", unless the environment is rigid',
            asked=lambda demands, _: demands.any_hand and not demands.rigid,
        ),
        Claim(
            id="hands",
            sentence=(
                "stable in every hand with every passive environment, Re {couples} >= safety_factor R up to Nyquist"
            ),
            quantity="in_hand",
            margin="proof.claims.margins_of_claims.hand_margin",
            witness="a frequency up to Nyquist and a hand of `[operator]`",
            label="every hand of the box",
            explain=(
                "A hand of `[operator]` is a mass, a damper and a spring, each within its range. In each such hand "
                "the device is stable with every environment that is passive as it runs. The claim is about the exact "
                "sampled loop, including aliasing. It does not cover a hand outside these ranges." + ON_AXES
            ),
            when='with the criterion "hands", or "both" for an admittance display, without `[environment]`',
            asked=lambda demands, _: demands.hands is not None and demands.worlds is None and not demands.rigid,
        ),
        Claim(
            id="worlds",
            sentence="stable in every hand with every environment of the box, also with Z_c / safety_factor",
            quantity="in_hand",
            margin="proof.claims.margins_of_claims.margins_in_worlds",
            witness="a frequency up to Nyquist and a hand of `[operator]`",
            label="every hand with every environment of the box",
            explain=(
                "The device is stable in each hand of `[operator]` with each environment of `[environment]`. Such an "
                "environment is a mass, a damper and a spring, each within its range, stepped by the trapezoidal "
                "rule. The device remains stable if the coupling is divided by any number from 1 to the "
                "safety factor. The claim is about the exact sampled loop, including aliasing. It does not cover "
                "other hands and environments." + ON_AXES
            ),
            when='for an admittance display or a servo with the criterion "hands" or "both", with `[environment]`',
            asked=lambda demands, _: demands.hands is not None and demands.worlds is not None,
        ),
        Claim(
            id="walls",
            sentence=(
                "stable in every hand with every fixed wall, one-sided or piecewise linear, of slopes k_1 to k_2: "
                "Re M (1/P + 1/(k_2 - k_1)) > 0 up to Nyquist; not with walls that move or one-sided dampers"
            ),
            quantity="in_hand",
            margin="proof.claims.walls.walls_margins",
            witness="a frequency up to Nyquist and a hand of `[operator]`",
            label="every hand with every wall of the box",
            explain=(
                "The device is stable in each hand of `[operator]` with each wall, to which a mass and a damper of "
                "`[environment]` are added. The force of a wall depends only on the position, and its slope is "
                "everywhere within the range `environment.stiffness`. A wall is one-sided or piecewise linear, at any "
                "position. It steps by the trapezoidal rule or by backward Euler. The claim does not cover walls that "
                "move or one-sided dampers. The proof uses the multiplier of Zames and Falb. If its condition fails, "
                "the device can still be stable with every wall."
            ),
            when="as `worlds`, with `environment.walls = true`",
            asked=lambda demands, _: demands.hands is not None and demands.worlds is not None and demands.worlds.walls,
        ),
        Claim(
            id="wall_in_any_hand",
            sentence="stable in {passive} against a wall of 1 to safety_factor times the coupling",
            quantity="in_hand",
            margin="proof.claims.margins_of_claims.any_hand_before_wall",
            witness="a frequency up to Nyquist",
            label="the wall in any passive hand",
            explain=(
                "The coupling of an impedance display ends in a rigid world, so that it is a wall that is always in "
                "contact. The device is stable in any passive hand: the condition of Colgate and Schenkel, exact with "
                "delays, filters and actuator. Dry friction at a rigid handle is part of such a hand. If "
                "`operator.damping.min` is above 0, every hand must have at least this damping: the proof counts on it."
            ),
            when='for an impedance display with the criterion "passive" or "both", if `environment.stiffness = inf`',
            asked=lambda demands, _: demands.any_hand and demands.rigid,
        ),
        Claim(
            id="wall_in_hands",
            sentence="stable in every hand against a wall of 1 to safety_factor times the coupling",
            quantity="in_hand",
            margin="proof.claims.margins_of_claims.hand_curve",
            witness="a frequency up to Nyquist and a hand of `[operator]`",
            label="the wall in every hand of the box",
            explain=(
                "The coupling of an impedance display ends in a rigid world, so that it is a wall that is always in "
                "contact. The device is stable in each hand of `[operator]`. The claim is about the exact sampled "
                "loop of linear hands: it does not cover a contact that is made and broken, nor dry friction."
            ),
            when='for an impedance display with the criterion "hands", if `environment.stiffness = inf`',
            asked=lambda demands, _: demands.hands is not None and demands.rigid,
        ),
        Claim(
            id="rests",
            sentence="the friction holds the force of one step of the encoder both ways: {spring} q <= 2 f",
            quantity="rest",
            margin="model.rest.rests",
            witness="none; the claim is about rest",
            label="rest between steps of the encoder",
            explain=(
                "At every constant force of the hand there is a reading of the encoder at which the dry friction "
                "`device.friction` holds the handle: where it has stopped, it stays. The two forces of neighbouring "
                "readings differ by the stiffness times `device.velocity.resolution`, at most twice the friction "
                "(Abbott and Okamura). The claim is exact in the decimals of the file. It does not say that every "
                "motion comes to rest: a damper answers a step of the reading with a force of its own, which the "
                "record states beside it."
            ),
            when="with `stability.rest = true`",
            asked=lambda demands, _: demands.rest,
        ),
    )
}


IN_HANDS: tuple[ClaimId, ...] = ("hands", "worlds", "walls")  # Claims about the hands of a box
BEFORE_WALL: tuple[ClaimId, ...] = ("wall_in_any_hand", "wall_in_hands")  # Claims about the coupling as a wall


def claims_about(*quantities: Quantity) -> tuple[ClaimId, ...]:
    """Return the identifiers of the claims that limit given quantities."""
    return tuple(claim.id for claim in CLAIMS.values() if claim.quantity in quantities)


def claims_asked(demands: Demands, box: DeviceBox | None = None) -> list[ClaimId]:
    """Return the claims that a certificate makes, in their order."""
    return [claim.id for claim in CLAIMS.values() if claim.asked(demands, box)]
