"""How good a design is: the bound on every design, and the cost of robustness."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from vctune.analysis.demands import transparency_error
from vctune.design.judging.judge import Judgement
from vctune.design.prepared import problems_beside
from vctune.design.records.claims import DeviceRecord, device_record
from vctune.document.records.part import Nullable, Pair, RecordPart, Row, text
from vctune.document.schema.number_units import unit_of
from vctune.model.fields import Shown
from vctune.model.numbers.units import Units
from vctune.model.problem import Problem

if TYPE_CHECKING:
    from vctune.design.bound.search import Optimality


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
            yield Row(name, text(ends), unit_of(("device", *name.split(".")), units) + self._beside(name, *ends))
        if self.unmodelled:
            radii = [radius for _, radius in self.unmodelled]
            yield Row("unmodelled, r", text([min(radii), max(radii)]), "")
        yield Row("least ratio at", "", self.min_ratio_device.in_words(units))
        yield from super().rows(units)

    def _beside(self, name: str, low: Nullable, high: Nullable) -> str:
        """Return in words the values beyond a range with which the claims hold too: beside a whole sample of delay."""
        values = {each.parts[name] for each in (self.worst_device, self.min_ratio_device) if name in each.parts}
        beyond = sorted(value for value in values if value < (low or 0.0) or value > (inf if high is None else high))
        return "".join(f", and {text(value)} beside a whole sample" for value in beyond)


def optimality_record(problem: Problem, found: Optimality) -> OptimalityRecord:
    """Return the record of the bound on every design."""
    return OptimalityRecord(
        lower_bound=found.bound,
        gap=found.gap,
        verdict="proved" if found.proved else "open",
        boxes=found.boxes,
        error=found.incumbent,
        both_sides=bool(problems_beside(problem)),
    )


def uncertainty_record(problem: Problem, judgement: Judgement) -> UncertaintyRecord | None:
    """Return the box, the errors that show the cost of robustness, and the devices on which the design is worst."""
    posed, design = judgement.posed, (judgement.gains, judgement.coupling)
    box, uncertainty = posed.box, problem.uncertainty
    if box is None or uncertainty is None:
        return None
    worst = max(posed.cases, key=lambda case: transparency_error(case, *design).error)
    return UncertaintyRecord(
        box={key: [box.low.number(key), box.high.number(key)] for key in box.modelled.uncertain},
        **({"unmodelled": [list(point) for point in uncertainty.unmodelled]} if uncertainty.unmodelled else {}),
        objective=uncertainty.objective,
        robust_error=judgement.transparency.error,
        worst_error=transparency_error(worst, *design).error,
        worst_device=device_record(worst.device, problem),
        min_ratio_device=device_record(judgement.tightest, problem),
    )
