"""The page of a problem with several axes: a line for each, with a link to its report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

from vctune.document.records.design_json import DesignRecord
from vctune.document.records.part import text
from vctune.document.text.output_files import folder_name
from vctune.report.page.contents import REPORT

HEADINGS = ("axis", "status", "mass", "drag", "least ratio", "error")
STYLE = (
    "body { font: 1rem/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; "
    "color-scheme: light dark; } td, th { text-align: left; padding: .15rem 1rem .15rem 0; }"
)


def axis_row(name: str, record: DesignRecord) -> tuple[str, ...]:
    """Return the cells of an axis, in the order of `HEADINGS`.

    Parameters
    ----------
    name : name of the axis
    record : record of its design, or of the reason why there is none
    """
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
    """Return the proved claims of the axes: each sentence once, after the names of its axes.

    Parameters
    ----------
    designs : designs by the name of the axis
    """
    proved: dict[str, list[str]] = {}
    for axis, record in designs.items():
        if record.promise:
            proved.setdefault(record.promise, []).append(axis)
    return [f"{', '.join(axes)}: {promise}" for promise, axes in proved.items()]


def axes_page(name: str, designs: Mapping[str, DesignRecord], *, reported: bool) -> str:
    """Return the HTML of the axes of a problem.

    Parameters
    ----------
    name : name of the problem
    designs : designs by the name of the axis
    reported : whether each axis has a report, which its name then leads to
    """
    rows = "".join(_row(axis_row(axis, record), reported) for axis, record in designs.items())
    proved = "".join(f"<p>{escape(promise)}</p>\n" for promise in promises(designs))
    headings = "".join(f"<th>{escape(heading)}</th>" for heading in HEADINGS)
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{escape(name)}: axes</title>\n'
        f"<style>{STYLE}</style>\n</head>\n<body>\n<h1>{escape(name)}</h1>\n{proved}<table>\n<tr>{headings}</tr>\n{rows}"
        "</table>\n</body>\n</html>\n"
    )


def _row(cells: Sequence[str], reported: bool) -> str:
    axis, *others = cells
    first = f'<a href="{escape(folder_name(axis))}/{REPORT}">{escape(axis)}</a>' if reported else escape(axis)
    return f"<tr><td>{first}</td>{''.join(f'<td>{escape(cell)}</td>' for cell in others)}</tr>\n"
