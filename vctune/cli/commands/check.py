"""Define `vctune check`."""

from __future__ import annotations

from pathlib import Path

import click

from vctune.cli.printing.options import out_option, output_options, time_limited


@click.command(short_help="Prove gains that already exist.")
@click.argument("paths", type=click.Path(path_type=Path), nargs=-1, required=True, metavar="PROBLEM... [GAINS]...")
@click.option(
    "--region", "baseline", type=click.Path(path_type=Path), help="Prove the cells and gains of this region.json again."
)
@click.option("--strict", is_flag=True, help="Fail the check if there is a warning.")
@click.option("--jobs", type=click.IntRange(1, 512), default=1, show_default=True, help="Number of files at a time.")
@out_option("NAME/lost.json and its picture, if a part of a region is no longer proved")
@output_options("github")
@time_limited
def check(
    paths: tuple[Path, ...],
    style: str,
    quiet: bool,
    baseline: Path | None,
    strict: bool,
    jobs: int,
    out: Path,
) -> int:
    """Prove gains that already exist. Each verdict is printed as soon as it is known, in the order of the files and
    with regions last; --format json is one list at the end. The exit code is the code of the worst result.

    Without GAINS, PROBLEM must fix all gains and the whole coupling. With several GAINS files, the command checks
    PROBLEM with each of them. A folder stands for all .toml files in it. Several problems may each be followed by their
    own GAINS: PROBLEM GAINS... PROBLEM GAINS...

    A YAML file in place of GAINS is a parameter file of a ROS 2 admittance_controller. The command checks each axis
    that the YAML file selects with the device of PROBLEM: a servo, or a device whose [gains] are fixed. Rotations
    need a rotary device, and translations a linear one. If an axis does not fit, the command skips it and exits with
    code 3. Several PROBLEMs before the YAML file share the axes. A PROBLEM whose name is x, y, z, rx, ry or rz is only
    for this axis.

    With --region, the check passes only if vctune can still prove the feasible cells and the gain sets of a region.json
    for PROBLEM. `vctune region` writes this file. In a command with several problems, name the region.json after its
    PROBLEM, as GAINS.
    """
    import json
    from dataclasses import replace

    from vctune.api.checking import check_object, record_lost
    from vctune.api.folders import folder_name
    from vctune.api.gate import planned, started
    from vctune.cli.printing.exits import of_check, worst
    from vctune.cli.printing.formats import one_of, summary
    from vctune.cli.printing.output import emit, warn_of_doubts
    from vctune.cli.printing.progress import progress_on_stderr

    problems, tasks = planned(paths, baseline)
    warn_of_doubts(*problems, quiet=quiet)
    checks, objects = [], []
    try:
        with started(tasks, jobs) as works:
            for work in works:
                with progress_on_stderr("vctune check", shown=not quiet) as progress:
                    found = [replace(checked, strict=strict) for checked in work(progress)]
                checks += found
                for checked in found:
                    if style == "json":
                        objects.append(check_object(checked))
                    elif style == "github" or not quiet:
                        emit(one_of(checked, style))
                    elif checked.finding is None:
                        click.echo(one_of(checked, style), err=True)
                    if said := record_lost(checked, out / folder_name(checked.name)):
                        click.echo(said, err=True)
    finally:  # a command that is ended prints what it knows
        if style == "json":
            emit(json.dumps(objects, indent=2, allow_nan=False))
        elif style == "text" and not quiet and len(checks) > 1:
            emit(summary(checks))
    return worst(of_check(checked.result) for checked in checks)
