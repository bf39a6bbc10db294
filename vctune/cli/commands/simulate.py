"""Define `vctune simulate`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from vctune.cli.printing.options import out_option, output_options, problem_argument

if TYPE_CHECKING:
    from vctune.cli.printing.progress import Progress
    from vctune.document.reading import ProblemFile
    from vctune.model.gains import AnyCoupling, Gains


@click.command(short_help="Simulate a design in the problem's experiments.")
@problem_argument
@click.argument("gains", type=click.Path(path_type=Path), required=False)
@click.option("--experiment", "name", help="Name of the experiment to simulate. [default: all]")
@out_option()
@output_options()
def simulate(
    problem: Path,
    gains: Path | None,
    name: str | None,
    out: Path,
    style: str,
    quiet: bool,
) -> int:
    """Simulate a design in the [[experiment]] tables of PROBLEM.

    The design is in GAINS. Without GAINS, it is the one that `vctune solve PROBLEM` has written; if there is none,
    vctune solves PROBLEM first, and never replaces another design. The command writes simulation.json, traces.npz and
    the figure `simulation`, and adds the figure to the report of this design. The exit code is 1 if there is no design,
    if the design diverges in an experiment, or if it is unstable with the hand and environment of an experiment.
    """
    from vctune import read_problem
    from vctune.api.experiments import (
        chosen_experiments,
        design_for,
        write_simulation,
    )
    from vctune.api.experiments import simulate as run
    from vctune.api.folders import design_folder
    from vctune.cli.printing.output import answer, warn, warn_of_doubts
    from vctune.cli.printing.progress import progress_on_stderr
    from vctune.exit_codes import ExitCode

    file = read_problem(problem)
    chosen_experiments(file, name)
    warn_of_doubts(file, quiet=quiet)
    given = design_for(file, gains) if gains else None
    if given and given.sha256 not in (None, file.sha256):
        warn("other-version", f"{gains}: made for another version of the problem (sha256 differs)")
    folder = design_folder(file, out)

    with progress_on_stderr(f"vctune simulate {problem.name}", shown=not quiet) as progress:
        design = (given.gains, given.coupling) if given else _known(file, folder, progress)
        if design is None:
            return ExitCode.FAILED
        simulation = run(file, *design, name, progress=progress)
        progress("writing and drawing")
        record = write_simulation(simulation, folder)

    def table() -> None:
        from vctune.api.experiments import simulation_of
        from vctune.cli.printing.side_by_side import print_simulation

        print_simulation(simulation_of(record), folder)

    answer(style, quiet, lambda: record, table)
    return ExitCode.OK if simulation.stable else ExitCode.FAILED


def _known(file: ProblemFile, folder: Path, progress: Progress) -> tuple[Gains, AnyCoupling] | None:
    """Return the design of this problem in the folder, else that which solving it finds. A folder without any design
    gets it; another design stays. Without a design, print the reason and return None."""
    from vctune.api.design_files import write_solved
    from vctune.api.experiments import design_in, solve_to_simulate
    from vctune.api.folders import DESIGN_FILE
    from vctune.cli.printing.output import warn

    if (design := design_in(folder, file)) is not None:
        return design
    solved = solve_to_simulate(file, progress)
    if not (folder / DESIGN_FILE).exists():
        write_solved(folder, file, solved)
    if solved.judgement is None:
        warn("no-design", f"{file.problem.name}: nothing to simulate: {solved.reason}")
        return None
    return solved.judgement.gains, solved.judgement.coupling
