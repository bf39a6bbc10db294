"""Whether a design shakes: how it rings in a hand, and whether a kick makes it buzz."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf, isclose, log, pi
from typing import Annotated

from vctune.design.judging.judge import Judgement, Status
from vctune.design.judging.kicked import buzz_of, ringing_of
from vctune.design.records.claims import DeviceRecord, device_record
from vctune.document.records.part import Nullable, RecordPart, Row, milli, text
from vctune.document.text.errors import Note
from vctune.model.fields import Shown
from vctune.model.hands import Hand
from vctune.model.numbers.units import Units
from vctune.model.problem import Problem
from vctune.model.rest import read_in_steps
from vctune.model.worlds import World
from vctune.running import OutOfTimeError
from vctune.simulation.kicks import Buzz
from vctune.simulation.rings import Ringing
from vctune.simulation.worlds import RIGID

SHAKES = "whether it shakes"  # Name of a part that a time limit may leave out
MILLI = 0.1  # Time below which a time is told in milliseconds, s
LONG = 1 / log(3)  # Time constant with which a motion takes a second to fall to a third, s
SAME = 1e-5  # Relative difference of two numbers of a device that are told as one
LITTLE = 0.05  # Damping ratio below which a design rings more than most would want


class RingingRecord(RecordPart):
    """The oscillation with the least damping ratio, in the stated hands and before the stated environments."""

    damping_ratio: float  # of the pole e^(sT) of the sampled loop, -Re s/|s|
    frequency_hz: float  # Im s
    time_constant_s: float  # -1/Re s, after which it has fallen to 1/e
    hand: Hand
    world: str  # the environment, in words
    device: DeviceRecord | None = None  # where not the stated one: of the box, or with its delay at whole samples

    def place(self, units: Units) -> str:
        """Return the hand, the environment and, of a box, the device in words."""
        of_box = "" if self.device is None else f" with {self.device.in_words(units)}"
        return f"in the hand of {self.hand.in_words(units)} before {self.world}{of_box}"

    @property
    def long(self) -> bool:
        """Whether the motion takes more than a second to fall to a third."""
        return self.time_constant_s > LONG

    @property
    def briefly(self) -> str:
        """The ratio, its frequency and the time in a few words."""
        ratio, hz = text(self.damping_ratio, 2), text(self.frequency_hz, 3)
        return f"rings with a damping ratio of {ratio} at {hz} Hz, {_time(self.time_constant_s)} to 1/e"

    def told(self, units: Units) -> str:
        """Return ratio and time in words."""
        return (
            f"damping ratio of {text(self.damping_ratio, 2)} at {text(self.frequency_hz, 4)} Hz and a time constant of "
            f"{_time(self.time_constant_s)}, {self.place(units)}"
        )

    def rows(self, units: Units) -> Iterator[Row]:
        """Yield the ratio with its frequency, and the time constant with its place."""
        yield Row(
            "damping ratio", text(self.damping_ratio, 3), f"at least, at {text(self.frequency_hz, 4)} Hz; estimated"
        )
        yield Row("rings for", text(self.time_constant_s, 3), f"s to 1/e, {self.place(units)}")


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


def shaken(problem: Problem, judgement: Judgement) -> tuple[RingingRecord | None, BuzzRecord | None]:
    """Return how a design rings, and whether it buzzes; None where nothing oscillates or grows, and where neither
    friction nor a step of a reading is stated."""
    law, buzzes = (judgement.gains, judgement.coupling), None
    rings = ringing_of(judgement.posed, judgement.tightest, *law)
    if rings is not None and rings.damping_ratio <= 0:
        return None, None
    if judgement.kicked is not None or judgement.status is not Status.VIOLATED:
        buzzes = buzz_of(problem, rings, *law)
    return _ringing_record(rings, problem), _buzz_record(buzzes, problem)


def shaken_in_time(problem: Problem, judgement: Judgement) -> tuple[RingingRecord | None, BuzzRecord | None]:
    """Return what `shaken` does, and nothing if the time is over."""
    try:
        return shaken(problem, judgement)
    except OutOfTimeError:
        return None, None


def notes(rings: RingingRecord | None, buzzes: BuzzRecord | None, problem: Problem) -> list[Note]:
    """Return the warnings about a design that shakes: less damped than the problem demands, or than most would want."""
    found, units = list[Note](), problem.units
    asked = problem.stability.damping_ratio or LITTLE
    if rings is not None and (rings.long or rings.damping_ratio < min(asked, LITTLE)):
        length = " for more than a second" if rings.long else ""
        found.append(Note("warn-rings", f"it rings{length}: {rings.told(units)}"))
    if buzzes is not None and buzzes.moving:
        found.append(Note("warn-buzzes", f"it buzzes, as simulated: {buzzes.told(units)}"))
    return found


def in_few_words(rings: RingingRecord | None, buzzes: BuzzRecord | None) -> list[str]:
    """Return how a design rings and buzzes, in a few words each."""
    said = [] if rings is None else [rings.briefly]
    return [*said, *([f"buzzes after {buzzes.moving} of {buzzes.kicks} kicks"] if buzzes and buzzes.moving else [])]


def _ringing_record(found: Ringing | None, problem: Problem) -> RingingRecord | None:
    if found is None or found.time_constant == inf:
        return None
    stated = problem.device.numbers()
    # of a box, or with its delay at whole samples
    other = any(not isclose(number, stated[key], rel_tol=SAME) for key, number in found.device.numbers().items())
    boxed = problem.uncertainty is not None or problem.device.divided
    return RingingRecord(
        damping_ratio=found.damping_ratio,
        frequency_hz=found.frequency / (2 * pi),
        time_constant_s=found.time_constant,
        hand=found.hand,
        world=_in_words(found.world, problem.units),
        **({"device": device_record(found.device, problem, changed=other)} if boxed or other else {}),
    )


def _buzz_record(found: Buzz | None, problem: Problem) -> BuzzRecord | None:
    if found is None or found.hand is None or found.world is None:
        return None if found is None else BuzzRecord(kicks=found.kicks, moving=0)
    step, force = read_in_steps(problem.device), problem.device.commanded == "force"
    friction = problem.device.friction
    return BuzzRecord(
        kicks=found.kicks,
        moving=found.moving,
        amplitude_m=found.amplitude,
        frequency_hz=found.frequency,
        hand=found.hand,
        world=_in_words(found.world, problem.units),
        **({"force_N": found.force} if force else {}),
        **({"step_m": step} if step is not None else {}),
        **({"friction_N": friction} if friction else {}),
    )


def _in_words(world: World, units: Units) -> str:
    return "a rigid world" if world == RIGID else world.in_words(units)


def shake_columns(problem: Problem, judgement: Judgement) -> ShakeColumns:
    """Return what a sweep states of whether a design shakes."""
    rings, buzzes = shaken(problem, judgement)
    found = dict[str, float | None]()
    if rings is not None:
        found |= {"damping_ratio": rings.damping_ratio, "ringing_hz": rings.frequency_hz}
        found["ringing_s"] = rings.time_constant_s
    if buzzes is not None:
        found |= {"kicks_moving": buzzes.moving / buzzes.kicks, "buzz_m": buzzes.amplitude_m or 0.0}
        found |= {"buzz_hz": buzzes.frequency_hz}
        found |= {"buzz_N": buzzes.force_N or 0.0} if problem.device.commanded == "force" else {}
    return ShakeColumns(**found)
