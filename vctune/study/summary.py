"""What a sweep found, in a few numbers: the best, the worst, and where there is no design."""

from __future__ import annotations

from collections import Counter

import numpy as np

from vctune.document.rows import CornerRecord, SweepRecord
from vctune.study.table import Table


def summary(name: str, table: Table) -> SweepRecord:
    """Return what a sweep found: counts by status, best and worst design, corner without designs.

    The corner is the smallest box, over the axes, that holds every point without a certified design; `share` is how
    much of it they fill.

    Parameters
    ----------
    name : of the study
    table : a row a point
    """
    certified, error = table.certified, table.numbers["error"]
    order = np.flatnonzero(certified)[np.argsort(error[certified], kind="stable")]
    return SweepRecord(
        study=name,
        points=len(table.status),
        status=dict(sorted(Counter(table.status).items())),
        units=table.units,
        best=table.row(int(order[0])) if order.size else None,
        worst=table.row(int(order[-1])) if order.size else None,
        corner=_corner(table) if not certified.all() else None,
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
