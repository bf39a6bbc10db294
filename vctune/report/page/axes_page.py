"""The page of a problem with several axes: a row for each axis, with a link to its report."""

from __future__ import annotations

from collections.abc import Mapping

from vctune.document.records.design_json import DesignRecord
from vctune.document.records.part import text
from vctune.document.text.output_files import folder_name
from vctune.report.page.contents import REPORT
from vctune.report.page.templates import templates

HEADINGS = ("axis", "status", "mass", "drag", "least ratio", "error")
VERDICTS = {"certified": "proved", "undecided": "undecided"}  # Verdict that the page shows for a status


def axis_row(name: str, record: DesignRecord) -> tuple[str, ...]:
    """Return the cells of an axis, in the order of `HEADINGS`."""
    units, coupling, certificate = record.units, record.coupling, record.certificate
    mass, drag = getattr(coupling, "mass", None), getattr(coupling, "drag", None)
    hands = None if certificate is None else certificate.hands
    ratio = None if certificate is None else (hands.min_ratio if hands is not None else certificate.min_ratio)
    return (
        name,
        record.status,
        "" if mass is None else f"{text(mass, 5)} {units.mass}",
        "" if drag is None else f"{text(drag, 5)} {units.damping}",
        "" if ratio is None else text(ratio, 5),
        "" if record.transparency is None else text(record.transparency.error, 5),
    )


def promises(designs: Mapping[str, DesignRecord]) -> list[str]:
    """Return the proved claims of the axes. Each sentence occurs once, after the names of its axes."""
    proved: dict[str, list[str]] = {}
    for axis, record in designs.items():
        if record.promise:
            proved.setdefault(record.promise, []).append(axis)
    return [f"{', '.join(axes)}: {promise}" for promise, axes in proved.items()]


def axes_page(name: str, designs: Mapping[str, DesignRecord], *, reported: bool) -> str:
    """Return the HTML of the axes of a problem."""
    rows = {axis: axis_row(axis, record) for axis, record in designs.items()}
    axes = [
        {
            "name": axis,
            "link": f"{folder_name(axis)}/{REPORT}" if reported else "",
            "status": status,
            "verdict": VERDICTS.get(status, "refuted"),
            "cells": list(zip(HEADINGS[2:], cells, strict=True)),
        }
        for axis, status, *cells in rows.values()
    ]
    return (
        templates()
        .get_template("axes.html.j2")
        .render(
            name=name,
            axes=axes,
            headings=HEADINGS,
            proved=promises(designs),
            failed=[
                f"{axis}: {record.reason or record.status}" for axis, record in designs.items() if not record.promise
            ],
            warnings=[f"{axis}: {line}" for axis, record in designs.items() for line in record.warnings],
        )
    )
