"""Define the kinds of display, and the facts that depend on the kind (model/README.md, sections 1 and 15)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, Literal

from vctune.model.gains import Coupling, SpringDamper
from vctune.model.numbers.units import KEYS, OF_KEYS, SPRING_KEYS, SYMBOLS, Units

DisplayName = Literal["admittance", "impedance", "servo"]


@dataclass(frozen=True, slots=True)
class Display:
    """A kind of display."""

    name: DisplayName  # name of the kind in a problem file
    makes: str  # input and output of the display, in words; {force} stands for force or torque
    keys: tuple[str, ...]  # keys of the parameters of a design, in order
    absent: tuple[str, ...]  # the keys of `keys` whose numbers are always 0 or, of the coupling, inf
    coupling: type[Coupling] | type[SpringDamper]  # type of the virtual coupling
    couples: str  # "Z_c" or "1/Z_c", the coupling's response in the error and the conditions
    senses_force: bool  # whether the firmware reads the force of the hand
    differences: bool  # whether the firmware by default computes the velocity from differences of the position
    banded: bool  # True if the claim for any passive hand holds on a band of the frequency model
    band: tuple[float, float] = (0.00025, 0.015)
    own_loop: bool = True  # whether the firmware, not the vendor, closes a loop around the motor
    terms: tuple[str, ...] = ("admittance", "tracking", "coupling")  # names of the error's terms that are not always 0

    @property
    def names(self) -> tuple[str, ...]:
        """The names of a design's parameters, without the names of their tables."""
        return tuple(key.rpartition(".")[2] for key in self.keys)

    @property
    def stated(self) -> tuple[str, ...]:
        """The keys of the numbers that a problem or a gains file states."""
        return tuple(key for key in self.keys if key not in self.absent)

    @property
    def inverse(self) -> bool:
        """Whether the error and the conditions use 1/Z_c instead of Z_c."""
        return self.coupling is SpringDamper

    @property
    def ratio(self) -> str:
        """The name of the ratio that the conditions bound from below."""
        return f"Re {self.couples} / R"

    def symbol(self, key: str) -> str:
        """Return the symbol of a parameter of a design; of M a + D v = F as it stands there."""
        return {"coupling.mass": "M", "coupling.drag": "D"}.get(key, "") * (self is STEPPED) or SYMBOLS[key]

    def labelled(self, key: str, units: Units) -> str:
        """Return the symbol and the unit of a parameter of a design, such as "K_v, N s/m"."""
        return f"{self.symbol(key)}, {units.of(OF_KEYS[key])}"

    def reference(self, Z_0: float) -> float:
        """Return the reference for the coupling's response: Z_0, N s/m, or 1/Z_0, m/(N s), for an impedance display."""
        return 1 / Z_0 if self.inverse else Z_0

    def coupling_unit(self, units: Units) -> str:
        """Return the unit of the coupling's response."""
        return units.mobility if self.inverse else units.damping


# A device whose velocity loop follows the velocity that the firmware computes from the sensed force
ADMITTANCE = Display(
    name="admittance",
    makes="{force} in, velocity out",
    keys=KEYS,
    absent=(),
    coupling=Coupling,
    couples="Z_c",
    senses_force=True,
    differences=False,
    banded=True,
)
# A device whose motor applies a force that the firmware computes from the measured motion
IMPEDANCE = Display(
    name="impedance",
    makes="motion in, {force} out",
    keys=SPRING_KEYS,
    absent=("gains.position",),
    coupling=SpringDamper,
    couples="1/Z_c",
    senses_force=False,
    differences=True,
    banded=False,
)
# A device with a vendor's loop that follows a command with a delay
SERVO = Display(
    name="servo",
    makes="{force} in, command to a closed loop out",
    keys=KEYS,
    absent=("gains.velocity", "gains.position"),
    coupling=Coupling,
    couples="Z_c",
    senses_force=True,
    differences=False,
    banded=False,
    band=(0.005, 0.1),
    own_loop=False,
    terms=("tracking", "coupling"),
)
# A servo whose coupling is M a + D v = F by Euler
STEPPED = replace(SERVO, absent=(*SERVO.absent, "coupling.damping"))
DISPLAYS: Mapping[DisplayName, Display] = MappingProxyType({each.name: each for each in (ADMITTANCE, IMPEDANCE, SERVO)})


def stated_display(device: Mapping[str, Any]) -> Display:
    """Return the kind of display that the [device] table states."""
    return SERVO if "servo" in device else DISPLAYS[device.get("display") or ADMITTANCE.name]
