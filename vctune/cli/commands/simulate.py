"""Define `vctune simulate`."""

from __future__ import annotations

from pathlib import Path

import click

from vctune.cli.options import PATH, command, out_option, problem_argument
from vctune.cli.runner import Run


@command("Simulate a design in the problem's experiments.")
@problem_argument
@click.argument("gains", type=PATH, required=False)
@click.option("--experiment", "name", help="Name of the experiment to simulate.  [default: all]")
@out_option()
def simulate(run: Run, problem: Path, gains: Path | None, name: str | None, out: Path) -> int:
    """Simulate a design in the [[experiment]] tables of PROBLEM.

    The design is in GAINS. Without GAINS, it is the one that `vctune solve PROBLEM` has written; if there is none,
    vctune solves PROBLEM first, and never replaces another design. The command writes simulation.json, traces.npz and
    the figure `simulation`, also into the report of this design. The exit code is 1 if there is no design, or if it
    diverges or is unstable in an experiment.
    """
    from vctune import read_problem
    from vctune.api.result import design_folder, write
    from vctune.api.simulating import chosen_experiments, design_for, designed_in
    from vctune.api.simulating import simulate as find

    file = read_problem(problem)
    chosen_experiments(file, name)
    run.doubt(file)
    file, given = design_for(file, gains) if gains else (file, None)
    if given and given.sha256 not in (None, file.sha256):
        run.warn("other-version", f"{gains}: made for another version of the problem (sha256 differs)")
    folder = design_folder(file, out)
    with run.progress(problem.name) as progress:
        design = (given.gains, given.coupling) if given else designed_in(file, folder, progress)
        simulation = find(file, *design, name, progress=progress)
        progress("writing and drawing")
        write(simulation.files(folder))
    return run.show(simulation, simulation.record, folder)
