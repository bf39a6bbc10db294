"""Define the records of whether a design shakes: how it rings in a hand, and whether a kick makes it buzz."""

from __future__ import annotations

from collections.abc import Iterator
from math import log
from typing import Annotated

from vctune.document.records.felt_json import milli
from vctune.document.records.part import Nullable, RecordPart, Row, text
from vctune.model.fields import Shown
from vctune.model.hands import Hand
from vctune.model.numbers.units import Units

MILLI = 0.1  # Time below which a time is told in milliseconds, s
LONG = 1 / log(3)  # Time constant with which a motion takes a second to fall to a third, s


class RingingRecord(RecordPart):
    """The oscillation with the least damping ratio, in the stated hands and before the stated environments."""

    damping_ratio: float  # of the pole e^(sT) of the sampled loop, -Re s/|s|
    frequency_hz: float  # Im s
    time_constant_s: float  # -1/Re s, after which it has fallen to 1/e
    hand: Hand
    world: str  # the environment, in words

    @property
    def long(self) -> bool:
        """Whether the motion takes more than a second to fall to a third."""
        return self.time_constant_s > LONG

    @property
    def briefly(self) -> str:
        """The ratio and the time in a few words."""
        return f"rings with a damping ratio of {text(self.damping_ratio, 2)}, {_time(self.time_constant_s)} to 1/e"

    def told(self, units: Units) -> str:
        """Return ratio and time in words."""
        return (
            f"damping ratio of {text(self.damping_ratio, 2)} at {text(self.frequency_hz, 4)} Hz and a time constant of "
            f"{_time(self.time_constant_s)}, in the hand of {self.hand.in_words(units)} before {self.world}"
        )

    def rows(self, units: Units) -> Iterator[Row]:
        """Yield the ratio with its frequency, and the time constant with its place."""
        yield Row(
            "damping ratio", text(self.damping_ratio, 3), f"at least, at {text(self.frequency_hz, 4)} Hz; estimated"
        )
        where = f"s to 1/e, in the hand of {self.hand.in_words(units)} before {self.world}"
        yield Row("rings for", text(self.time_constant_s, 3), where)


def _time(seconds: float) -> str:
    return f"{text(1e3 * seconds, 3)} ms" if seconds < MILLI else f"{text(seconds, 3)} s"


class BuzzRecord(RecordPart):
    """What a fixed set of kicks does to a design with friction or steps of a reading, as simulated."""

    kicks: int
    moving: int  # number of kicks after which the device goes on moving
    amplitude_m: Nullable = None  # of the worst of them: half of the handle's way to and fro
    force_N: Nullable = None  # half of what the motor's force varies; absent for a servo
    frequency_hz: Nullable = None
    step_m: Nullable = None  # step of the encoder; absent without one
    friction_N: Nullable = None  # with which it was kicked; absent if none is stated
    hand: Hand | None = None
    world: str | None = None

    def told(self, units: Units) -> str:
        """Return the number of kicks that keep moving, and the worst motion, in words."""
        if self.amplitude_m is None or self.frequency_hz is None or self.hand is None:
            return f"none of {self.kicks} kicks keeps moving"
        size = milli(self.amplitude_m, units.position)
        size += f" ({text(self.amplitude_m / self.step_m, 2)} steps)" if self.step_m else ""
        force = f", {text(self.force_N, 3)} {units.force}" if self.force_N else ""
        verb = "keeps" if self.moving == 1 else "keep"
        place = f"in the hand of {self.hand.in_words(units)} before {self.world}"
        motion = f"{size} at {text(self.frequency_hz, 3)} Hz{force}"
        dry = "" if self.friction_N else "; without friction, since none is stated"
        return f"{self.moving} of {self.kicks} kicks {verb} moving: {motion}, {place}{dry}"

    def rows(self, units: Units) -> Iterator[Row]:
        """Yield whether it buzzes."""
        yield Row("buzzes", "yes" if self.moving else "no", f"{self.told(units)}; simulated, not proved")


class ShakeColumns(RecordPart):
    """Whether a design shakes, as columns of a sweep; null where nothing oscillates, or nothing buzzes."""

    damping_ratio: Annotated[Nullable, Shown("least damping ratio")] = None
    ringing_hz: Annotated[Nullable, Shown("where the damping ratio is least", of="frequency")] = None
    ringing_s: Annotated[Nullable, Shown("time constant of that oscillation", "s")] = None
    kicks_moving: Annotated[Nullable, Shown("share of kicks that keep moving")] = None
    buzz_m: Annotated[Nullable, Shown("buzz of the handle", of="position")] = None
    buzz_N: Annotated[Nullable, Shown("buzz of the motor's force", of="force")] = None
    buzz_hz: Annotated[Nullable, Shown("frequency of the buzz", of="frequency")] = None
