"""Define the records of what the hand feels of a design, and of the drag that a servo's latency requires."""

from __future__ import annotations

from collections.abc import Iterator
from math import isclose, pi
from typing import Annotated, Literal

from pydantic import Field

from vctune.document.records.part import Nullable, RecordPart, Row, how_shown, text
from vctune.model.fields import Shown
from vctune.model.hands import Hand
from vctune.model.numbers.units import Units

GRAMS = 0.1  # Mass below which a mass is told in grams, kg
RENDERED = 0.1  # Greatest difference of the felt stiffness of a rendered wall from the wall's own, relative


class InHandRecord(RecordPart):
    """What the hand feels, in the sampled loop in double precision; null for what does not exist."""

    limp: bool = False  # whether K_p holds no static force: its spring is nothing in the transparency band
    mass_1hz: Nullable = None  # of free motion: with the design, and of the bare device
    damping_1hz: Nullable = None
    bare_mass_1hz: Nullable = None
    behind: str | None = None  # the environment with which it is felt; null for nothing, without [environment]
    felt_wall_10hz: Nullable = None  # stiffness that is felt of the stiffest wall, the least tool's inertia apart
    wall: Nullable = None
    count: Nullable = None  # force of one count of the encoder, N
    first_speed: Nullable = (
        None  # command of a servo at rest in the first sample of 1 N, m/s, and its acceleration, m/s2
    )
    first_acceleration: Nullable = None

    def rows(self, units: Units) -> Iterator[Row]:
        """Yield free motion, the stiffest wall, the force of a count and what a unit of force commands."""
        if self.mass_1hz is not None and self.damping_1hz is not None:
            value, unit = weighed(self.mass_1hz, units)
            held = f"{_short(abs(self.damping_1hz))} {units.damping}"
            drives = " that drive" if self.damping_1hz < 0 else ""
            felt, bare = f"{unit} and {held}{drives} at 1 Hz", self.bare_mass_1hz
            felt += "" if self.behind is None else f" with {self.behind} behind"
            felt += "" if bare is None else f"; the bare device {' '.join(weighed(bare, units))}"
            yield Row("feels like", value, felt)
        if self.felt_wall_10hz is not None and self.wall is not None:
            rendered = abs(self.felt_wall_10hz - self.wall) <= RENDERED * self.wall
            verdict = f"{'rendered' if rendered else 'stable, but not rendered'} to {100 * RENDERED:g} %"
            stated = f"{units.stiffness} of the wall of {text(self.wall)} {units.stiffness} at 10 Hz: {verdict}"
            stated += "" if self.behind in (None, "nothing") else f"; with {self.behind}, whose inertia is left out"
            yield Row("stiffest wall felt", text(self.felt_wall_10hz, 4), stated)
        if self.count is not None:
            yield Row("count of the encoder", text(self.count, 3), f"{units.force} without filters, in its sample")
        if self.first_speed is not None and self.first_acceleration is not None:
            more = f"{units.speed}, {text(self.first_acceleration, 3)} {units.acceleration}, in its first sample"
            yield Row(f"1 {units.force} from rest", text(self.first_speed, 3), f"{more}, with nothing behind")


def weighed(mass: float, units: Units) -> tuple[str, str]:
    """Return a mass felt at 1 Hz and its unit, which is g for a light one; a negative one is felt as a spring."""
    if mass < 0:
        return _short(-mass * (2 * pi) ** 2), f"{units.stiffness} of a spring"
    light = units.mass == "kg" and abs(mass) < GRAMS
    return _short(1e3 * mass if light else mass), "g" if light else units.mass


def _short(value: float) -> str:
    return f"{float(text(value, 3 if abs(value) >= 100 else 2)):g}"


class ChatterRecord(RecordPart):
    """The most that the steps of a reading cause at rest, in the worst hand, without friction; null without a bound."""

    step: float  # m of the encoder, N of the force sensor
    chatter_m: Nullable = None  # half of what the handle moves, of a flexible one the motor, by the encoder
    chatter_m_s: Nullable = None  # half of what its velocity varies, by the force sensor
    chatter_N: Nullable = None  # half of what the motor's force varies
    hand: Hand
    before: str  # the environments of which it is the worst, in words

    @property
    def bounded(self) -> bool:
        """Whether a bound was found."""
        return any(bound is not None for bound in (self.chatter_m, self.chatter_m_s, self.chatter_N or None))

    def row(self, reading: str, units: Units) -> Row:
        """Return the bounds with their reading and hand."""
        of_encoder = reading == "encoder"
        value, unit = (self.chatter_m, units.position) if of_encoder else (self.chatter_m_s, units.speed)
        step = milli(self.step, units.position) if of_encoder else f"{text(self.step, 3)} {units.force}"
        bounds = [] if value is None else [milli(value, unit)]
        bounds += [f"{text(self.chatter_N, 3)} {units.force}"] if self.chatter_N else []
        value_text, _, rest = " and ".join(bounds).partition(" ")
        where = (
            f"from steps of {step} of the {reading}, in the hand of {self.hand.in_words(units)} before {self.before}"
        )
        slow = "; the motion dies away too slowly for a bound" if value is None else ""
        bound = f"{rest} {where}; a bound without friction, which ranks no designs{slow}".strip()
        return Row("chatter at most", value_text or "no bound found", bound)


def milli(value: float, unit: str) -> str:
    """Return a small length or angle, or a small speed."""
    return f"{text(1e3 * value, 4)} m{unit}" if value < 1 else f"{text(value, 4)} {unit}"


