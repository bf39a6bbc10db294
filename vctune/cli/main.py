"""The `vctune` command: it turns each error into a clear line on stderr and a documented exit code."""

from __future__ import annotations

from contextlib import suppress

import click

from vctune.api.messages import InputError, coded
from vctune.cli.commands.bench import bench
from vctune.cli.commands.bound import bound
from vctune.cli.commands.check import check
from vctune.cli.commands.compare import compare
from vctune.cli.commands.example import example
from vctune.cli.commands.explain import explain
from vctune.cli.commands.export import export
from vctune.cli.commands.front import front
from vctune.cli.commands.identify import identify
from vctune.cli.commands.region import region
from vctune.cli.commands.report import report
from vctune.cli.commands.schema import schema
from vctune.cli.commands.simulate import simulate
from vctune.cli.commands.solve import solve
from vctune.cli.commands.sweep import sweep
from vctune.exit_codes import ExitCode
from vctune.interrupt import RECEIVED

EPILOG = (
    "Exit codes: 0 certified or passed, 1 infeasible, violated or failed, 2 bad usage or input, "
    "3 undecided, 4 internal error, 130 interrupted (SIGINT or SIGTERM)."
)


def _print_version(context: click.Context, parameter: click.Parameter, wanted: bool) -> None:
    if not wanted:
        return
    from vctune.api.messages import versions
    from vctune.cli.printing.output import emit

    emit("\n".join(f"{name} {number}" for name, number in versions().items()))
    context.exit()


@click.group(epilog=EPILOG, context_settings={"help_option_names": ["-h", "--help"]})
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_print_version,
    help="Show the versions of vctune, casadi, IPOPT, numpy and python-flint.",
)
def main() -> None:
    """Design gains for haptic devices: as transparent as possible, and proved stable."""


main.add_command(solve)
main.add_command(check)
main.add_command(compare)
main.add_command(sweep)
main.add_command(front)
main.add_command(simulate)
main.add_command(export)
main.add_command(identify)
main.add_command(report)
main.add_command(region)
main.add_command(bound)
main.add_command(bench)
main.add_command(schema)
main.add_command(explain)
main.add_command(example)


def execute() -> int:
    """Run the command line and return one of `ExitCode`; only KeyboardInterrupt passes."""
    try:
        code = main(standalone_mode=False)
    except InputError as error:
        code = _complain(str(error), ExitCode.BAD_INPUT)
    except click.ClickException as error:
        click.UsageError(coded(error.format_message(), "usage"), getattr(error, "ctx", None)).show()
        code = ExitCode.BAD_INPUT
    except click.Abort:
        raise KeyboardInterrupt from None
    except SystemExit:  # click's way out when the reader of --help or --version has gone away
        code = ExitCode.OK
    except OSError as error:
        code = _complain(coded(f"{error.filename or 'output'}: {error.strerror}", "cannot-write"), ExitCode.BAD_INPUT)
    except Exception as error:  # the last line of defence: a fault of ours, said without a traceback
        if RECEIVED:
            raise KeyboardInterrupt from None
        place = _innermost(error)
        said = f"internal error at {place}: {type(error).__name__}: {error}; please report it"
        code = _complain(coded(said, "internal-error"), ExitCode.INTERNAL)
    return int(code or ExitCode.OK)


def _complain(message: str, code: ExitCode) -> ExitCode:
    with suppress(OSError):
        click.echo(message, err=True)
    return code


def _innermost(error: Exception) -> str:
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    return f"{trace.tb_frame.f_globals.get('__name__')}:{trace.tb_lineno}" if trace else "?"
