"""Define the region file: the feasible gains, cell by cell, as a baseline for continuous integration."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, Strict, model_validator

from vctune.document.reading import digest_mistakes, stated_problem
from vctune.document.records.gains_json import (
    AnyCouplingRecord,
    ProblemRecord,
)
from vctune.document.records.part import Pair, RecordPart
from vctune.document.text.errors import Mistake
from vctune.document.text.json import SealedDocument, as_record, read_json
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.problem import Criterion

MAX_BYTES = 100_000_000
SAME_AREA = 1e-9  # Greatest difference between an area that a region states and that of its cells
KIND = "a region.json of `vctune region`"

Key = Literal[
    "gains.velocity",
    "gains.position",
    "coupling.damping",
    "coupling.mass",
    "coupling.drag",
    "coupling.stiffness",
]
Index = Annotated[int, Field(ge=0)]
Edges = Annotated[list[Annotated[float, Field(ge=0)]], Field(min_length=2)]
Verdict = Literal["feasible", "infeasible", "undecided"]
# Indices of the edges x_low, x_high, y_low and y_high, then the verdict, then b_c of a feasible cell if b_c is free
Cell = Annotated[tuple[Index, Index, Index, Index, Verdict, float | None], Strict(False)]


class DemandsRecord(RecordPart):
    """The constraints on the gains; `hands` is the box of hands that they include, empty without one."""

    safety_factor: float
    max_sensitivity: float
    criterion: Criterion = "passive"
    hands: dict[str, Pair] = Field(default_factory=dict)


class AxesRecord(RecordPart):
    """The two variables that span the plane."""

    x: Key
    y: Key


class EdgesRecord(RecordPart):
    """The values at which cells begin and end, SI units, increasing; x and y have the same number."""

    x: Edges
    y: Edges


class DesignPoint(RecordPart):
    """A gain set: gains and coupling with a proof of their own."""

    gains: Gains
    coupling: AnyCouplingRecord

    @property
    def design(self) -> tuple[Gains, AnyCoupling]:
        """The gains and the coupling."""
        return self.gains, self.coupling


class RegionDocument(SealedDocument):
    """A plane of gains and its cells, in SI units: the object of region.json."""

    SCHEMA = "vctune/region/1"

    problem: ProblemRecord
    demands: DemandsRecord | None = None
    axes: AxesRecord  # keys of the plane, its edges, and its cells
    others: dict[str, float | dict[str, float] | None] = Field(default_factory=dict)
    areas: dict[str, float] = Field(default_factory=dict)  # share of the plane for each verdict
    interrupted: bool = False
    designs: list[DesignPoint]  # listed gain sets
    edges: EdgesRecord
    cells: list[Cell]
    versions: dict[str, str | None] = Field(default_factory=dict)

    def contradictions(self, source: str) -> Iterator[Mistake]:
        """Yield a digest that does not belong to the problem's text."""
        yield from digest_mistakes(self.problem, stated_problem(self.problem, source))

    @model_validator(mode="after")
    def _cells_lie_on_edges(self) -> RegionDocument:
        """Refuse cells that do not lie on the listed edges, and edges that do not increase."""
        if len(self.edges.x) != len(self.edges.y):
            raise ValueError(f"there are {len(self.edges.x)} edges of x and {len(self.edges.y)} of y, not as many")
        for number, (x_low, x_high, y_low, y_high, *_) in enumerate(self.cells):
            inside = x_low <= x_high < len(self.edges.x) and y_low <= y_high < len(self.edges.y)
            if not inside or (x_low, y_low) == (x_high, y_high):
                raise ValueError(f"cell {number} does not lie on the edges")
        for name, edges in (("x", self.edges.x), ("y", self.edges.y)):
            if any(a >= b for a, b in pairwise(edges)):
                raise ValueError(f"the edges of {name} do not rise")
        return self

    @model_validator(mode="after")
    def _cells_fill_the_plane(self) -> RegionDocument:
        """Refuse cells that are not the whole plane or contradict the stated areas, as after a bad merge."""
        listed, finest = dict.fromkeys((*self.areas, "all"), 0.0), (len(self.edges.x) - 1) ** 2
        for x_low, x_high, y_low, y_high, kind, _ in self.cells:
            for name in (kind, "all"):
                listed[name] = listed.get(name, 0.0) + (x_high - x_low) * (y_high - y_low) / finest
        for name, stated in {"all": 1.0, **self.areas}.items():
            if abs(listed[name] - stated) > SAME_AREA:
                what = "of the plane" if name == "all" else f"of it as {name}, and areas.{name} says {stated:.6g}"
                raise ValueError(f"the cells list {listed[name]:.6g} {what}" + ", not all" * (name == "all"))
        return self


def read_region(path: Path) -> RegionDocument:
    """Read a region file."""
    value = read_json(path, KIND, MAX_BYTES)
    remedy = "correct it, or find the region again"
    return as_record(
        value,
        RegionDocument,
        str(path),
        kind=f"{KIND}; the gains of a design.json are in the gains.toml beside it",
        remedy=remedy,
        by_hand=True,
    )
