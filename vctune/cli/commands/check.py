"""Define `vctune check`."""

from __future__ import annotations

from pathlib import Path

import click

from vctune.cli.options import PATH, command, jobs_option, out_option, time_limited
from vctune.cli.runner import Run, emit, worst


@command("Prove gains that already exist.", "github")
@click.argument("paths", type=PATH, nargs=-1, required=True, metavar="PROBLEM... [GAINS]...")
@click.option("--region", "baseline", type=PATH, help="Prove the cells and gains of this region.json again.")
@click.option("--strict", is_flag=True, help="Fail the check if there is a warning.")
@click.option("--allow", multiple=True, metavar="CODE", help="A code whose warnings do not fail with --strict.")
@jobs_option("Number of files at a time.", 512)
@out_option("NAME/lost.json and its picture")
@time_limited
def check(
    run: Run,
    paths: tuple[Path, ...],
    baseline: Path | None,
    strict: bool,
    allow: tuple[str, ...],
    jobs: int,
    out: Path,
) -> int:
    """Prove gains that already exist. Each verdict is printed as soon as it is known; --format json is one list at the
    end. The exit code is the code of the worst result.

    Without GAINS, PROBLEM must fix all gains and the whole coupling. A folder stands for all .toml files in it. GAINS
    are gains files, region.json files, or YAML files: parameters of a ROS 2 admittance_controller, each of whose
    selected axes is checked with the device of PROBLEM (name it x, y, z, rx, ry or rz for only this axis). Several
    problems are each followed by their own: PROBLEM GAINS... PROBLEM GAINS...

    A region.json passes if its cells and gain sets can still be proved.
    """
    import json
    from dataclasses import replace
    from typing import get_args

    from vctune.api.checking import CODES, check_object, planned, record_lost, started
    from vctune.api.result import folder_name
    from vctune.cli.formats import github, summary, text
    from vctune.document.text.errors import Code

    if unknown := [code for code in allow if code not in get_args(Code)]:
        raise click.BadParameter(f"{', '.join(unknown)}: no code of a warning", param_hint="--allow")
    problems, plan = planned(paths, baseline)
    run.doubt(*problems)
    checks, objects, told = [], [], set[tuple[Path, str]]()
    line = github if run.style == "github" else text
    try:
        with started(plan, jobs) as works:
            for work in works:
                with run.progress() as progress:
                    found = [replace(checked, strict=strict, allowed=allow) for checked in work(progress)]
                checks += found
                for checked in found:
                    # what a file states is told once, not for each of its axes
                    new = [each for each in checked.warnings if (checked.source, each) not in told]
                    told |= {(checked.source, each) for each in new}
                    if run.style == "json":
                        objects.append(check_object(checked))
                    elif run.style == "github" or not run.quiet:
                        emit(line(checked, new))
                    elif checked.finding is None:
                        click.echo(line(checked, new), err=True)
                    if said := record_lost(checked, out / folder_name(checked.name)):
                        click.echo(said, err=True)
    finally:  # a command that is ended prints what it knows
        if run.style == "json":
            emit(json.dumps(objects, indent=2, allow_nan=False))
        elif run.style == "text" and not run.quiet and len(checks) > 1:
            emit(summary(checks))
    return worst([CODES[checked.result] for checked in checks])
