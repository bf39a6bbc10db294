"""Define the types of keys that several documents share."""

from __future__ import annotations

from math import inf
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from vctune.model.experiment import MOST_LATE

# Least and greatest positive number of a key that does not permit inf, in the units of the file
LEAST, MOST = 1e-20, 1e20


def _zero_or_sizeable(value: float) -> float:
    if 0 < value < LEAST:
        raise ValueError(f"{value:g} is too small: must be 0 or at least {LEAST:g}")
    return value


def _most_or_inf(value: float) -> float:
    if MOST < value < inf:
        raise ValueError(f"{value:g} is too large: must be at most {MOST:g}, or inf")
    return value


Positive = Annotated[float, Field(strict=True, ge=LEAST, le=MOST)]
NotNegative = Annotated[float, Field(strict=True, ge=0, le=MOST), AfterValidator(_zero_or_sizeable)]
# a share is below 1, a portion is above 0 and may be 1; the edge of a band may be inf
Share = Annotated[float, Field(strict=True, ge=0, lt=1), AfterValidator(_zero_or_sizeable)]
Portion = Annotated[float, Field(strict=True, ge=LEAST, le=1)]
Edge = Annotated[float, Field(strict=True, ge=0), AfterValidator(_zero_or_sizeable)]
PositiveOrInf = Annotated[float, Field(strict=True, ge=LEAST), AfterValidator(_most_or_inf)]
NotNegativeOrInf = Annotated[
    float, Field(strict=True, ge=0), AfterValidator(_zero_or_sizeable), AfterValidator(_most_or_inf)
]
Place = Annotated[float, Field(strict=True, ge=-MOST, le=MOST)]
Count = Annotated[int, Field(strict=True, ge=1, le=1_000_000)]
Late = Annotated[int, Field(strict=True, ge=0, le=MOST_LATE)]
Text = Annotated[str, Field(strict=True)]


class Table(BaseModel):
    """A table that refuses unknown keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)
