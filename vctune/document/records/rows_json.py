"""Define the output of a study: the lines of rows.jsonl, and the objects of `vctune sweep` and `vctune front`.

A column's name has no dot, so it never equals the dotted key of an axis. vctune refuses a file with another `SCHEMA`.
The number that ends a `SCHEMA` increases when rows of an older version cannot be read or compared.
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
    """How a design feels, in physical units (`vctune.analysis.feel`); null without a design, or if it does not exist,
    for example above Nyquist.

    The wall is evaluated at 10 Hz. Tracking ends where |G_he| (for an impedance display |A H/N|) falls below 1/sqrt 2.
    """

    felt_mass_1hz: Annotated[Number, Shown("mass felt at 1 Hz", of="mass")]
    felt_mass_10hz: Annotated[Number, Shown("mass felt at 10 Hz", of="mass")]
    felt_damping_1hz: Annotated[Number, Shown("damping felt at 1 Hz", of="damping")]
    felt_damping_10hz: Annotated[Number, Shown("damping felt at 10 Hz", of="damping")]
    stiffest_wall: Annotated[Number, Shown("stiffest wall felt, at 10 Hz", of="stiffness")]
    tracking_bandwidth_hz: Annotated[Number, Shown("bandwidth of tracking", of="frequency")]


class RowYardstickRecord(Part):
    """The scale of a row's error in addition to norm and weights: the transparency band and Z_0."""

    yardstick_low_hz: Annotated[Number, Shown("lower edge of the transparency band", of="frequency")]
    yardstick_high_hz: Annotated[Number, Shown("upper edge of the transparency band", of="frequency")]
    reference_impedance: Annotated[Number, Shown("Z_0", of="damping")]


class NumbersRecord(Part):
    """The error, its unweighted terms, the design, the least ratio, its frequency, and the greatest |S|; null without a
    design.

    The labels of terms and ratio are those of an admittance display. An impedance display has the dual terms, and the
    ratio Re 1/Z_c / R. Numbers that a kind of display lacks are 0 or null. `coupling_stiffness` may be absent: older
    lines, without impedance displays, lack it.
    """

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


SHOWN_COLUMNS = how_shown(NumbersRecord) | how_shown(FeltRecord) | how_shown(RowYardstickRecord)
"""How tables display the columns of numbers, in order."""
QUANTITY_OF_COLUMN = {name: shown.of for name, shown in SHOWN_COLUMNS.items()}
"""Quantity of each column (`vctune.model.numbers.units`)."""
COLUMN_OF_KEY = {
    "gains.velocity": "velocity_gain",
    "gains.position": "position_gain",
    "coupling.damping": "coupling_damping",
    "coupling.mass": "coupling_mass",
    "coupling.drag": "coupling_drag",
    "coupling.stiffness": "coupling_stiffness",
}
"""Column of each number of a design, by its key. Each kind of display has only some of these numbers."""


class RowRecord(RowYardstickRecord, FeltRecord, NumbersRecord):
    """A line of rows.jsonl: a finished point.

    pydantic collects fields from the last base to the first, so that the line begins with the numbers of the design.

    Attributes
    ----------
    key : digest of everything that determines the point
    point : value of each axis, by its dotted key
    status : "certified", "infeasible", "undecided" or "failed"
    idle : whether the design is certified and renders almost nothing
    reason : reason why the point has no design; None for a certified design
    seconds : elapsed time, s
    time_limit : time limit that cut the work short, s; None if none did. With a time limit the point is undecided, and
        a run with more time tries it again
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
    """The smallest box over the axes that holds every point without a certified design.

    Attributes
    ----------
    points : number of these points
    share : their share of the points of the box
    low, high : ends of the box, by the dotted key of the axis
    reason : most frequent reason of these points
    """

    points: int
    share: float
    low: Mapping[str, Number]
    high: Mapping[str, Number]
    reason: str


class StudyYardstickRecord(Part):
    """The yardstick of a study: the scale on which the errors of all points are measured, except for parts that an axis
    states.

    Attributes
    ----------
    band_hz : edges of the transparency band, Hz
    reference_impedance : Z_0, N s/m or N m s/rad
    norm : norm of the error over frequency
    weights : weight of each error term
    varied : keys of the yardstick that an axis states
    """

    band_hz: Pair
    reference_impedance: float
    norm: str
    weights: dict[str, float]
    varied: list[str]


class SweepRecord(Document):
    """The summary of a sweep.

    Attributes
    ----------
    study : name of the study
    points : number of finished points
    status : number of points by their status
    idle : number of certified designs that render almost nothing
    yardstick : scale of the errors
    units : units of axes and numbers, by key and column
    best, worst : certified rows with the least and the greatest error; None without a certified design
    corner : box that holds every point without a design; None if there is no such point
    """

    SCHEMA = "vctune/sweep/2"

    study: str
    points: int
    status: dict[str, int]
    idle: int
    yardstick: StudyYardstickRecord
    units: dict[str, str]
    best: Cells | None
    worst: Cells | None
    corner: CornerRecord | None


class FrontRecord(Document):
    """The two Pareto fronts of a problem.

    Attributes
    ----------
    problem : name of the problem
    units : units of the numbers, by column
    terms : rows of the front over the three error terms
    band : rows of the front over the error and the upper edge of the stability band; None if it is not required
    """

    SCHEMA = "vctune/front/1"

    problem: str
    units: dict[str, str]
    terms: list[Cells]
    band: list[Cells] | None
