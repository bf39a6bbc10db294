"""`vctune solve`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from vctune.document.reading import ProblemFile
    from vctune.model.quantities import Coupling, Gains


@click.command(short_help="Find the most transparent gains and prove them stable.")
@click.argument("problem", type=click.Path(path_type=Path))
@click.option(
    "--out", type=click.Path(path_type=Path), default=Path("results"), show_default=True, help="Folder for OUT/NAME/."
)
@click.option("--json", "as_json", is_flag=True, help="Print design.json instead of the table.")
@click.option("--no-report", is_flag=True, help="Write only gains.toml and design.json; an earlier report is removed.")
@click.option("--quiet", is_flag=True, help="No progress and no table.")
@click.option("--strict", is_flag=True, help="Exit code 1 if there is a warning.")
@click.option(
    "--prove-gap",
    "gap",
    type=click.FloatRange(1e-4, 10.0),
    metavar="GAP",
    help="Prove that no design has an error lower by more than this share, 0.03 for 3 %.",
)
def solve(
    problem: Path, out: Path, as_json: bool, no_report: bool, quiet: bool, strict: bool, gap: float | None
) -> int:
    """Find the most transparent gains of PROBLEM and prove them stable.

    PROBLEM is a TOML file; only [device] mass, damping and sample_time are required in it.
    """
    import json

    from vctune.cli.output import emit, reader_may_leave
    from vctune.cli.progress import progress_on_stderr
    from vctune.document.reading import read_problem

    file = read_problem(problem)
    folder = design_folder(file, problem, out)

    from vctune.design.judge import EXIT_CODES, Status
    from vctune.design.nlp import ipopt_version
    from vctune.design.record import design_record
    from vctune.design.repaired import repaired
    from vctune.design.solve import solve as solve_problem
    from vctune.exits import ExitCode

    with progress_on_stderr(f"vctune solve {problem.name}", shown=not quiet) as progress:
        solved = repaired(file, solve_problem(file.problem, progress, gap=gap), progress)
        record = design_record(file, solved, ipopt_version())
        text = json.dumps(record, indent=2, allow_nan=False)
        judgement = solved.judgement
        write_design(folder, file, record, text, (judgement.gains, judgement.coupling) if judgement else None)
        if not no_report:
            progress("drawing the report")
            from vctune.document.simulation import simulation_beside
            from vctune.report.report import write_report

            write_report(record, folder, simulation_beside(folder, record))
    if as_json:
        emit(text)
    elif not quiet:
        from vctune.cli.table import print_design

        with reader_may_leave():
            print_design(record, folder)
    if strict and record["warnings"]:
        return ExitCode.FAILED
    open_ = gap is not None and solved.optimality is not None and not solved.optimality.proved
    return ExitCode.UNDECIDED if open_ and solved.status is Status.CERTIFIED else EXIT_CODES[solved.status]


def design_folder(file: ProblemFile, problem: Path, out: Path) -> Path:
    """Return the folder of the design, made and writable, after making sure that nobody else's work is in it."""
    import json

    from vctune.document.errors import InputError, Mistake
    from vctune.document.files import folder_name, make_folder

    folder = out / folder_name(file.problem.name)
    make_folder(folder)
    if problem.resolve() in ((folder / name).resolve() for name in ("gains.toml", "design.json")):
        raise InputError(str(problem), [Mistake("", "would be overwritten by its own design; choose another --out")])
    try:
        owner = json.loads((folder / "design.json").read_text())["problem"]["name"]
    except (OSError, ValueError, KeyError, TypeError):
        return folder
    if owner != file.problem.name:
        message = f"holds the design of {owner!r}, not of {file.problem.name!r}; choose another name or --out"
        raise InputError(str(folder), [Mistake("", message)])
    return folder


def write_design(
    folder: Path, file: ProblemFile, record: dict[str, Any], text: str, design: tuple[Gains, Coupling] | None
) -> None:
    """Write design.json, and gains.toml with it, and remove the report of an earlier design.

    Without a design older gains are renamed, not left beside it.
    """
    from vctune.document.files import previous, write_together
    from vctune.document.gains import gains_text
    from vctune.report.contents import report_paths

    texts = {folder / "design.json": text + "\n"}
    if design is not None:
        origin = {
            "problem": file.problem.name,
            "sha256": file.sha256,
            "vctune": record["versions"]["vctune"],
            "verdict": record["certificate"]["verdict"],
        }
        texts[folder / "gains.toml"] = gains_text(*design, origin)
    earlier = [path for path in (folder / "gains.toml",) if design is None and path.exists()]
    write_together(texts, report_paths(folder), earlier)
    for path in earlier:
        click.echo(f"{path}: gains of an earlier run, renamed to {previous(path).name}", err=True)
