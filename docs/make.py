"""Build the site: `python docs/make.py FOLDER`. A warning, a link without a target or a need for the network is an
error."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from layout import laid_out, whole_files
from links import faults

HERE = Path(__file__).parent


def build(target: Path) -> list[str]:
    """Build the site in a folder and return a line of text for each faulty link.

    Parameters
    ----------
    target : the folder of the site
    """
    with tempfile.TemporaryDirectory() as folder:
        laid_out(Path(folder))
        command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-d", f"{folder}/.doctrees"]
        subprocess.run([*command, "-c", HERE, folder, target], check=True)
    whole_files(target)
    return faults(target)


if __name__ == "__main__":
    sys.exit("\n".join(build(Path(sys.argv[1]))) or 0)
