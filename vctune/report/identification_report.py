"""Make the report of an identification: report.html and its figures as SVG."""

from __future__ import annotations

import json
from math import sqrt
from pathlib import Path

from vctune.document.records.identification_json import IdentificationRecord, device_text
from vctune.identification.identify import Identified
from vctune.report.figures.identification_figures import identification_figures
from vctune.report.figures.with_matplotlib import svg
from vctune.report.page.contents import IDENTIFICATION_READINGS, REPORT
from vctune.report.page.page import inline_svg
from vctune.report.page.templates import templates
from vctune.report.typography import span


def identification_files(found: Identified, record: IdentificationRecord, folder: Path) -> dict[Path, str]:
    """Return the figures and the report of an identification. The page is the last file."""
    pictures = {name: svg(figure, name) for name, figure in identification_figures(found, record).items()}
    files = {folder / f"{name}.svg": text for name, text in pictures.items()}
    return {**files, folder / REPORT: _page(record, pictures)}


def _page(record: IdentificationRecord, drawn: dict[str, str]) -> str:
    readings, put, found = IDENTIFICATION_READINGS, record.units.translated, _findings(record)
    shown = [
        {
            "name": name,
            "title": put(readings[name][0]),
            "finding": put(found.get(name, "")),
            "reading": put(readings[name][1]),
            "svg": inline_svg(text, put(f"{readings[name][0]}. {found.get(name, '')}").strip()),
        }
        for name, text in drawn.items()
    ]
    embedded = json.dumps(record.to_json(), indent=1, allow_nan=False).replace("<", "\\u003c")
    page = templates().get_template("identification.html.j2")
    return page.render(
        record=record,
        figures=shown,
        sentence=f"{len(record.numbers)} parameters, each with a range that the proof covers. {found['numbers']}",
        between=lambda each: str(span(each.low, each.high, each.unit)),
        text=device_text(record),
        embedded=embedded,
    )


def _findings(record: IdentificationRecord) -> dict[str, str]:
    """Return a sentence about each figure, by the figure's name."""
    widest = max(record.numbers, key=lambda each: each.share)
    between = span(widest.low, widest.high, widest.unit)
    found = {"numbers": f"{widest.key} has the widest range: {between}, ± {100 * widest.share:.2g} %."}
    shares = {each.source: each.residual_share for each in record.recordings if each.residual_share is not None}
    if shares:
        source = max(shares, key=lambda name: shares[name])
        left = f"The fit leaves at most {100 * shares[source]:.2g} %"
        found |= dict.fromkeys(("time-fit", "following", "response"), f"{left} unexplained.")
    noise = [each.chi2 for each in record.recordings if each.chi2 is not None]
    if noise:
        found["residual-spectrum"] = (
            f"The residual is {sqrt(max(noise)):.2g} times as large as the noise alone would make it."
        )
    return found
