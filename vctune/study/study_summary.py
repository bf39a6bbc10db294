"""Summarise a sweep: the best and the worst design, and the corner of the axes without designs."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict

import numpy as np

from vctune.document.records.rows_json import CornerRecord, StudyYardstickRecord, SweepRecord
from vctune.document.study_file import Study
from vctune.study.study_table import Table


def summary(study: Study, table: Table) -> SweepRecord:
    """Return the summary of a sweep: counts by status, yardstick, best and worst design, and the corner without
    designs."""
    certified, error = table.certified, table.numbers["error"]
    order = np.flatnonzero(certified)[np.argsort(error[certified], kind="stable")]
    return SweepRecord(
        study=study.name,
        points=len(table.status),
        status=dict(sorted(Counter(table.status).items())),
        idle=int(table.idle.sum()),
        yardstick=_yardstick(study),
        units=table.units,
        best=table.row(int(order[0])) if order.size else None,
        worst=table.row(int(order[-1])) if order.size else None,
        corner=_corner(table) if not certified.all() else None,
    )


def _yardstick(study: Study) -> StudyYardstickRecord:
    measured = study.yardstick.transparency
    return StudyYardstickRecord(
        band_hz=list(measured.band.hz),
        reference_impedance=measured.reference_impedance,
        norm=measured.norm,
        weights=asdict(measured.weights),
        varied=[axis.key for axis in study.axes if axis.path[0] == "transparency"],
    )


def _corner(table: Table) -> CornerRecord:
    without = ~table.certified
    low = {key: float(column[without].min()) for key, column in table.axes.items()}
    high = {key: float(column[without].max()) for key, column in table.axes.items()}
    inside = np.logical_and.reduce([(column >= low[key]) & (column <= high[key]) for key, column in table.axes.items()])
    reasons = Counter(reason for reason, lacks in zip(table.reason, without, strict=True) if lacks)
    return CornerRecord(
        points=int(without.sum()),
        share=float(without.sum() / inside.sum()),
        low=low,
        high=high,
        reason=reasons.most_common(1)[0][0],
    )
