"""Define the output of a study: the lines of rows.jsonl, and the objects of `vctune sweep` and `vctune front`.

A column's name has no dot, so it never equals the dotted key of an axis.
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
    """How a design feels, in physical units (`vctune.analysis.feel`); null without a design, or above Nyquist.

    The wall is evaluated at 10 Hz. Tracking ends where |G_he| (for an impedance display |A H/N|) falls below 1/sqrt 2.
    """

    felt_mass_1hz: Annotated[Number, Shown("mass felt at 1 Hz", of="mass")]
    felt_mass_10hz: Annotated[Number, Shown("mass felt at 10 Hz", of="mass")]
    felt_damping_1hz: Annotated[Number, Shown("damping felt at 1 Hz", of="damping")]
    felt_damping_10hz: Annotated[Number, Shown("damping felt at 10 Hz", of="damping")]
    stiffest_wall: Annotated[Number, Shown("stiffest wall felt, at 10 Hz", of="stiffness")]
    tracking_bandwidth_hz: Annotated[Number, Shown("bandwidth of tracking", of="frequency")]


class YardstickRecord(Part):
    """The scale of the error in addition to norm and weights: the transparency band and Z_0."""

    yardstick_low_hz: Annotated[Number, Shown("lower edge of the transparency band", of="frequency")]
    yardstick_high_hz: Annotated[Number, Shown("upper edge of the transparency band", of="frequency")]
    reference_impedance: Annotated[Number, Shown("Z_0", of="damping")]


class NumbersRecord(Part):
    """The error, its unweighted terms, the design, the least ratio and the frequency of the least ratio; null without a
    design."""

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
"""How tables display the columns of numbers, in order."""
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
"""Column of each number of a design, by its key. Each kind of display has only some of these numbers."""


class RowRecord(YardstickRecord, FeltRecord, NumbersRecord):
    """A line of rows.jsonl: a finished point, identified by the digest of everything that determines the point.

    If the `time_limit`, s, cut its work short, the point is undecided, and a run with more time tries the point again.
    """

    key: str
    point: dict[str, float | str]
    status: str
    idle: bool
    reason: str | None
    seconds: float = 0.0
    time_limit: float | None = None


Cells = dict[str, bool | float | str | None]
"""A row of a study's table: the axes by dotted key, `status`, `idle`, the numbers and `reason`."""


class CornerRecord(Part):
    """The smallest box over the axes that holds every point without a certified design."""

    points: int
    share: float
    low: Mapping[str, Number]
    high: Mapping[str, Number]
    reason: str


class ObjectiveRecord(Part):
    """The yardstick of a study: the scale on which the errors of all points are measured, except for parts that an axis
    states."""

    band_hz: Pair
    reference_impedance: float
    norm: str
    weights: dict[str, float]
    varied: list[str]


class SweepRecord(Document):
    """The summary of a sweep.

    `units` states the units of axes and numbers. `idle` counts the certified designs that render almost nothing.
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
    """The two Pareto fronts: one over the three error terms, one over the error and the upper edge of the stability
    band."""

    SCHEMA = "vctune/front/1"

    problem: str
    units: dict[str, str]
    terms: list[Cells]
    band: list[Cells] | None
