"""Define the record of the environments that a design can render: the stiffest spring and the lightest tool that are
proved."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

from vctune.document.records.part import Number, Part, Row, Shown, text
from vctune.model.numbers.units import Units


class RenderedRecord(Part):
    """The greatest stiffness and the least mass of an environment that are proved in every hand, with the other
    ranges."""

    stiffest_spring: Annotated[Number, Shown("stiffest spring", digits=4, of="stiffness")] = None
    tools: list[Number]
    lightest_tool: Annotated[Number, Shown("lightest tool", digits=4, of="mass")] = None
    springs: list[Number]

    def rows(self, units: Units) -> Iterator[Row]:
        """Yield the rows, each with the environments that accompany it."""
        beside = {"spring": (self.tools, units.mass), "tool": (self.springs, units.stiffness)}
        for row, (numbers, unit) in zip(super().rows(units), beside.values(), strict=True):
            yield row._replace(unit=f"{row.unit if row.value != 'none' else ''}  {_beside(numbers, unit)}".strip())

    def said(self, units: Units) -> str:
        """Return a sentence that states the proved environments; "" if none is proved."""
        parts = []
        if self.stiffest_spring is not None:
            parts.append(f"springs up to {text(self.stiffest_spring, 4)} {units.stiffness}")
        if self.lightest_tool is not None:
            parts.append(f"tools from {text(self.lightest_tool, 4)} {units.mass}")
        return f"proved are {' and '.join(parts)}" if parts else ""


def _beside(numbers: list[Number], unit: str) -> str:
    low, high = numbers
    if high == 0:
        return "alone"
    return f"beside any from {text(low)} {unit}" if high is None else f"beside {text([low, high])} {unit}"
