"""The region file: which gains are proved admissible, cell by cell, as a baseline for continuous integration."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from vctune.document.errors import InputError, Mistake
from vctune.document.json import read_json
from vctune.document.schema import FixedCouplingTable, FixedGainsTable
from vctune.document.validation import MAX_MISTAKES, dotted

SCHEMA = "vctune/region/1"
MAX_BYTES = 100_000_000

Key = Literal["gains.velocity", "gains.position", "coupling.damping", "coupling.mass", "coupling.drag"]
Index = Annotated[int, Field(ge=0)]
Edges = Annotated[list[Annotated[float, Field(ge=0, le=1e20)]], Field(min_length=2)]
Verdict = Literal["feasible", "infeasible", "undecided"]
Cell = tuple[Index, Index, Index, Index, Verdict, float | None]
"""Numbers of the edges x_low, x_high, y_low, y_high; what is proved; b_c of a feasible cell where it is free."""


class _Part(BaseModel):
    model_config = ConfigDict(extra="allow", frozen=True)


class _Problem(_Part):
    name: str
    sha256: str
    text: str


class _Axes(_Part):
    x: Key
    y: Key


class _Edges(_Part):
    x: Edges
    y: Edges


class DesignPoint(_Part):
    """Gains and coupling that are proved on their own."""

    gains: FixedGainsTable
    coupling: FixedCouplingTable


class RegionDocument(_Part):
    """A region file."""

    schema_: Literal["vctune/region/1"] = Field(alias="schema")
    problem: _Problem
    axes: _Axes
    edges: _Edges
    cells: list[Cell]
    designs: list[DesignPoint]

    @model_validator(mode="after")
    def _cells_lie_on_edges(self) -> RegionDocument:
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


def read_region(path: Path) -> RegionDocument:
    """Read a region file.

    Raises
    ------
    InputError
        If it cannot be read or is not one.
    """
    record = read_json(path, "a region.json of `vctune region`", MAX_BYTES)
    if not isinstance(record, dict) or record.get("schema") != SCHEMA:
        raise InputError(str(path), [Mistake("schema", f"is not {SCHEMA}; name a region.json of `vctune region`")])
    try:
        return RegionDocument.model_validate(record)
    except ValidationError as error:
        listed = error.errors(include_url=False)[:MAX_MISTAKES]
        faults = [Mistake(dotted(fault["loc"]), fault["msg"]) for fault in listed]
        raise InputError(str(path), faults) from None
