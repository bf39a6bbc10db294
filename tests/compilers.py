"""The compilers that exported C has to pass, and how they are called."""

from __future__ import annotations

import shutil
import subprocess

import pytest

COMPILERS = {
    "gcc": ["gcc"],
    "clang": ["clang"],
    "arm": ["arm-none-eabi-gcc", "-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard"],
}
WARNINGS = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror"]


def has(*tools):
    missing = [tool for tool in tools if shutil.which(tool) is None]
    return pytest.mark.skipif(bool(missing), reason=f"needs {', '.join(missing)}")


def done(*command, cwd):
    return subprocess.run(list(map(str, command)), cwd=cwd, capture_output=True, text=True, check=False, timeout=120)


def period(folder):
    text = (folder / "vctune_controller.h").read_text()
    return text.split("#define VCTUNE_SAMPLE_TIME_NS ")[1].split()[0]


by_each_compiler = pytest.mark.parametrize(
    "name", [pytest.param(name, marks=has(command[0])) for name, command in COMPILERS.items()]
)


def warned(name, folder, place):
    """Return what a compiler prints about the files of a folder; what it makes goes to another place."""
    options = [*WARNINGS, "-O2", f"-DVCTUNE_TIMER_PERIOD_NS={period(folder)}"]
    # newlib's own fenv.h and stdio.h are not needed by the controller: it has no I/O
    sources = ["vctune_controller.c"] if name == "arm" else ["vctune_controller.c", "replay.c"]
    found = [done(*COMPILERS[name], *options, "-c", each, "-o", place / "out.o", cwd=folder) for each in sources]
    return "".join(each.stderr or f"{each.args} ends with {each.returncode}" * (each.returncode != 0) for each in found)
