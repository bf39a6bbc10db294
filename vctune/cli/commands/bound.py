"""Define `vctune bound`."""

from __future__ import annotations

from pathlib import Path

import click

from vctune.api.argument_ranges import GAPS
from vctune.cli.options import PATH, command, out_option, problem_argument, time_limited
from vctune.cli.runner import Run


@command("Prove a bound on how much better any other design could be.")
@problem_argument
@click.argument("design", type=PATH, required=False)
@click.option(
    "--gap",
    type=click.FloatRange(*GAPS),
    default=0.03,
    show_default="0.03",
    help="Gap to prove between error and bound, as a share.",
)
@out_option()
@time_limited
def bound(run: Run, problem: Path, design: Path | None, gap: float, out: Path) -> int:
    """Prove a lower bound on the error of every feasible design of PROBLEM.

    DESIGN is a design.json of the problem. Without DESIGN, vctune solves the problem first. The command adds the bound
    to design.json and to the report. After Ctrl-C or the time limit, the command writes the bound reached so far and
    exits with code 3. A second Ctrl-C ends it at once.
    """
    from vctune import Status, interrupt, read_problem
    from vctune.api.bounding import bound as search
    from vctune.api.bounding import require_free
    from vctune.api.result import DESIGN_FILE, design_folder, write
    from vctune.api.solving import solve

    file = require_free(read_problem(problem))
    path = design or design_folder(file, out) / DESIGN_FILE
    run.doubt(file)
    with run.progress(problem.name) as progress:
        start = design or solve(file, progress=progress)
        with interrupt.interrupt_noted() as stopped:  # from here on, an interrupt would lose work
            bounded = search(file, start, gap=gap, stopped=stopped, progress=progress)
            write(bounded.files(path))
            if bounded.optimality is None and bounded.status is not Status.INFEASIBLE:
                run.warn("time-limit", "the search had no time: vctune proved nothing about other designs")
        run.report(path, path.parent, progress)
    if bounded.optimality is not None and bounded.optimality.improved is not None:
        click.echo("found a better design, in a basin that the scan had missed", err=True)
    steps = bounded.design.steps(path.parent)
    return run.show(bounded.design, bounded.record.to_json, path.parent, steps, always=True)
