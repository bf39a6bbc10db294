"""`vctune schema`."""

from __future__ import annotations

import click

KINDS = (
    "problem", "gains", "study", "log", "design", "region", "rows", "simulation", "identification", "check", "sweep",
    "front", "comparison", "export", "report", "bench", "explanation", "example",
)  # fmt: skip


@click.command(short_help="Print the JSON Schema of a kind of document.")
@click.argument("kind", type=click.Choice(KINDS), default="problem")
def schema(kind: str) -> None:
    """Print the JSON Schema of the problem file, for completion in editors, or of another KIND of document.

    Files that are read: problem, gains, study, log. Files that are written: design, region, rows (each line of
    rows.jsonl), simulation, identification. What --format json prints beside these: check, sweep, front, comparison,
    export, report, bench, explanation, example.
    """
    import json

    from vctune.api.messages import schema_of
    from vctune.cli.printing.output import emit

    emit(json.dumps(schema_of(kind), indent=2))
