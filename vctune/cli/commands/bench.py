"""Define `vctune bench`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import click

from vctune.cli.printing.options import out_option, output_options

ABOUT = {  # purpose of each benchmark, by the name of its module in vctune.bench
    "solvers": "Compare error and run time of vctune with those of other solvers on fixed grids.",
    "stress": "Solve thousands of devices over ten decades and check every verdict.",
}
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@click.group(short_help="Measure the cost and the quality of the answers.")
def bench() -> None:
    """Measure vctune against other solvers and on extreme devices.

    The command writes the results to OUT/ as a CSV file, a picture and a page. `bench stress` needs mpmath: pip
    install mpmath.
    """


def _command(name: str) -> Any:
    @click.command(name, short_help=ABOUT[name], help=ABOUT[name])
    @click.option(
        "--quick/--full", default=True, help="Quick run of less than a minute, or the full run.  [default: quick]"
    )
    @click.option("--seed", type=click.IntRange(0, 2**32 - 1), default=0, show_default=True, help="Random seed.")
    @out_option("", "results/bench")
    @output_options()
    def command(quick: bool, seed: int, out: Path, style: str, quiet: bool) -> int:
        return _run(name, quick, seed, out, style, quiet)

    return command


for _name in ABOUT:
    bench.add_command(_command(_name))


def _run(name: str, quick: bool, seed: int, out: Path, style: str, quiet: bool) -> int:
    for variable in THREADS:  # must come before the import of NumPy, so that processor time counts no idle threads
        os.environ[variable] = "1"
    from vctune.api.benchmarking import benchmark
    from vctune.cli.printing.output import answer
    from vctune.cli.printing.progress import progress_on_stderr
    from vctune.exit_codes import ExitCode

    command = f"vctune bench {name} --{'quick' if quick else 'full'} --seed {seed}"
    with progress_on_stderr(command, shown=not quiet) as progress:
        found = benchmark(name, out, quick=quick, seed=seed, command=command, progress=progress)
    lines = [found.title, found.machine, *found.facts, f"written to {out}"]
    answer(style, quiet, found.to_json, lambda: click.echo("\n".join(lines)))
    return ExitCode.OK
