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

    vctune reads these files: problem, gains, study, log. It writes these: design, region, rows (each line of
    rows.jsonl), simulation, identification. The others are only printed, by --format json: check, sweep, front,
    comparison, export, report, bench, explanation, example.
    """
    import json

    from vctune.api.messages import schema_of
    from vctune.cli.printing.output import emit

    emit(json.dumps(schema_of(kind), indent=2))