class RestRecord(RecordPart):
    """What a device does at rest: whether its friction holds it between two readings, and what their steps cause."""

    spring: Literal["k_c", "K_p"] | None = None  # the stiffness that the read position drives
    step_N: Nullable = None  # greatest force of a step of the encoder, by the spring and by the damper
    damper_step_N: Nullable = None
    friction_N: Nullable = None
    rests: bool | None = None  # whether the friction holds the spring's step both ways; null if one is not known
    settles: bool | None = None  # true if every motion is proved to come to rest, false if a kick does not; else null
    encoder: ChatterRecord | None = None
    force_sensor: ChatterRecord | None = None

    @property
    def _moved_by_damper(self) -> bool:
        """Whether half of the spring's step and the damper's together exceed the friction."""
        return 0.5 * (self.step_N or 0.0) + (self.damper_step_N or 0.0) > (self.friction_N or 0.0)

    def sentences(self, units: Units) -> list[str]:
        """Return what is assumed of friction and steps, and what follows from it, for a reader of the firmware."""
        said = list[str]()
        if self.rests is not None and self.friction_N is not None:
            rests = "rests wherever it stops" if self.rests else "does not rest wherever it stops"
            friction = f"{text(self.friction_N, 6)} {units.force}"
            said.append(f"With dry friction of at least {friction}, on which no proof counts, it {rests}.")
        for reading, of in (("encoder", self.encoder), ("force sensor", self.force_sensor)):
            if of is not None:
                row = of.row(reading, units)
                bound = f"{row.value} {row.unit.partition(';')[0]}"
                said.append(
                    f"Computed, not proved: chatter at most {bound}."
                    if of.bounded
                    else f"No bound of the chatter was found {bound.partition('found ')[2]}."
                )
        return said

    def rows(self, units: Units) -> Iterator[Row]:
        """Yield whether it rests and whether it comes to rest, and the chatter, computed and not proved."""
        if self.rests is not None and self.step_N is not None and self.friction_N is not None:
            step, twice = text(self.step_N, 4), text(2 * self.friction_N, 4)
            verb = "is at most" if self.rests else "is more than"
            holds = f"{self.spring} q = {step} {units.force} {verb} twice the friction, {twice} {units.force}"
            yield Row("rests", "yes" if self.rests else "no", f"where it stops: {holds}")
        damper = f"the damper's {text(self.damper_step_N, 4)} {units.force} a step"
        if self.settles:
            yield Row("comes to rest", "yes", f"from every motion: the friction also holds {damper}")
        elif self.settles is False:
            yield Row("comes to rest", "no", "a kick keeps it moving")
        elif self.rests is not None:
            some = f": {damper} may keep it trembling within a step" if self._moved_by_damper else ""
            yield Row("comes to rest", "open", f"no kick keeps it moving, and it is not proved{some}")
        for reading, of in (("encoder", self.encoder), ("force sensor", self.force_sensor)):
            if of is not None:
                yield of.row(reading, units)


class LatencyPartRecord(RecordPart):
    """A part of the latency: its name, its key, its length, s, and the drag that it requires at rest, N s/m."""

    part: str
    key: str
    latency_s: float
    drag: Nullable = None  # absent before environments of limited mass, which require none


class ContactRecord(RecordPart):
    """The drag that contacts require on a servo, and the stiffest contact that the coupling allows."""

    stiffness: float
    safety_factor: float
    parts: Annotated[list[LatencyPartRecord], Field(min_length=1)]  # parts of the latency, and their sum
    latency_s: Annotated[float, Shown("latency L", "ms", scale=1e3)]
    # drags that the hands require; absent before environments of limited mass, which require none
    rest_drag: Annotated[Nullable, Shown("least drag at rest", of="damping", optional=True)] = None
    drag_alone: Annotated[Nullable, Shown("least drag without b_c", of="damping", optional=True)] = None
    drag_alone_hz: Nullable = None
    drag_alone_hand: Hand | None = None
    stiffest_contact: Annotated[Nullable, Shown("stiffest contact", digits=7, of="stiffness")]
    stiffest_contact_verdict: Literal["proved", "undecided"] | None
    own_spring: float = 0.0

    def rows(self, units: Units) -> Iterator[Row]:
        """Yield the rows, each with its condition."""
        details = self._details(units)
        shown = [name for name in how_shown(type(self)) if name in details]
        for name, row in zip(shown, super().rows(units), strict=True):
            yield row._replace(unit=f"{row.unit if row.value != 'none' else ''}{details[name]}")

    def _details(self, units: Units) -> dict[str, str]:
        """Return the text beside the number of each row, by the name of its field."""
        parts = " + ".join(f"{part.part} {text(1e3 * part.latency_s, 4)}" for part in self.parts)
        contacts = f"contacts up to {text(self.stiffness, 7)} {units.stiffness}"
        bears = f", {self.stiffest_contact_verdict} with this coupling"
        if self.stiffest_contact is None:
            bears = "even the softest hands require more than this coupling offers"
        found = {"latency_s": f" = {parts}", "stiffest_contact": bears}
        if self.drag_alone_hand is None or self.rest_drag is None:
            return found
        worst = f"at {text(self.drag_alone_hz)} Hz in the hand of {self.drag_alone_hand.in_words(units)}"
        return found | {"rest_drag": f" for {contacts}: {self.rule(self.rest_drag)}", "drag_alone": f", {worst}"}

    def rule(self, rest_drag: float) -> str:
        """Return the formula for the least drag at rest, in words."""
        of_springs = self.safety_factor * self.stiffness * self.latency_s + self.own_spring
        rule = f"{text(self.safety_factor)} K L{' and the drag of the own spring' if self.own_spring else ''}"
        if isclose(rest_drag, of_springs, rel_tol=1e-6):
            return rule
        less = rest_drag < of_springs
        return f"{rule} {'less the damping of every hand' if less else 'and the part of unmodelled dynamics'}"
