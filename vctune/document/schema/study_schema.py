"""Define the schema of the study file: the problem, the values of its axes, and how they form points."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from vctune.document.schema.problem_schema import Table
from vctune.model.fields import MOST, Place, Positive, Text

FORMS = "write a list of numbers, { linear = [a, b], n = ... } or { log = [a, b], n = ... }"
DIGITS = 12  # Number of significant digits of the values of a range


def _ascending(ends: tuple[float, float]) -> tuple[float, float]:
    low, high = ends
    if low >= high:
        raise ValueError(f"{low:g} is not below {high:g}; swap or widen the ends")
    return ends


class RangeTable(Table):
    """n values from one end of a range to the other."""

    linear: Annotated[tuple[Place, Place], AfterValidator(_ascending)] | None = Field(
        None, description="Ends of a range that is divided into equal steps."
    )
    log: Annotated[tuple[Positive, Positive], AfterValidator(_ascending)] | None = Field(
        None, description="Ends of a range that is divided into equal ratios."
    )
    n: Annotated[int, Field(strict=True, ge=2, le=10_000_000)] = Field(description="Number of values.")

    @model_validator(mode="after")
    def _has_one_scale(self) -> RangeTable:
        if (self.linear is None) == (self.log is None):
            raise ValueError(f"must have one of linear and log; {FORMS}")
        return self

    @property
    def values(self) -> list[float]:
        """The values, in ascending order."""
        ends: Any = self.log or self.linear
        low, high = ends
        shares = (i / (self.n - 1) for i in range(self.n))
        made = (low * (high / low) ** t if self.log else low + (high - low) * t for t in shares)
        return [min(max(float(f"{value:.{DIGITS}g}"), low), high) for value in made]


AxisValue = Annotated[float, Field(strict=True, ge=-MOST)]  # may be inf
AxisValues = Annotated[
    Annotated[list[AxisValue], Field(min_length=1, description="Give the key at least one value."), Tag("<list>")]
    | Annotated[RangeTable, Tag("<spread>")],
    Discriminator(
        lambda value: {list: "<list>", dict: "<spread>"}.get(type(value)),
        custom_error_type="axis",
        custom_error_message=f"not a set of values; {FORMS}",
    ),
]


class Sample(Table):
    """The rule by which the axes form points."""

    kind: Literal["grid", "list"] = Field(
        "grid", description="Every combination of values, or the lists of the axes element by element."
    )


class StudyDocument(Table):
    """A vctune study file: a problem solved at many points."""

    problem: Text = Field(min_length=1, description="Path of the problem file, relative to the study file's folder.")
    axes: dict[str, AxisValues] = Field(
        min_length=1,
        description='Numbers of the problem that vary, by dotted key, such as "device.mass" or "stability.band_hz[1]".',
    )
    sample: Sample = Sample()
