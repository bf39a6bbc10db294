"""The gallery of results/README.md, from nothing but the files of problems/ and results/."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

ROOT = Path(__file__).parent.parent
HEAD = ["| | design | verdict | error | |", "|---|---|---|---|---|"]


def gallery(root: Path = ROOT) -> str:
    """Return the table of all designs and studies: thumbnail, name, verdict, error, the file's own first sentence."""
    problems = [_design(path, root / "results" / path.stem) for path in sorted((root / "problems").glob("*.toml"))]
    studies = [
        _study(path, root / "results" / path.stem) for path in sorted((root / "problems/studies").glob("*.toml"))
    ]
    return "\n".join([*HEAD, *problems, *studies]) + "\n"


def _design(problem: Path, folder: Path) -> str:
    record = json.loads((folder / "design.json").read_text())
    verdict, error = record["status"], "–"
    if record["transparency"] is not None:
        error = f"{record['transparency']['error']:.4g}"
    band = (record["certificate"] or {}).get("proved_band_hz")
    if band is not None:
        low, high = (f"{edge:.4g}" if edge is not None else "∞" for edge in band)
        verdict += f", {low} to {high} Hz"
    if (record["certificate"] or {}).get("hands", {}).get("verdict") == "proved":
        verdict += ", in every hand"
    if (record["certificate"] or {}).get("any_hand", {}).get("verdict") == "proved":
        verdict += ", in any passive hand"
    names = ("llewellyn", "any-hand", "hands")
    picture = next((name for name in names if (folder / f"{name}.svg").exists()), "hands")
    return _row(folder, picture, verdict, error, problem)


def _study(study: Path, folder: Path) -> str:
    with (folder / "table.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    errors = [float(row["error"]) for row in rows if row["status"] == "certified"]
    return _row(
        folder, "error", f"{len(errors)} of {len(rows)} certified", f"{min(errors):.4g} to {max(errors):.4g}", study
    )


def _row(folder: Path, picture: str, verdict: str, error: str, source: Path) -> str:
    thumbnail = f"{folder.name}/{picture}.svg"
    shown = f'[<img src="{thumbnail}" width="160" alt="{picture}">]({folder.name})'
    shown = shown if (folder / f"{picture}.svg").exists() else ""
    return f"| {shown} | [{folder.name}]({folder.name}) | {verdict} | {error} | {_first_sentence(source)} |"


def _first_sentence(source: Path) -> str:
    """Return the first sentence of a file's first comment, which says what the file is about."""
    comment = re.search(r"(?:^# .*\n)+", source.read_text(), re.MULTILINE)[0]
    text = " ".join(line.removeprefix("# ") for line in comment.splitlines())
    return re.match(r".*?[.?!](?= |$)", text)[0]
