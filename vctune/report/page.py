"""The page: figures and numbers of design.json in one self-contained HTML file."""

from __future__ import annotations

import json
import re
from io import BytesIO
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from matplotlib import rc_context
from matplotlib.figure import Figure

from vctune.model.problem import Problem
from vctune.report.contents import READINGS
from vctune.report.experiments import HEADINGS, measured_rows
from vctune.report.style import INK, PAPER


def page(
    record: dict[str, Any], problem: Problem, drawn: dict[str, str], simulation: dict[str, Any] | None = None
) -> str:
    """Return the HTML of a design.

    Parameters
    ----------
    record : the object of design.json, which the page embeds
    problem : the problem that the record's text states
    drawn : figures as SVG, by name
    simulation : the object of simulation.json, if there is one
    """
    environment = Environment(
        loader=PackageLoader("vctune", "report"), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    shown = [
        {"title": READINGS[name][0], "reading": READINGS[name][1], "svg": inline(text)} for name, text in drawn.items()
    ]
    embedded = json.dumps(record, indent=1, allow_nan=False).replace("<", "\\u003c")
    template = environment.get_template("page.html.j2")
    return template.render(
        record=record,
        problem=problem,
        figures=shown,
        numbers=_numbers(record),
        embedded=embedded,
        measured=measured_rows(simulation) if simulation else [],
        headings=HEADINGS,
    )


def inline(text: str) -> str:
    """Return an SVG file as an element that takes its ink from the page's text colour and lets its ground through."""
    text = re.sub(r"^.*?(?=<svg)", "", text, flags=re.DOTALL)
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    return text.replace(INK, "currentColor").replace(PAPER, "none")


def svg(figure: Figure, name: str) -> str:
    """Return a figure as SVG: the same bytes for the same figure, places to a hundredth of a point, no idle names."""
    stream = BytesIO()
    with rc_context({"svg.hashsalt": name, "svg.fonttype": "none"}):
        figure.savefig(stream, format="svg", dpi=150, metadata={"Date": None, "Creator": None})
    text = re.sub(r"\n +", "\n", stream.getvalue().decode())
    for long, short in ((r"font-family: [^;\"]*", "font-family: sans-serif"), (r'<g id="[^"]*">', "<g>")):
        text = re.sub(long, short, text)
    return re.sub(r'(?<=[ \n])(d|x|y|transform)="[^"]*"', _rounded, text)


def _rounded(attribute: re.Match[str]) -> str:
    return re.sub(r"-?\d+\.\d{3,}(e-?\d+)?", lambda number: f"{float(number[0]):.2f}", attribute[0])


def figure_file(figure: Figure, folder: Path, stem: str) -> dict[Path, str]:
    """Return a figure as an SVG file."""
    return {folder / f"{stem}.svg": svg(figure, stem)}


def _numbers(record: dict[str, Any]) -> list[tuple[str, str, str]]:
    if record["gains"] is None:
        return []
    gains, coupling, error = record["gains"], record["coupling"], record["transparency"]
    proof, loop = record["certificate"], record["inner_loop"]
    rows = [
        ("velocity gain K_v", gains["velocity"], "N s/m", 8),
        ("position gain K_p", gains["position"], "N/m", 8),
        ("coupling damping b_c", coupling["damping"], "N s/m", 8),
        ("coupling mass m_c", coupling["mass"], "kg", 8),
        ("coupling drag b_0", coupling["drag"], "N s/m", 8),
        ("transparency error", error["error"], "", 5),
        ("least Re Z_c / R", proof["min_ratio"], _at(proof["worst_hz"]), 6),
        ("Rollett's K there", proof["rollett_k"], "", 6),
        ("proved from", proof["proved_band_hz"][0] if proof["proved_band_hz"] else None, "Hz", 6),
        ("proved to", proof["proved_band_hz"][1] if proof["proved_band_hz"] else None, "Hz", 6),
        ("peak |S|", loop["peak_sensitivity"], _at(loop["peak_sensitivity_hz"]), 5),
        ("spectral radius, sampled", loop["spectral_radius"], "", 6),
        ("gain margin", loop["gain_margin_db"], "dB", 5),
        ("phase margin", loop["phase_margin_deg"], "deg", 5),
        ("delay margin", loop["delay_margin_s"], "s", 5),
    ]
    if proof.get("without_operator"):
        bare = proof["without_operator"]
        rows.insert(
            7, ("the same without operator", bare["min_ratio"], f"{_at(bare['worst_hz'])}, {bare['verdict']}", 6)
        )
    if record.get("uncertainty"):
        known = record["uncertainty"]
        rows[6:6] = [
            ("worst error of uncertain devices", known["worst_error"], _with(known["worst_device"]), 5),
            ("least error if the device were certain", known["nominal_error"], "", 5),
        ]
    if record.get("optimality"):
        found = record["optimality"]
        gap = "" if found["gap"] is None else f"gap {100 * found['gap']:.3g} %, "
        rows.append(("no design is below", found["lower_bound"], f"{gap}{found['verdict']}", 5))
    count = loop["nyquist"]
    rows.append(
        (
            "Z = N + P, poles to the right",
            count["Z"],
            f"N = {count['N']} encirclements of -1, P = 0 in the open loop",
            1,
        )
    )
    return [(label, "none" if value is None else f"{value:.{digits}g}", unit) for label, value, unit, digits in rows]


def _with(device: dict[str, float]) -> str:
    return f"mass {device['mass']:.5g} kg, damping {device['damping']:.5g} N s/m, delay {device['delay']:.5g} s"


def _at(hz: float | None) -> str:
    return "" if hz is None else f"at {hz:.5g} Hz"
