"""`vctune solve`."""

from __future__ import annotations

from pathlib import Path

import click


@click.command()
@click.argument("problem", type=click.Path(path_type=Path))
@click.option(
    "--out", type=click.Path(path_type=Path), default=Path("results"), show_default=True, help="Folder for DIR/NAME/."
)
@click.option("--json", "as_json", is_flag=True, help="Print design.json instead of the table.")
@click.option("--no-report", is_flag=True, help="Write only gains.toml and design.json.")
@click.option("--quiet", is_flag=True, help="No progress and no table.")
def solve(problem: Path, out: Path, as_json: bool, no_report: bool, quiet: bool) -> int:
    """Find the most transparent gains of PROBLEM and prove them stable.

    PROBLEM is a TOML file; only [device] mass, damping and sample_time are required in it.
    """
    import json

    from vctune.cli.progress import progress_on_stderr
    from vctune.document.files import folder_name, make_folder, write_text
    from vctune.document.gains import gains_text
    from vctune.document.reading import read_problem

    file = read_problem(problem)
    folder = out / folder_name(file.problem.name)
    make_folder(folder)

    from vctune.design import solve as solving
    from vctune.design.judge import EXIT_CODES
    from vctune.design.nlp import ipopt_version
    from vctune.design.record import design_record

    with progress_on_stderr(f"vctune solve {problem.name}", shown=not quiet) as progress:
        solved = solving.solve(file.problem, progress)
    record = design_record(file, solved, ipopt_version())
    text = json.dumps(record, indent=2, allow_nan=False)
    if solved.judgement is not None:
        origin = {
            "problem": file.problem.name,
            "sha256": file.sha256,
            "vctune": record["versions"]["vctune"],
            "verdict": record["certificate"]["verdict"],
        }
        write_text(folder / "gains.toml", gains_text(solved.judgement.gains, solved.judgement.coupling, origin))
    write_text(folder / "design.json", text + "\n")
    if as_json:
        click.echo(text)
    elif not quiet:
        from vctune.cli.table import print_design

        print_design(record, folder)
    return EXIT_CODES[solved.status]
