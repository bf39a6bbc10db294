"""Build the site: `python docs/make.py FOLDER`. A warning, such as a link without a target, is an error."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from itertools import groupby
from pathlib import Path
from posixpath import dirname, relpath

import vctune
from vctune.api.explaining import entries

ROOT = Path(__file__).parent.parent
TREES = ("vctune", "problems", "results", "tests", "docs", ".github")
CHAPTERS = {
    "Begin": "docs docs/tutorials/log-to-firmware docs/tutorials/my-arm-in-ten-minutes docs/tutorials/my-robot-shakes "
    "docs/tutorials/stable-and-it-shakes "
    "vctune/document vctune/document/off-the-menu vctune/cli docs/validated docs/what-else",
    "Look up": "explain/code explain/key explain/term explain/device explain/claim vctune problems results reference",
    "More tools": "vctune/firmware vctune/identification vctune/study vctune/simulation vctune/report vctune/api",
    "How it works": "vctune/model vctune/design vctune/design/bound vctune/proof vctune/analysis vctune/bench",
    "The project": "CHANGELOG github/CONTRIBUTING github/SECURITY tests",
}
EXPLAINED = {
    "code": "Messages by code",
    "key": "Keys of the files",
    "term": "Terms",
    "device": "Devices by name",
    "claim": "Claims",
    "task": "Tasks",
}
LINK = re.compile(r"\]\((?!#|\w+://)([^)\s]+)")


def staged(folder: Path) -> None:
    """Write the pages that Sphinx reads: the guides where they are, and pages made from the code."""
    for tree in TREES:  # servers hide names that begin with a dot
        shutil.copytree(ROOT / tree, folder / tree.removeprefix("."), ignore=shutil.ignore_patterns("__pycache__"))
    for page in (*ROOT.glob("*.md"), ROOT / "CITATION.cff", ROOT / "pyproject.toml"):
        shutil.copy(page, folder)
    (folder / "explain").mkdir()
    for kind, group in groupby(sorted(entries(), key=lambda entry: entry.kind), key=lambda entry: entry.kind):
        parts = [f"# {EXPLAINED[kind]}\n\nWhat `vctune explain` says."]
        for entry in group:
            guide, page = (relpath(f"/{place}", "/explain") for place in (dirname(entry.guide), entry.guide))
            text = re.sub(r"\]\(#", f"]({page}#", LINK.sub(rf"]({guide}/\1", entry.text))
            parts.append("## " + re.sub(r"[`$]", "", entry.names[0]) + f"\n\n{text}")
        (folder / f"explain/{kind}.md").write_text("\n\n".join(parts) + "\n", encoding="utf-8")
    names = [
        f".. auto{'class' if name[0].isupper() else 'function'}:: vctune.{name}"
        + ("\n   :members:" if name[0].isupper() else "")
        for name in vctune.__all__
        if name != "__version__"
    ]
    (folder / "reference.md").write_text(
        f"# Functions and classes\n\n```{{eval-rst}}\n{chr(10).join(names)}\n```\n", "utf-8"
    )
    index = ""
    for chapter, pages in CHAPTERS.items():
        paths = [f"{page}/README" if (folder / page).is_dir() else page for page in pages.split()]
        index += f"\n```{{toctree}}\n:hidden:\n:titlesonly:\n:caption: {chapter}\n{chr(10).join(paths)}\n```\n"
    for page in folder.rglob("*.md"):
        text = page.read_text("utf-8")
        text = re.sub(r"(\]\([^)]*)\.github/", r"\1github/", text)
        page.write_text(text + index * (page == folder / "README.md"), encoding="utf-8")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        staged(Path(folder))
        command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-d", f"{folder}/.doctrees"]
        subprocess.run([*command, "-c", ROOT / "docs", folder, sys.argv[1]], check=True)
    shutil.copy(f"{sys.argv[1]}/README.html", f"{sys.argv[1]}/index.html")
