"""Provide `vctune example` as functions: the problems that come with the package."""

from __future__ import annotations

import re
from importlib.resources import files
from pathlib import Path

from vctune.document.records.printed_json import ExampleRecord as ExampleRecord
from vctune.document.text.errors import InputError
from vctune.document.text.output_files import make_folder, write_together

SCHEMA_LINE = re.compile(r"\A#:schema .*\n")
SCHEMA_FILE = "document/problem.schema.json"


def example_names() -> tuple[str, ...]:
    """Return the names of the example problems."""
    return tuple(sorted(path.stem for path in _folder().glob("*.toml")))


def example_text(name: str) -> str:
    """Return the text of a problem file. The text names the JSON Schema of this installation, for editors."""
    if name not in example_names():
        raise InputError.of(name, "unknown-name", f"is no example; there are: {', '.join(example_names())}")
    schema = Path(str(files("vctune"))) / SCHEMA_FILE
    text = (_folder() / f"{name}.toml").read_text(encoding="utf-8")
    return SCHEMA_LINE.sub(lambda _: f"#:schema {schema.as_uri()}\n", text)


def write_example(name: str, folder: Path) -> Path:
    """Write the problem file of an example. The function never replaces an existing file."""
    text, path = example_text(name), folder / f"{name}.toml"
    if path.exists():
        raise InputError.of(str(path), "file-exists", "is there already; name another folder by --out, or remove it")
    make_folder(folder)
    write_together({path: text})
    return path


def _folder() -> Path:
    """Return the folder of the example problems: inside an installed package, or next to the package in a checkout."""
    package = Path(str(files("vctune")))
    inside = package / "problems"
    return inside if inside.is_dir() else package.parent / "problems"
