"""Write the pages of the site into one folder for Sphinx: the Markdown files of the repository, and the files they link
to."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from posixpath import normpath, relpath

from generated import explanations, folder_page, reference, source_page
from notebooks import as_notebook

ROOT = Path(__file__).parent.parent
FRONT = PurePosixPath("README.md")
TREES = ("vctune", "problems", "results", "tests", "docs", ".github")
LINK = re.compile(
    r"(?P<code>^```.*?^```|`[^`\n]*`)|(?P<picture>!\[[^\]]*\]\(|src=\")(?P<file>[^)\s\"]+)|\]\((?P<to>[^)\s]+)",
    re.MULTILINE | re.DOTALL,
)
MERMAID = re.compile(r"^```mermaid\n(.*?)^```\n", re.MULTILINE | re.DOTALL)
NODE = r"(\w+)(?:\[([^\]]*)\])?"
EDGE = re.compile(rf"{NODE} <?-->(?:\|\"?([^|\"]*)\"?\|)? {NODE}")
CHAPTERS = {
    "Begin": ("docs/tutorials/*.md", "vctune/document/README.md", "vctune/cli/README.md", "vctune/firmware/README.md"),
    "Look up": ("explain/*.md", "vctune/README.md", "problems/README.md", "results/README.md"),
    "More tools": (
        "vctune/identification/README.md", "vctune/study/README.md", "vctune/simulation/README.md",
        "vctune/report/README.md", "vctune/api/README.md", "reference/*.md",
    ),
    "How it works": (
        "vctune/model/README.md", "vctune/design/README.md", "vctune/design/bound/README.md", "vctune/proof/README.md",
        "vctune/analysis/README.md", "vctune/bench/README.md", "results/bench/*.md",
    ),
    "The project": (
        "CHANGELOG.md", ".github/CONTRIBUTING.md", ".github/SECURITY.md", "tests/README.md", "docs/README.md",
    ),
}  # fmt: skip
"""The table of contents beside each page, by chapter. Only links lead to the other pages."""


@dataclass
class Layout:
    """The pages of the site by their paths in the repository, and the pictures that they show."""

    pages: dict[PurePosixPath, str]
    pictures: set[PurePosixPath] = field(default_factory=set)

    def linked(self, page: PurePosixPath) -> str:
        """Return the text of a page with links to pages of the site, and add the pages and pictures to which it
        links."""

        def moved(found: re.Match[str]) -> str:
            link = found["file"] or found["to"]
            if found["code"] or "://" in link or link.startswith("#"):
                return found[0]
            path, mark, anchor = link.partition("#")
            to = PurePosixPath(normpath(page.parent / path))
            if found["picture"]:
                self.pictures.add(to)
                return found[0]
            return f"]({relpath(staged(self.target(to)), staged(page).parent)}{mark}{anchor}"

        return LINK.sub(moved, MERMAID.sub(lambda found: _arrows(found[1]), self.pages[page]))

    def target(self, to: PurePosixPath) -> PurePosixPath:
        """Return the path of the page for a file or folder of the repository, and add this page if it is new."""
        if (ROOT / to).is_dir():
            page = to / "README.md"
            if page not in self.pages:
                self.pages[page] = folder_page(ROOT / to)
            return page
        page = to if to.suffix == ".md" else to.with_name(f"{to.name}.md")
        if page not in self.pages:
            self.pages[page] = source_page(ROOT / to)
        return page


def laid_out(target: Path) -> None:
    """Write all pages of the site into an empty folder, with the pictures that they show.

    Parameters
    ----------
    target : the folder that Sphinx reads
    """
    layout = Layout({_path(guide): guide.read_text("utf-8") for guide in _guides()})
    layout.pages |= {PurePosixPath(name): text for name, text in {**explanations(), **reference()}.items()}
    done: dict[PurePosixPath, str] = {}
    while todo := layout.pages.keys() - done.keys():
        done |= {page: layout.linked(page) for page in sorted(todo)}
    done[FRONT] += contents(done)
    for page in done.keys() & set(map(_path, _tutorials())):
        done[page] += f'\n<a href="{page.stem}.ipynb" download>This tutorial as a notebook</a> runs in Jupyter.\n'
    for page, text in done.items():
        _write(target / staged(page), text)
    for picture in layout.pictures:
        (target / picture).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / picture, target / picture)


def whole_files(target: Path) -> None:
    """Write the files of the site besides its pages: the reports, unchanged, and each tutorial as a notebook.

    Parameters
    ----------
    target : the folder of the built site
    """
    for report in (ROOT / "results").glob("*/report.html"):
        shutil.copy(report, target / report.relative_to(ROOT))
    for tutorial in _tutorials():
        path = target / tutorial.relative_to(ROOT).with_suffix(".ipynb")
        _write(path, as_notebook(tutorial.read_text("utf-8")))


def staged(page: PurePosixPath) -> PurePosixPath:
    """Return the path of a page on the site. Servers hide names that begin with a dot, so no part of the path does."""
    moved = PurePosixPath(*(part.removeprefix(".") for part in page.parts))
    return PurePosixPath("index.md") if page == FRONT else moved


def contents(pages: dict[PurePosixPath, str]) -> str:
    """Return the table of contents that the site shows beside each page."""
    parts = []
    for chapter, patterns in CHAPTERS.items():
        listed = [page for pattern in patterns for page in sorted(pages) if page.match(pattern)]
        entries = "\n".join(staged(page).with_suffix("").as_posix() for page in listed)
        parts.append(f"\n```{{toctree}}\n:hidden:\n:caption: {chapter}\n:titlesonly:\n{entries}\n```\n")
    return "".join(parts)


def _path(file: Path) -> PurePosixPath:
    return PurePosixPath(file.relative_to(ROOT).as_posix())


def _tutorials() -> list[Path]:
    return sorted((ROOT / "docs/tutorials").glob("*.md"))


def _guides() -> Iterator[Path]:
    yield from sorted(ROOT.glob("*.md"))
    for tree in TREES:
        yield from sorted(path for path in (ROOT / tree).rglob("*.md") if "tests/schemas" not in path.as_posix())


def _arrows(diagram: str) -> str:
    """Return the arrows of a Mermaid diagram as a table, because a browser needs a script from the network to draw
    it."""
    names: dict[str, str] = {}
    edges = EDGE.findall(diagram)
    for edge in edges:
        names |= {key: label.replace("<br>", ": ") for key, label in (edge[:2], edge[3:]) if label}
    rows = [f"| {names.get(a, a)} | {label} | {names.get(b, b)} |" for a, _, label, b, _ in edges]
    return "\n".join(["| from | by | to |", "|---|---|---|", *rows]) + "\n"


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
