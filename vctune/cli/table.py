"""A design as a table for people."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from vctune.document.errors import printable

LEAST_WIDTH = 80
WIDE = 120
COLOURS = {"certified": "green", "violated": "red", "infeasible": "red", "undecided": "yellow"}


def print_design(record: dict[str, Any], folder: Path) -> None:
    """Print the object of design.json (document/README.md, section 3) and where the files are."""
    console = Console(highlight=False)
    console.width = max(console.width, WIDE)
    with console.capture() as page:  # written in one piece, whole or not at all
        status = record["status"]
        name = escape(printable(record["problem"]["name"]))
        idle = ", but it hardly uses its velocity loop" if record.get("idle") else ""
        colour = COLOURS["undecided" if idle else status]
        console.print(f"[bold]{name}[/bold]: [bold {colour}]{status}{idle}[/]")
        if record["reason"]:
            console.print(escape(record["reason"]), soft_wrap=True)
        if record["gains"] is not None:
            console.print(_table(record))
        if record.get("repairs"):
            console.print("any one of these alone would do:")
            console.print(_repairs(record["repairs"]), soft_wrap=True)
        elif record.get("repairs") is not None:
            console.print("no change of one number was found that would do")
        for warning in record["warnings"]:
            console.print(f"[yellow]warning:[/yellow] {escape(warning)}", soft_wrap=True)
        for line in record["left_out"]:
            console.print(f"[dim]left out: {escape(line)}[/dim]", soft_wrap=True)
        console.print(f"written to {escape(str(folder))}", soft_wrap=True)
    console.file.write(page.get())


def print_simulation(record: dict[str, Any], folder: Path) -> None:
    """Print the object of simulation.json and where the files are."""
    from vctune.report.experiments import HEADINGS, measured_rows

    console = Console(highlight=False)
    console.width = max(console.width, WIDE)
    with console.capture() as page:
        console.print(f"[bold]{escape(printable(record['problem']['name']))}[/bold]")
        table = Table(box=None, pad_edge=False)
        for heading in HEADINGS:
            table.add_column(heading, no_wrap=True, header_style="dim")
        for row in measured_rows(record):
            table.add_row(*(escape(printable(cell)) for cell in row))
        console.print(table)
        for one in record["experiments"]:
            if (least := one["least_virtual"]) is not None:
                console.print(f"{escape(printable(one['name']))}: {_least(least)}", soft_wrap=True)
        console.print(f"written to {escape(str(folder))}", soft_wrap=True)
    console.file.write(page.get())


def _least(least: dict[str, float]) -> str:
    if least["share"] == 0:
        return "the regular PID is stable without a virtual mass and damping"
    return (
        f"the regular PID is stable from a virtual mass of {least['mass']:.4g} kg and a damping of "
        f"{least['damping']:.4g} N s/m on"
    )


def _repairs(repairs: list[dict[str, Any]]) -> str:
    """Return a line a repair: what the file needs, instead of what, what that means, and the error that it buys."""
    width = max(len(repair["needs"]) for repair in repairs)
    lines = []
    for repair in repairs:
        old = "inf" if repair["old"] is None else _text(repair["old"], 12)
        lines.append(
            f"  [bold]{escape(repair['needs'].ljust(width))}[/bold]  instead of {old}: {escape(repair['change'])}, "
            f"error {_text(repair['error'], 4)}"
        )
    return "\n".join(lines)


def _table(record: dict[str, Any]) -> Table:
    table = Table(show_header=False, box=None, pad_edge=False)
    for style in ("dim", "", "bold", ""):
        table.add_column(style=style, no_wrap=True, justify="right" if style == "bold" else "left")
    for group, rows in _rows(record).items():
        for number, (label, value, unit) in enumerate(rows):
            table.add_row(group if number == 0 else "", label, value, unit)
    return table


def _rows(record: dict[str, Any]) -> dict[str, list[tuple[str, str, str]]]:
    gains, coupling, error = record["gains"], record["coupling"], record["transparency"]
    proof, loop = record["certificate"], record["inner_loop"]
    return {
        "gains": [
            ("velocity K_v", _text(gains["velocity"], 8), "N s/m"),
            ("position K_p", _text(gains["position"], 8), "N/m"),
        ],
        "coupling": [
            ("damping b_c", _text(coupling["damping"], 8), "N s/m"),
            ("mass m_c", _text(coupling["mass"], 8), "kg"),
            ("drag b_0", _text(coupling["drag"], 8), "N s/m"),
        ],
        "transparency": [
            ("error", _text(error["error"]), ""),
            ("|Z_0 G_hh|", _text(error["admittance"]), ""),
            ("|1 - G_he|", _text(error["tracking"]), ""),
            ("|Z_c|/Z_0", _text(error["coupling"]), ""),
        ],
        "certificate": [
            ("verdict", proof["verdict"], f"{proof['boxes']} boxes"),
            ("band", _band(proof["band_hz"]), "Hz"),
            ("proved band", _band(proof["proved_band_hz"]), "Hz"),
            ("least Re Z_c / R", _text(proof["min_ratio"]), f"at {_text(proof['worst_hz'])} Hz"),
            *_without_operator(proof),
            *(row for claim in _open(proof) for row in _claim(claim)),
        ],
        **(
            {"uncertainty": _uncertainty(record["uncertainty"], _text(proof["min_ratio"]))}
            if record.get("uncertainty")
            else {}
        ),
        **({"optimality": _optimality(record["optimality"])} if record.get("optimality") else {}),
        "velocity loop": [
            ("spectral radius", _text(loop["spectral_radius"]), _stable(loop["stable"])),
            ("peak |S|", _text(loop["peak_sensitivity"]), f"at {_text(loop['peak_sensitivity_hz'])} Hz"),
            ("gain margin", _text(loop["gain_margin_db"]), "dB"),
            ("phase margin", _text(loop["phase_margin_deg"]), "deg"),
            ("delay margin", _text(loop["delay_margin_s"]), "s"),
        ],
    }


def _without_operator(proof: dict[str, Any]) -> list[tuple[str, str, str]]:
    bare = proof.get("without_operator")
    if not bare:
        return []
    return [("without operator", _text(bare["min_ratio"]), f"at {_text(bare['worst_hz'])} Hz, {bare['verdict']}")]


DEVICE_UNITS = {"mass": "kg", "damping": "N s/m", "delay": "s"}


def _device(device: dict[str, float]) -> str:
    return ", ".join(f"{_text(value)} {DEVICE_UNITS[name]}" for name, value in device.items() if value)


def _uncertainty(found: dict[str, Any], ratio: str) -> list[tuple[str, str, str]]:
    rows = [(name, _band(ends), DEVICE_UNITS[name]) for name, ends in found["box"].items()]
    rows.append(("least ratio", ratio, f"at {_device(found['min_ratio_device'])}"))
    rows.append(("worst error", _text(found["worst_error"]), f"at {_device(found['worst_device'])}"))
    if found["nominal_error"] is not None:
        rows.append(("error if certain", _text(found["nominal_error"]), "of the best design"))
    return rows


def _optimality(found: dict[str, Any]) -> list[tuple[str, str, str]]:
    rows = [("lower bound", _text(found["lower_bound"]), f"{found['verdict']}, {found['boxes']} boxes")]
    if found["gap"] is not None:
        rows.append(("gap", f"{100 * found['gap']:.3g}", "%"))
    return rows


def print_sweep(found: dict[str, Any], folder: Path) -> None:
    """Print the object of `vctune sweep --format json` and where the files are."""
    console = Console(highlight=False)
    console.width = max(console.width, LEAST_WIDTH)
    with console.capture() as page:
        counts = ", ".join(f"{count} {status}" for status, count in found["status"].items())
        console.print(f"[bold]{escape(printable(found['study']))}[/bold]: {found['points']} points, {counts}")
        for label in ("best", "worst"):
            if found[label]:
                console.print(f"{label:<5}  {_design_line(found[label])}", soft_wrap=True)
        if found["corner"]:
            console.print(_corner_line(found["corner"]), soft_wrap=True)
        console.print(f"written to {escape(str(folder))}", soft_wrap=True)
    console.file.write(page.get())


def _design_line(row: dict[str, Any]) -> str:
    axes = ", ".join(f"{key} = {_text(value, 6)}" for key, value in row.items() if "." in key)
    return escape(f"error {_text(row['error'])} at {axes}")


def _corner_line(corner: dict[str, Any]) -> str:
    spans = ", ".join(
        f"{key} from {_text(low, 6)} to {_text(high, 6)}"
        for (key, low), high in zip(corner["from"].items(), corner["to"].values(), strict=True)
    )
    where = f"none   at {corner['points']} points, {corner['share']:.0%} of those with {spans}"
    return escape(f"{where}\n       most often: {printable(corner['reason'])}")


def _open(proof: dict[str, Any]) -> list[dict[str, Any]]:
    return [claim for claim in proof["claims"] if claim["verdict"] != "proved"]


def _claim(claim: dict[str, Any]) -> list[tuple[str, str, str]]:
    hz, device = claim["witness_hz"], claim.get("witness_device")
    rows = [(claim["claim"], claim["verdict"], "" if hz is None else f"at {hz:.6g} Hz")]
    return [*rows, (f"  with {_device(device)}", "", "")] if device else rows


def _stable(stable: bool | None) -> str:
    return {True: "stable", False: "unstable", None: "undecided"}[stable]


def _band(band: list[float | None] | None) -> str:
    if band is None:
        return "-"
    low, high = (_text(edge) if edge is not None else "inf" for edge in band)
    return f"{low} to {high}"


def _text(value: float | None, digits: int = 5) -> str:
    return "none" if value is None else f"{value:.{digits}g}"
