"""Define `vctune solve`."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import click

from vctune.api.argument_ranges import GAPS, STDIN
from vctune.cli.options import PATH, command, out_option, time_limit_option
from vctune.cli.runner import Run, emit, on_every_save, worst
from vctune.running import time_limit_of_command


@command("Find the most transparent gains and prove them stable.")
@click.argument("problems", type=PATH, nargs=-1, required=True, metavar="PROBLEM...")
@out_option()
@click.option("--no-report", is_flag=True, help="Write no report, and remove an earlier one.")
@click.option("--strict", is_flag=True, help="Exit with code 1 if there is a warning.")
@click.option("--watch", is_flag=True, help="Solve again each time PROBLEM is saved, until Ctrl-C.")
@click.option(
    "--prove-gap",
    "gap",
    type=click.FloatRange(*GAPS),
    metavar="GAP",
    help="Prove that no error is lower by more than this share.",
)
@time_limit_option()
def solve(
    run: Run,
    problems: tuple[Path, ...],
    out: Path,
    no_report: bool,
    strict: bool,
    watch: bool,
    gap: float | None,
    time_limit: float,
) -> int:
    """Find the most transparent gains of PROBLEM and prove them stable.

    PROBLEM is a TOML file, or - for standard input. Most problems need only mass, damping and sample_time in [device].
    Several PROBLEMs are solved one after the other; the exit code is that of the worst result.
    """

    def once() -> int:
        return _solve(run, problems, out, report=not no_report, strict=strict, gap=gap)

    if watch and (len(problems) != 1 or problems[0] == STDIN):
        raise click.UsageError("--watch needs exactly one file, and standard input is read once")
    if watch:
        on_every_save(problems[0], once, time_limit)
    with time_limit_of_command(time_limit):
        return once()


def _solve(run: Run, problems: tuple[Path, ...], out: Path, *, report: bool, strict: bool, gap: float | None) -> int:
    """Solve problems one after the other, write and print their designs, and return the worst exit code."""
    from vctune import read_problem
    from vctune.api.result import design_folder, write
    from vctune.api.solving import advised, designed, proved, replaced_by

    files = [read_problem(problem) for problem in problems]
    folders = [design_folder(file, out) for file in files]
    if len(set(folders)) < len(folders):
        raise click.UsageError("two problems have the same name, and so the same folder; give one another `name`")
    run.doubt(*files)
    for file, folder in zip(files, folders, strict=True):
        if other := replaced_by(file, folder):
            both = f"{other} and {file.source} are both named {file.problem.name!r}"
            run.warn("warn-name", f"{folder} holds the design of {other}, which this one replaces: {both}")
    designs = []
    for problem, file, folder in zip(problems, files, folders, strict=True):
        with run.progress(problem.name) as progress:
            solved = proved(file, gap=gap, progress=progress)
            certified = solved.status.value == "certified"
            if not certified:
                solved = advised(file, solved, progress=progress)
            design = designed(file, solved, strict=strict)
            known = design.found.warnings
            write(design.files(folder))
        told = certified and run.style != "json"
        if told:  # before its prices and its page, which may take longer than the design
            run.say(design.found.to_json, design.rows)
        with run.progress(problem.name) as progress:
            if certified:
                solved = advised(file, solved, prices=report, progress=progress)
                design = design.with_advice(solved)
                write(design.files(folder))
            if report:
                run.report(design.found, folder, progress, f"; {solved.known}")
        designs.append(design)
        if run.style != "json":
            rest = partial(design.advice, known) if told else design.rows
            run.say(design.found.to_json, rest, folder, design.steps(folder), always=True)
    if run.style == "json":
        found = [design.found.to_json() for design in designs]
        emit(json.dumps(found if len(found) > 1 else found[0], indent=2, allow_nan=False))
    return worst([design.exit_code for design in designs])
