"""The output of a study: the lines of rows.jsonl, and the objects of `vctune sweep` and `vctune front`.

Names of columns have no dot, so that they never equal the key of an axis.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

from vctune.document.records.part import Document, Number, Pair, Part, Shown, how_shown


class RowsHeader(Document):
    """The first line of rows.jsonl: the digest of the study and the keys that vary."""

    SCHEMA = "vctune/rows/3"

    study: str
    axes: list[str]


class FeltRecord(Part):
    """How a design feels, on no yardstick (`vctune.analysis.feel`); null without a design, or above Nyquist.

    The wall is evaluated at 10 Hz; tracking ends where |G_he|, for an impedance display |A H/N|, falls below 1/sqrt 2.
    """

    felt_mass_1hz: Annotated[Number, Shown("mass felt at 1 Hz", of="mass")]
    felt_mass_10hz: Annotated[Number, Shown("mass felt at 10 Hz", of="mass")]
    felt_damping_1hz: Annotated[Number, Shown("damping felt at 1 Hz", of="damping")]
    felt_damping_10hz: Annotated[Number, Shown("damping felt at 10 Hz", of="damping")]
    stiffest_wall: Annotated[Number, Shown("stiffest wall felt, at 10 Hz", of="stiffness")]
    tracking_bandwidth_hz: Annotated[Number, Shown("bandwidth of tracking", of="frequency")]


class YardstickRecord(Part):
    """The yardstick of the error, besides norm and weights: the transparency band and Z_0."""

    yardstick_low_hz: Annotated[Number, Shown("lower edge of the transparency band", of="frequency")]
    yardstick_high_hz: Annotated[Number, Shown("upper edge of the transparency band", of="frequency")]
    reference_impedance: Annotated[Number, Shown("Z_0", of="damping")]


class NumbersRecord(Part):
    """The error, its unweighted terms, the design, its least ratio and the frequency of it; null without a design."""

    error: Annotated[Number, Shown("transparency error")]
    admittance_term: Annotated[Number, Shown("|Z_0 G_hh|")]
    tracking_term: Annotated[Number, Shown("|1 - G_he|")]
    coupling_term: Annotated[Number, Shown("|Z_c|/Z_0")]
    velocity_gain: Annotated[Number, Shown("K_v", of="damping")]
    position_gain: Annotated[Number, Shown("K_p", of="stiffness")]
    coupling_damping: Annotated[Number, Shown("b_c", of="damping")]
    coupling_mass: Annotated[Number, Shown("m_c", of="mass")]
    coupling_drag: Annotated[Number, Shown("b_0", of="damping")]
    coupling_stiffness: Annotated[Number, Shown("k_c", of="stiffness")] = None
    min_ratio: Annotated[Number, Shown("least Re Z_c / R")]
    worst_hz: Annotated[Number, Shown("where the ratio is least", of="frequency")]
    peak_sensitivity: Annotated[Number, Shown("peak |S|")]
    stability_high_hz: Annotated[Number, Shown("upper edge of the stability band, if required", of="frequency")]


COLUMNS = how_shown(NumbersRecord) | how_shown(FeltRecord) | how_shown(YardstickRecord)
"""How the columns of numbers are displayed, in their order."""
NUMBERS = {name: shown.of for name, shown in COLUMNS.items()}
"""Quantity of each column (`vctune.model.numbers.units`)."""
DESIGN = {
    "gains.velocity": "velocity_gain",
    "gains.position": "position_gain",
    "coupling.damping": "coupling_damping",
    "coupling.mass": "coupling_mass",
    "coupling.drag": "coupling_drag",
    "coupling.stiffness": "coupling_stiffness",
}
"""Column of each number of a design, by its key. No kind of display has all of these numbers."""


class RowRecord(YardstickRecord, FeltRecord, NumbersRecord):
    """A line of rows.jsonl: a finished point, by the digest of all that determines it.

    If the `time_limit`, s, has cut its work short, it is undecided, and a run with more time tries it again.
    """

    key: str
    point: dict[str, float | str]
    status: str
    idle: bool
    reason: str | None
    seconds: float = 0.0
    time_limit: float | None = None


Cells = dict[str, bool | float | str | None]
"""A row of a table: the axes by dotted key, `status`, `idle`, the numbers and `reason`."""


class CornerRecord(Part):
    """The smallest box over the axes that holds every point without a certified design."""

    points: int
    share: float
    low: Mapping[str, Number]
    high: Mapping[str, Number]
    reason: str


class ObjectiveRecord(Part):
    """The yardstick of a study: the scale of the errors of all its points, except for parts that an axis states."""

    band_hz: Pair
    reference_impedance: float
    norm: str
    weights: dict[str, float]
    varied: list[str]


class SweepRecord(Document):
    """The summary of a sweep.

    `units` are those of axes and numbers, `idle` counts certified designs.
    """

    SCHEMA = "vctune/sweep/2"

    study: str
    points: int
    status: dict[str, int]
    idle: int
    yardstick: ObjectiveRecord
    units: dict[str, str]
    best: Cells | None
    worst: Cells | None
    corner: CornerRecord | None


class FrontRecord(Document):
    """The designs that no other beats: in the three terms, and in error and upper edge of the stability band."""

    SCHEMA = "vctune/front/1"

    problem: str
    units: dict[str, str]
    terms: list[Cells]
    band: list[Cells] | None
