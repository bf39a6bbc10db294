"""Define the `vctune` command. The command turns each error into a clear line on stderr and a documented exit code."""

from __future__ import annotations

from contextlib import suppress
from importlib import import_module

import click

from vctune.document.text.errors import InputError, coded
from vctune.exit_codes import ExitCode
from vctune.interrupt import RECEIVED

EPILOG = (
    "Exit codes: 0 certified or passed, 1 infeasible, violated or failed, 2 bad usage or input, "
    "3 undecided, 4 internal error, 130 interrupted (SIGINT or SIGTERM)."
)
COMMANDS = (
    "bench", "bound", "check", "compare", "example", "explain", "export", "identify", "region", "report",
    "schema", "simulate", "solve", "sweep",
)  # fmt: skip


class _Commands(click.Group):
    """The group of all commands. The group imports a command only when the user runs or lists it."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        # for an unknown command, click needs all names to suggest a similar one
        for name in (cmd_name,) if cmd_name in COMMANDS else COMMANDS:
            self.commands[name] = getattr(import_module(f"vctune.cli.commands.{name}"), name)
        return self.commands.get(cmd_name)


def _print_version(context: click.Context, parameter: click.Parameter, wanted: bool) -> None:
    if not wanted:
        return
    from vctune.cli.runner import emit
    from vctune.design.nlp.nlp import ipopt_version
    from vctune.version import versions

    emit("\n".join(f"{name} {number}" for name, number in versions(ipopt_version()).items()))
    context.exit()


@click.group(cls=_Commands, epilog=EPILOG, context_settings={"help_option_names": ["-h", "--help"]})
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_print_version,
    help="Show the versions of vctune, casadi, IPOPT and numpy.",
)
def main() -> None:
    """Design gains for haptic devices: as transparent as possible, and proved stable."""


def execute() -> int:
    """Run the command line and return one of the codes in `ExitCode`."""
    try:
        code = main(standalone_mode=False)
    except InputError as error:  # a refusal that is a verdict on valid input states its own code
        code = _complain(str(error), getattr(error, "exit_code", ExitCode.BAD_INPUT))
    except click.exceptions.NoArgsIsHelpError as error:  # bare `vctune` or a command without arguments
        click.echo(error.format_message(), err=True)
        code = ExitCode.BAD_INPUT
    except click.ClickException as error:
        click.UsageError(coded(error.format_message(), "usage"), getattr(error, "ctx", None)).show()
        code = ExitCode.BAD_INPUT
    except click.Abort:
        raise KeyboardInterrupt from None
    except SystemExit:  # click exits in this way if the reader of --help or --version has closed the pipe
        code = ExitCode.OK
    except OSError as error:
        code = _complain(coded(f"{error.filename or 'output'}: {error.strerror}", "cannot-write"), ExitCode.BAD_INPUT)
    except Exception as error:  # an error in vctune itself: report it without a traceback
        if RECEIVED:
            raise KeyboardInterrupt from None
        trace = error.__traceback__
        while trace is not None and trace.tb_next is not None:
            trace = trace.tb_next
        place = f"{trace.tb_frame.f_globals.get('__name__')}:{trace.tb_lineno}" if trace else "?"
        message = f"internal error at {place}: {type(error).__name__}: {error}; please report it"
        code = _complain(coded(message, "internal-error"), ExitCode.INTERNAL)
    return int(code or ExitCode.OK)


def _complain(message: str, code: ExitCode) -> ExitCode:
    with suppress(OSError):
        click.echo(message, err=True)
    return code
