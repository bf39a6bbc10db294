"""`vctune schema`."""

from __future__ import annotations

import click


@click.command(short_help="Print the JSON Schema of the problem file.")
def schema() -> None:
    """Print the JSON Schema of the problem file, for completion in editors."""
    import json

    from vctune.cli.output import emit
    from vctune.document.schema import json_schema

    emit(json.dumps(json_schema(), indent=2))
