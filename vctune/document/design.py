"""The design file: the object that `vctune solve --json` prints (document/README.md, section 3), read back."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from vctune.document.errors import InputError, Mistake
from vctune.document.json import read_json
from vctune.document.schema import FixedCouplingTable, FixedGainsTable
from vctune.document.validation import MAX_MISTAKES, dotted

SCHEMA = "vctune/design/1"
MAX_BYTES = 10_000_000

Number = float | None
Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]

Four = Annotated[list[float], Field(min_length=4, max_length=4)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="allow", strict=True)


class _Problem(_Part):
    name: str
    sha256: str
    text: str


class _Transparency(_Part):
    error: Number


class _Certificate(_Part):
    proved_band_hz: Pair | None
    min_ratio: Number
    worst_hz: Number
    rollett_k: Number


class _Nyquist(_Part):
    N: int | None
    Z: int | None


class _InnerLoop(_Part):
    spectral_radius: Number
    peak_sensitivity: Number
    peak_sensitivity_hz: Number
    gain_margin_db: Number
    phase_margin_deg: Number
    delay_margin_s: Number
    nyquist: _Nyquist


class _Active(_Part):
    demand: str
    hz: Number
    multiplier: float


class _Numbers(_Part):
    mass: float
    damping: float
    delay: float


class _Uncertainty(_Part):
    nominal_error: Number
    worst_error: Number
    worst_device: _Numbers
    min_ratio_device: _Numbers


class _Glance(_Part):
    boxes: int
    lower_bound: Number
    error: Number
    open: int


class _Box(_Part):
    low: Four
    high: Four


class _Optimality(_Part):
    lower_bound: Number
    gap: Number
    verdict: Literal["proved", "open"]
    boxes: int
    history: Annotated[list[_Glance], Field(min_length=1)]
    open: list[_Box]


class _Repair(_Part):
    key: str
    old: Number
    new: float
    change: str
    needs: str
    error: Number


class _Design(_Part):
    """The parts of a design that are shown again; others are let through."""

    problem: _Problem
    status: Literal["certified", "violated", "undecided", "infeasible"]
    reason: str | None
    idle: bool = False
    repairs: list[_Repair] | None = None
    gains: FixedGainsTable | None
    coupling: FixedCouplingTable | None
    transparency: _Transparency | None
    certificate: _Certificate | None
    inner_loop: _InnerLoop | None
    active: list[_Active]
    at_bound: list[str]
    left_out: list[str]
    warnings: list[str]
    optimality: _Optimality | None = None
    uncertainty: _Uncertainty | None = None
    versions: dict[str, str | None]

    @model_validator(mode="after")
    def _whole(self) -> _Design:
        judged = (self.coupling, self.transparency, self.certificate, self.inner_loop)
        if any((part is None) != (self.gains is None) for part in judged):
            raise ValueError(
                "gains, coupling, transparency, certificate and inner_loop must be there, or null, together"
            )
        return self


def read_design(path: Path) -> dict[str, Any]:
    """Return the object of a design.json.

    Raises
    ------
    InputError
        If it cannot be read or is not one, listing the parts that are missing or wrong.
    """
    record = read_json(path, "a design.json of `vctune solve`", MAX_BYTES)
    if not isinstance(record, dict) or record.get("schema") != SCHEMA:
        raise InputError(str(path), [Mistake("schema", f"is not {SCHEMA}; name a design.json of `vctune solve`")])
    try:
        _Design.model_validate(record)
    except ValidationError as error:
        faults = error.errors(include_url=False)[:MAX_MISTAKES]
        mistakes = [Mistake(dotted(fault["loc"]), fault["msg"]) for fault in faults]
        raise InputError(str(path), [*mistakes, Mistake("", "is damaged; solve the problem again")]) from None
    return record
