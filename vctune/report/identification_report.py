"""From an identification to its report: report.html and its figures as SVG."""

from __future__ import annotations

import json
from pathlib import Path

from vctune.document.records.identification_json import IdentificationRecord, device_text
from vctune.identification.identify import Identified
from vctune.report.figures.identification_figures import identification_figures
from vctune.report.page.contents import IDENTIFICATION_READINGS, REPORT
from vctune.report.page.page import inline, svg
from vctune.report.page.templates import templates


def identification_files(found: Identified, record: IdentificationRecord, folder: Path) -> dict[Path, str]:
    """Return the report of an identification and its figures, the page last.

    Parameters
    ----------
    found : device, box and studies of the recordings
    record : the same identification as identification.json holds it
    folder : folder for the files

    Returns
    -------
    dict
        Texts by path.
    """
    pictures = {name: svg(figure, name) for name, figure in identification_figures(found, record).items()}
    files = {folder / f"{name}.svg": text for name, text in pictures.items()}
    return {**files, folder / REPORT: _page(record, pictures)}


def _page(record: IdentificationRecord, drawn: dict[str, str]) -> str:
    readings, put = IDENTIFICATION_READINGS, record.units.translated
    shown = [
        {
            "title": put(readings[name][0]),
            "reading": put(readings[name][1]),
            "svg": inline(text, put(readings[name][0])),
        }
        for name, text in drawn.items()
    ]
    embedded = json.dumps(record.to_json(), indent=1, allow_nan=False).replace("<", "\\u003c")
    return (
        templates()
        .get_template("identification.html.j2")
        .render(record=record, figures=shown, text=device_text(record), embedded=embedded)
    )
