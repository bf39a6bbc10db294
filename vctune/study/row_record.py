"""The lines of rows.jsonl, and how tables show their numbers."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, create_model

from vctune.design.records.certificate import CertificateRecord, InnerLoopRecord
from vctune.design.records.felt import FeltRecord
from vctune.design.records.rest import ChatterColumns
from vctune.design.records.shake import ShakeColumns
from vctune.document.records.part import Document, From, Nullable, RecordPart, how_shown, marks
from vctune.model.fields import Shown
from vctune.model.numbers.units import SYMBOLS


class RowsHeader(Document):
    """The first line of rows.jsonl: the digest of the study and the keys that vary."""

    SCHEMA = "vctune/rows/3"

    study: str
    axes: list[str]


class RowYardstickRecord(RecordPart):
    """The scale of a row's error in addition to norm and weights: the transparency band and Z_0."""

    yardstick_low_hz: Annotated[Nullable, Shown("lower edge of the transparency band", of="frequency")]
    yardstick_high_hz: Annotated[Nullable, Shown("upper edge of the transparency band", of="frequency")]
    reference_impedance: Annotated[Nullable, Shown("Z_0", of="damping")]


class NumbersRecord(RecordPart):
    """The error, its unweighted terms, and the design; null without a design."""

    error: Annotated[Nullable, Shown("transparency error")]
    admittance_term: Annotated[Nullable, Shown("|Z_0 G_hh|")]
    tracking_term: Annotated[Nullable, Shown("|1 - G_he|")]
    coupling_term: Annotated[Nullable, Shown("|Z_c|/Z_0")]
    velocity_gain: Annotated[Nullable, Shown("K_v", of="damping")]
    position_gain: Annotated[Nullable, Shown("K_p", of="stiffness")]
    coupling_damping: Annotated[Nullable, Shown("b_c", of="damping")]
    coupling_mass: Annotated[Nullable, Shown("m_c", of="mass")]
    coupling_drag: Annotated[Nullable, Shown("b_0", of="damping")]
    coupling_stiffness: Annotated[Nullable, Shown("k_c", of="stiffness")] = None


# The numbers of a design's record that a sweep has as columns
FROM_VERDICT = {
    name: mark
    for part in (CertificateRecord, InnerLoopRecord)
    for name, mark in marks(part, From).items()
    if mark.column
}


_verdict_columns: Any = {name: (Annotated[Nullable, mark.column], ...) for name, mark in FROM_VERDICT.items()}
VerdictRecord: Any = create_model(
    "VerdictRecord",
    __base__=RecordPart,
    __doc__="The least ratio of the certificate and the peak of the sensitivity; null without a design.",
    **_verdict_columns,
)


class BandRecord(RecordPart):
    """The band of Llewellyn's conditions."""

    stability_high_hz: Annotated[Nullable, Shown("upper edge of the stability band, if required", of="frequency")]


ROW_PARTS = (NumbersRecord, VerdictRecord, BandRecord, FeltRecord, ChatterColumns, ShakeColumns, RowYardstickRecord)
# How tables display the columns of numbers, in order
SHOWN_COLUMNS = {name: shown for part in ROW_PARTS for name, shown in how_shown(part).items()}
# Quantity of each column (`vctune.model.numbers.units`)
QUANTITY_OF_COLUMN = {name: shown.of for name, shown in SHOWN_COLUMNS.items()}
# Column of each number of a design, by its key
COLUMN_OF_KEY = {
    key: f"{name}_gain" if table == "gains" else f"{table}_{name}"
    for key in SYMBOLS
    for table, _, name in [key.partition(".")]
}


class RowRecord(RowYardstickRecord, ShakeColumns, ChatterColumns, FeltRecord, BandRecord, VerdictRecord, NumbersRecord):
    """A line of rows.jsonl: a finished point."""

    key: str  # digest of everything that determines the point
    point: dict[str, float | str]  # value of each axis, by its dotted key
    status: str = Field(
        description="As of a design; invalid if the values do not form a valid problem, failed if the worker failed."
    )
    idle: bool = Field(description="Whether a certified design hardly uses its velocity loop: |1 - G_he| is above 0.5.")
    reason: str | None = Field(description="Why there is no certified design.")
    seconds: float = 0.0  # elapsed time, s
    time_limit: float | None = None  # time limit that cut the work short, s
