"""Define the schema of the study file: the types of its tables."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

MOST_VALUES = 10_000_000  # Greatest number of values of an axis, and of points of a Latin hypercube

Text = Annotated[str, Field(strict=True)]
Count = Annotated[int, Field(strict=True, ge=1, le=MOST_VALUES)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class SampleTable(_Table):
    """The rule by which the axes form points."""

    kind: Literal["grid", "lhs", "list"] = Field(
        "grid",
        description="Sampling rule: every combination of values, a Latin hypercube, or the lists of the axes "
        "element by element.",
    )
    n: Count | None = Field(None, description="Number of points of a Latin hypercube.")
    seed: Annotated[int, Field(strict=True, ge=0)] | None = Field(
        None, description="Random seed of a Latin hypercube. Default 0."
    )


class StudyDocument(_Table):
    """A vctune study file: a problem solved at many points."""

    problem: Text = Field(min_length=1, description="Path of the problem file, relative to the study file's folder.")
    axes: dict[str, Any] = Field(
        min_length=1,
        description='Numbers of the problem that vary, by dotted key. "stability.band_hz[1]" is the key of an '
        "element of a list. Each is a list of numbers, { linear = [a, b], n = ... } or { log = [a, b], n = ... }.",
    )
    sample: SampleTable = Field(default_factory=SampleTable)
