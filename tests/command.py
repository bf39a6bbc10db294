"""Commands as their users run them.

In this process, which costs no new interpreter, where what counts is what a command prints and writes; as a process of
its own where the process counts: signals, limits, locales, readers that leave.
"""

from __future__ import annotations

import io
import json
import math
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import chdir, contextmanager, redirect_stderr, redirect_stdout
from itertools import count
from pathlib import Path
from typing import NamedTuple
from unittest.mock import patch

from vctune import interrupt

PROGRESS = re.compile(r"^vctune [a-z]+( \S+)?: .*\n", re.MULTILINE)
PATIENCE = 300.0
"""What nothing here takes on the busiest machine, s; a wait that long has failed."""


class Done(NamedTuple):
    """What a command left."""

    returncode: int
    stdout: str
    stderr: str


def run(*arguments, cwd, report: bool = False) -> Done:
    """Run a command in this process; a warning is an error, a design has no report unless it is wanted."""
    from vctune.cli import runner
    from vctune.cli.main import execute

    out, err = (io.TextIOWrapper(io.BytesIO(), "utf-8", errors="backslashreplace") for _ in range(2))
    command = ["vctune", *_brief(arguments, report=report)]
    with (
        chdir(cwd), redirect_stdout(out), redirect_stderr(err),
        patch.object(sys, "argv", command), patch.object(runner, "BETWEEN", math.inf),
    ):  # fmt: skip
        code = execute()
    return Done(code, *(_read(stream) for stream in (out, err)))


def _brief(arguments, *, report: bool) -> list[str]:
    return [*map(str, arguments), *(["--no-report"] if arguments[:1] == ("solve",) and not report else [])]


def _read(stream) -> str:
    stream.seek(0)
    return stream.read()


def process(*arguments, cwd, report: bool = False, **env) -> subprocess.CompletedProcess:
    """Run a command as a process of its own, with more variables in its environment."""
    done = subprocess.run(
        [sys.executable, "-m", "vctune", *_brief(arguments, report=report)],
        cwd=cwd, capture_output=True, text=True, check=False, timeout=PATIENCE, env={**os.environ, **env},
    )  # fmt: skip
    done.stderr = without_progress(done.stderr)
    return done


def without_progress(text: str) -> str:
    """Return what a command printed without the lines of progress that a slow machine adds."""
    return PROGRESS.sub("", text)


def started(*arguments, cwd, **options) -> subprocess.Popen:
    """Start a command as a process of its own, which Ctrl-C interrupts even where the tests run in the background."""
    before = signal.signal(signal.SIGINT, signal.SIG_DFL)  # an ignored signal would be inherited
    try:
        return subprocess.Popen(
            [sys.executable, "-m", "vctune", *map(str, arguments)],
            cwd=cwd, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options,
        )  # fmt: skip
    finally:
        signal.signal(signal.SIGINT, before)


def strict(text: str):
    """Return what a text of JSON says, without Python's NaN and Infinity."""

    def refuse(name):
        raise AssertionError(f"{name} in JSON")

    return json.loads(text, parse_constant=refuse)


def wait_until(condition: Callable[[], bool]) -> None:
    """Return as soon as a condition holds."""
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.002)


def wait_for_work(running: subprocess.Popen, seconds: float) -> None:
    """Return when a process has ended or has had some more seconds of processor time, however busy the machine is."""
    upto = _worked(running.pid) + seconds
    wait_until(lambda: running.poll() is not None or _worked(running.pid) >= upto)


def _worked(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


WITH_PEAK = """
import re, sys
from pathlib import Path
from vctune.cli.main import execute
code = execute()
print(re.search(r"VmHWM:\\s+(\\d+)", Path("/proc/self/status").read_text())[1], file=sys.stderr)
sys.exit(code)
"""
"""A command that prints its own peak memory in kB. `ru_maxrss` of a child includes the peak of the parent."""


def peak_memory(*arguments, cwd) -> int:
    """Return the peak memory of a command that succeeds, kB."""
    command = [sys.executable, "-c", WITH_PEAK, *map(str, arguments)]
    done = subprocess.run(command, cwd=cwd, check=True, capture_output=True, text=True)
    return int(done.stderr.split()[-1])


def strike(monkeypatch, at: int, *numbers: int) -> Iterator[int]:
    """Let signals come when a search asks for the so-many-th time whether to stop; return the count of its askings."""
    noted, asked = interrupt.interrupt_noted, count(1)

    @contextmanager
    def noting():
        with noted() as stopped:

            def check():
                if next(asked) == at:
                    for number in numbers:
                        signal.raise_signal(number)
                return stopped()

            yield check

    monkeypatch.setattr(interrupt, "interrupt_noted", noting)
    return asked


LIMITED = """
import resource, signal
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (MOST, MOST))
from vctune.cli import run; run()
"""


def on_a_full_disk(size: int, *arguments, cwd) -> subprocess.CompletedProcess:
    """Run a command whose files the operating system lets grow to a size alone."""
    command = [sys.executable, "-c", LIMITED.replace("MOST", str(size)), *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False)


def check_files(paths) -> list:
    """Return the checks of the files that `vctune check` names."""
    from vctune.api.checking import planned

    return [checked for work in planned(paths)[1] for checked in work(lambda stage: None)]
