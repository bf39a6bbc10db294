"""Define `vctune bench`."""

from __future__ import annotations

import os
from pathlib import Path

import click

from vctune.cli.options import PATH, command
from vctune.cli.runner import Run

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@command("Measure the cost and the quality of the answers.")
@click.argument("name", type=click.Choice(["solvers", "stress"]))
@click.option("--quick/--full", default=True, help="A run of about two minutes, or the full one.  [default: quick]")
@click.option("--seed", type=click.IntRange(0, 2**32 - 1), default=0, show_default=True, help="Random seed.")
@click.option("--out", type=PATH, default="results/bench", show_default=True, help="Output folder.")
def bench(run: Run, name: str, quick: bool, seed: int, out: Path) -> int:
    """Measure vctune against other solvers on fixed grids (solvers), or solve thousands of devices over ten decades and
    check every verdict (stress).

    The command writes the results to OUT/ as a CSV file, a picture and a page.
    """
    for variable in THREADS:  # must come before the import of NumPy, so that processor time counts no idle threads
        os.environ[variable] = "1"
    from importlib import import_module

    from vctune.bench.benchmark import machine, record_of, write_measured
    from vctune.document.text.output_files import make_folder

    made_by = f"vctune bench {name} --{'quick' if quick else 'full'} --seed {seed}"
    make_folder(out)
    where = machine()
    with run.progress(name) as progress:
        measured = import_module(f"vctune.bench.{name}").measure(quick, seed, progress)
    write_measured(out, name, measured, made_by, where)
    lines = [measured.title, where, *measured.facts]
    run.say(lambda: record_of(name, measured, where), lambda: ((line,) for line in lines), out)
    return 0
