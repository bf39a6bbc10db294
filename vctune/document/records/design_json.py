"""Define the record of a design: each key of design.json once, with its type and its label (README.md, section 3)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from math import inf, isclose, isfinite
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from vctune.analysis.demands import transparency_error
from vctune.document.reading import digest_mistakes, stated_problem
from vctune.document.records.certificate_json import CertificateRecord, DeviceRecord, InnerLoopRecord
from vctune.document.records.felt_json import ContactRecord, InHandRecord, RestRecord
from vctune.document.records.gains_json import (
    AnyCouplingRecord,
    ProblemRecord,
    TransparencyRecord,
)
from vctune.document.records.part import Nullable, Pair, RecordPart, Row, rows, text
from vctune.document.records.shake_json import BuzzRecord, RingingRecord
from vctune.document.schema.number_units import unit_of
from vctune.document.text.errors import Mistake
from vctune.document.text.json import SealedDocument, as_record, read_json
from vctune.model.display import DISPLAYS
from vctune.model.fields import Shown
from vctune.model.gains import AnyCoupling, Gains, SpringDamper
from vctune.model.numbers.units import UNITS, Units, narrowed
from vctune.model.problem import Problem
from vctune.proof.outcome import Verdict, worst_verdict

MAX_BYTES = 10_000_000
KIND = "a design.json of `vctune solve`"


def read_design(path: Path) -> DesignRecord:
    """Return the record in a design.json."""
    return design_of(read_json(path, KIND, MAX_BYTES), str(path))


def design_of(value: Any, source: str) -> DesignRecord:
    """Return the record in the object of a design.json, or a record that a program has made, if its parts belong
    together."""
    value = value.to_json() if isinstance(value, DesignRecord) else value
    return as_record(value, DesignRecord, source, kind=KIND, remedy="solve the problem again")


# Relative change of the error, for a number that improves by 1 %, below which a price counts as zero
NO_DIFFERENCE = 5e-5


def _in_words(change: float) -> str:
    return "no difference" if abs(change) < NO_DIFFERENCE else f"{100 * change:+.2f} %"


class Price(RecordPart):
    """The effect on the least error of improving one parameter of the device while the rest of the problem stays."""

    key: str  # key of the parameter in the problem file
    old: float  # the value, and a value that is better by 1 %, in SI units and hertz
    new: float
    change: float  # first-order change of the least error as a share of this error; at most 0
    free: float | None = None  # relative change of the terms that the error does not count; null if it counts all

    @property
    def worth(self) -> str:
        """The effect of improving the number on the error, in words."""
        return _in_words(self.change)

    @property
    def worth_free(self) -> str:
        """The effect on what is felt of the device itself when free, in words."""
        return "" if self.free is None else _in_words(self.free)

    def cells(self, units: Units) -> tuple[str, str, str]:
        """Return the value, a better value, and their unit."""
        return text(self.old, 4), text(self.new, 4), unit_of(tuple(self.key.split(".")), units)


# Text that replaces the active constraints if the search stopped early, or if it does not solve an NLP
UNKNOWN_LIMITS = "not known: the search ended without multipliers"


SAME_PLACE = 1.05  # Greatest ratio of two frequencies that belong to the same extremum of a response


class ActiveRecord(RecordPart):
    """An active constraint of the search."""

    demand: str  # formula of the constraint
    hz: Nullable  # frequency at which it is active; null if it belongs to no frequency
    multiplier: float | None  # relative decrease of the error for a relative weakening of it; null without an optimum
    device: DeviceRecord | None = None  # device on which it is active; null if there is only one device


class Repair(RecordPart):
    """A change of one value of the problem file after which there is a design."""

    key: str  # dotted key
    old: Nullable  # old and new value, in the unit of the file; 1 and 0 for true and false. An infinite value is null
    new: Nullable
    change: str  # meaning of the change, in words
    needs: str  # the new line of the file, in TOML
    assumes: bool  # whether it changes what is assumed of hands, environments or the demands, not the design
    chooses: bool  # whether it changes a gain or the coupling, not the device
    size: float  # change relative to the greater of the two values, by which repairs are ordered
    error: float  # transparency error of the repaired design

    def __str__(self) -> str:
        whole = self.turns_off or self.needs.startswith(f"{self.key}:")  # a line of YAML
        told = self.needs if whole else f"{self.key} = {text(self.new, 12)}"
        return f"{told} instead of {self.told_old}"

    @property
    def told_old(self) -> str:
        """The old value in words."""
        return "true" if self.turns_off else "inf" if self.old is None else text(self.old, 12)

    @property
    def turns_off(self) -> bool:
        """Whether the repair turns off what the file turns on; `old` and `new` are then 1 and 0."""
        return self.needs == f"{self.key} = false"


class OptimalityRecord(RecordPart):
    """The proved lower bound on the error of every feasible design."""

    lower_bound: Annotated[Nullable, Shown("lower bound", "{verdict}, {boxes} boxes")]
    gap: Annotated[Nullable, Shown("gap", "%", 3, scale=100, optional=True)]
    verdict: Literal["proved", "open"]
    boxes: int
    error: Nullable  # of the best known design
    both_sides: bool = False  # whether the bound is of designs on both sides of a nearby whole sample of delay

    def rows(self, units: Units) -> Iterator[Row]:
        """Yield the bound and the gap, and what the bound is of."""
        yield from super().rows(units)
        if self.both_sides:
            yield Row("bound is of", "", "designs that are proved on both sides of the nearby whole sample of delay")


class UncertaintyRecord(RecordPart):
    """The design on all devices of the uncertainty box, and its worst error."""

    box: dict[str, Pair]
    unmodelled: list[list[float]] = Field(default_factory=list)
    objective: str
    robust_error: Nullable
    worst_error: Annotated[Nullable, Shown("worst error", "at {worst_device}")]
    worst_device: DeviceRecord
    min_ratio_device: DeviceRecord

    def rows(self, units: Units) -> Iterator[Row]:
        """Yield the box, the device on which Re Z_c / R is least, and the errors."""
        for name, ends in self.box.items():
            yield Row(name, text(ends), unit_of(("device", *name.split(".")), units))
        if self.unmodelled:
            radii = [radius for _, radius in self.unmodelled]
            yield Row("unmodelled, r", text([min(radii), max(radii)]), "")
        yield Row("least ratio at", "", self.min_ratio_device.in_words(units))
        yield from super().rows(units)


# Relative difference of two errors of a design within which they are the same on any machine
SAME_ERROR = 1e-6
# Groups of the nominal device in a problem with a box of devices, and those of their rows that are of every device
NOMINAL = frozenset({"transparency", "in the hand", "velocity loop"})
OF_WALL = frozenset({"peak |S|", "phase margin"})  # rows of the certificate that are of the nominal device
OF_EVERY_DEVICE = frozenset({"peak |S|", "unstable poles"})
# Status of a design for each verdict of its certificate
STATUSES = {"proved": "certified", "refuted": "violated", "undecided": "undecided"}


def _together(one: float, other: float) -> bool:
    """Return whether two frequencies belong to the same extremum."""
    return max(one, other) <= SAME_PLACE * min(one, other)


class NearestRecord(RecordPart):
    """The design that misses the constraints of a problem without a design by the least."""

    gains: Gains
    coupling: AnyCouplingRecord


class DesignRecord(SealedDocument):
    """The result of a problem, in SI units and hertz: the object of design.json."""

    SCHEMA = "vctune/design/1"
    # The parts of the record that a table shows, with their names, in the order of the table
    GROUPS: ClassVar[dict[str, str]] = {
        "gains": "gains",
        "coupling": "coupling",
        "contact": "contact",
        "transparency": "transparency",
        "felt": "in the hand",
        "rest": "at rest",
        "ringing": "ringing",
        "buzz": "kicks",
        "certificate": "certificate",
        "uncertainty": "uncertainty",
        "optimality": "optimality",
        "inner_loop": "velocity loop",
    }

    problem: ProblemRecord
    status: Literal["certified", "violated", "undecided", "infeasible"]
    reason: str | None
    gains: Gains | None
    coupling: AnyCouplingRecord | None
    transparency: TransparencyRecord | None
    certificate: CertificateRecord | None
    inner_loop: InnerLoopRecord | None
    active: list[ActiveRecord]
    proved: bool | None = None
    idle: bool = False
    repairs: list[Repair] | None = None
    rule: Literal["euler"] | None = None  # of the coupling, if it is not the trapezoidal one
    nearest: NearestRecord | None = None  # the nearest miss of a problem without a design
    tried: list[str] | None = None  # keys, each with the value up to which it was changed alone in vain
    prices: list[Price] | None = None
    contact: ContactRecord | None = None
    felt: InHandRecord | None = None
    rest: RestRecord | None = None
    ringing: RingingRecord | None = None
    buzz: BuzzRecord | None = None
    at_bound: list[str]
    warnings: list[str]
    solver: dict[str, Any] = Field(default_factory=dict)
    optimality: OptimalityRecord | None = None
    versions: dict[str, str | None]
    date: str | None = None
    uncertainty: UncertaintyRecord | None = None

    @model_validator(mode="after")
    def _whole(self) -> DesignRecord:
        """Refuse a record that has only some of the parts of a design."""
        judged: list[Any] = [self.coupling, self.transparency, self.certificate]
        looped = self.gains is not None and self.gains.closed
        judged += [self.inner_loop] if looped else []
        if any((part is None) != (self.gains is None) for part in judged):
            raise ValueError(
                "gains, coupling, transparency, certificate and inner_loop must be there, or null, together"
            )
        return self

    def contradictions(self, source: str) -> Iterator[Mistake]:
        """Yield the first parts of problem, gains, transparency, claims and status that do not belong together."""
        file = stated_problem(self.problem, source)
        if mistakes := digest_mistakes(self.problem, file):
            yield from mistakes
            return
        for key, stated, found, of in self._judged_again(file.problem):
            if stated != found:
                message = f"is {stated}, and {of} {found}: one of them was changed"
                yield Mistake("damaged-document", key, message)
                return

    def _judged_again(self, problem: Problem) -> Iterator[tuple[str, Any, Any, str]]:
        """Yield the key of a stated value, this value, the value that other keys imply, and their names."""
        if self.transparency is None or self.certificate is None or self.design is None:
            of = "without gains a problem is undecided or"
            yield "status", self.status, "undecided" if self.status == "undecided" else "infeasible", of
            return
        verdict, claims = self.certificate.verdict, self.certificate.claims
        yield "status", self.status, STATUSES[verdict], f"certificate.verdict, {verdict}, makes it"
        worst = worst_verdict([Verdict(claim.verdict) for claim in claims] or [Verdict.UNDECIDED]).value
        yield "certificate.verdict", verdict, worst, "the worst verdict of certificate.claims is"
        with np.errstate(all="ignore"):
            errors = asdict(transparency_error(problem, *self.design))
        for name, error in errors.items():
            stated = getattr(self.transparency, name)
            same = error == stated or not isfinite(error) or isclose(error, stated or 0.0, rel_tol=SAME_ERROR)
            yield f"transparency.{name}", stated, stated if same else error, "gains, coupling and problem.text make it"

    @property
    def units(self) -> Units:
        """The units of the record, which are the device's units."""
        return UNITS[self.problem.units]

    @property
    def promise(self) -> str:
        """The proved claims about hands in words; empty if the design is not certified."""
        if self.certificate is None or self.status != "certified":
            return ""
        without = " without unmodelled dynamics" if self.uncertainty is not None and self.uncertainty.unmodelled else ""
        hands = [f"stable{without} {self.certificate.hands.promise(self.units)}"] if self.certificate.hands else []
        band = self.certificate.band_hz
        edges = None if band is None else narrowed(*(inf if edge is None else edge for edge in band))
        place = edges and f"from {edges[0]} to {edges[1]} Hz, as far as the frequency model goes"
        alone = any(claim.id == "alone" for claim in self.certificate.claims)
        hand = self.certificate.passive_hand(self.units)
        stable = f"stable in {hand} with nothing behind" if alone else f"absolutely stable in {hand}"
        passive = [f"{stable} {place}"] if place else []
        if self.certificate.any_hand:
            passive = [f"stable{without} {self.certificate.any_hand.promise(hand)}"]
        if self.certificate.wall:
            passive = [f"stable {self.certificate.wall.promise(hand, self.units)}"]
        return "; ".join([*hands, *passive])

    @property
    def limits(self) -> list[str]:
        """The active constraints, the greatest multiplier first, each with the frequencies at which it is active."""
        if not self.active and self.solver.get("converged") is False:
            return [UNKNOWN_LIMITS]
        prices: dict[str, float] = {}
        places: dict[str, list[float]] = {}
        for entry in self.active:
            prices[entry.demand] = prices.get(entry.demand, 0.0) + (entry.multiplier or 0.0)
            at, proved_hz = places.setdefault(entry.demand, []), self._proved_hz(entry.demand)
            if entry.hz is not None:
                hz = proved_hz if proved_hz is not None and _together(entry.hz, proved_hz) else entry.hz
                at += [] if any(_together(hz, other) for other in at) else [hz]
        dearest = sorted(prices, key=lambda demand: -prices[demand])
        texts = {demand: ", ".join(dict.fromkeys(text(hz, 4) for hz in places[demand])) for demand in dearest}
        shown = {demand: " and ".join(at.rsplit(", ", 1)) for demand, at in texts.items()}
        return [f"{demand} at {hz} Hz" if hz else demand for demand, hz in shown.items()]

    def _proved_hz(self, demand: str) -> float | None:
        """Return the frequency of the extremum that the claim of a constraint names; None if the claim names none."""
        proof, loop = self.certificate, self.inner_loop
        if proof is None:
            return None
        if demand.startswith("|S|"):
            return None if loop is None else loop.peak_sensitivity_hz
        if demand.endswith("in a hand"):
            return None if proof.hands is None else proof.hands.worst_hz
        if demand.endswith("in any passive hand"):
            return None if proof.any_hand is None else proof.any_hand.worst_hz
        same = proof.hands is not None and proof.hands.min_ratio == proof.min_ratio
        return None if same else proof.worst_hz

    @property
    def design(self) -> tuple[Gains, AnyCoupling] | None:
        """The gains and the coupling; None without a design."""
        return None if self.gains is None or self.coupling is None else (self.gains, self.coupling)

    def groups(self) -> dict[str, list[Row]]:
        """Return the rows of a design by the titles of `GROUPS`; empty without a design."""
        if self.gains is None:
            return {}
        parts = {title: getattr(self, name) for name, title in self.GROUPS.items()}
        result = {title: list(rows(part, self.units)) for title, part in parts.items() if part is not None}
        if self.uncertainty is not None:
            result["certificate"] = [row.nominal() if row.label in OF_WALL else row for row in result["certificate"]]
            for title in NOMINAL & result.keys():
                result[title] = [row if row.label in OF_EVERY_DEVICE else row.nominal() for row in result[title]]
        if self.rule == "euler":  # which has no damper in series
            law = [
                row._replace(label=row.label[:-3] + of) for row, of in zip(result["coupling"][1:], "MD", strict=True)
            ]
            result["coupling"] = [Row("rule", "euler", "M a + D v = F, stepped by Euler's rule"), *law]
        if isinstance(self.coupling, SpringDamper):  # an impedance display has no K_p
            result["gains"] = result["gains"][:1]
        if self.transparency is not None and not DISPLAYS[self.transparency.display].own_loop:
            del result["gains"]
        return result
