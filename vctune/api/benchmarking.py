"""Provide `vctune bench` as a function."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from vctune.bench.benchmark import record_of, write_measured
from vctune.bench.timing import machine
from vctune.document.records.printed_json import BenchRecord
from vctune.document.text.output_files import make_folder


def benchmark(
    name: str, folder: Path, *, quick: bool, seed: int, command: str, progress: Callable[[str], None]
) -> BenchRecord:
    """Run a benchmark, write its table, picture and page, and return its record."""
    make_folder(folder)
    where = machine()
    measured = import_module(f"vctune.bench.{name}").measure(quick, seed, progress)
    write_measured(folder, name, measured, command, where)
    return record_of(name, measured, where)
