"""Define `vctune schema`."""

from __future__ import annotations

import click

KINDS = ("problem", "gains", "study", "log", "design", "region", "rows", "simulation", "identification")


@click.command(short_help="Print the JSON Schema of a kind of file.")
@click.argument("kind", type=click.Choice(KINDS), default="problem")
def schema(kind: str) -> None:
    """Print the JSON Schema of a KIND of file. Without KIND, print the schema of the problem file.

    Editors use the schema of the problem file to complete keys. vctune reads the kinds problem, gains, study and log.
    vctune writes the kinds design, region, rows (each line of rows.jsonl), simulation and identification.
    """
    import json

    from vctune.api.json_schemas import SCHEMAS
    from vctune.cli.runner import emit

    emit(json.dumps(SCHEMAS[kind](), indent=2))
