"""Define `vctune front`."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import click

from vctune.cli.printing.options import out_option, output_options, problem_argument, time_limit_option, worker_options


@click.command(short_help="Draw the trade-offs between the error's terms, and between error and band.")
@problem_argument
@out_option("NAME/front/")
@worker_options
@time_limit_option(" each point")
@output_options()
def front(problem: Path, out: Path, jobs: int | None, executor: str, time_limit: float, style: str, quiet: bool) -> int:
    """Find two Pareto fronts of PROBLEM. The first front trades the three terms of the error against each other.

    The second front trades the error against the upper edge of the stability band.

    The command runs one sweep for each front. The first sweep varies the position gain K_p over its range, and the
    weight of the coupling's term over six decades. The second sweep varies the upper edge of the stability band up to
    the Nyquist frequency. With the criterion "hands", the command omits the second sweep, because this criterion has no
    band. The command writes terms.csv and band.csv, with their pictures, to OUT/NAME/front/. To continue an interrupted
    command, run it again.
    """
    from vctune import read_problem
    from vctune.api.bounding import require_free
    from vctune.api.folders import design_folder
    from vctune.api.messages import printable
    from vctune.api.studies import front as find
    from vctune.cli.printing.output import answer, warn_of_doubts
    from vctune.cli.printing.progress import bar_on_stderr
    from vctune.exit_codes import ExitCode
    from vctune.interrupt import resumable

    file = require_free(read_problem(problem), "trade")
    folder = design_folder(file, out) / "front"
    warn_of_doubts(file, quiet=quiet)

    def bar(name: str, points: int) -> AbstractContextManager[Callable[[str], None]]:
        return bar_on_stderr(f"vctune front: {name}", points, shown=not quiet)

    with resumable():
        fronts = find(file, folder=folder, jobs=jobs, executor=executor, time_limit=time_limit, bar=bar)
    counts = [len(table.status) for table in (fronts.terms, fronts.band) if table is not None]
    against = "no front of error against band, because the problem's criterion has no band"
    if fronts.band is not None:
        against = f"{counts[1]} on the front of error against band"
    designs = "1 design" if counts[0] == 1 else f"{counts[0]} designs"
    lines = [f"{printable(file.problem.name)}: {designs} on the front of the three terms,", against]

    def table() -> None:
        from vctune.cli.printing.design_table import print_lines

        print_lines(lines, folder, [f"open {folder / 'terms.svg'}"])

    answer(style, quiet, fronts.record(file.problem.name).to_json, table)
    return ExitCode.OK if all(counts) else ExitCode.FAILED
