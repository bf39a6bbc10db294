"""Find the version of IPOPT, without importing the rest of the optimiser."""

from __future__ import annotations

import re
from contextlib import redirect_stdout
from functools import lru_cache
from io import StringIO
from typing import Any

import casadi as ca

from vctune.interrupt import interrupt_deferred


@lru_cache(maxsize=1)
def ipopt_version() -> str:
    """Return the version that IPOPT prints in its banner; CasADi shows it nowhere else."""
    banner = StringIO()
    x = ca.SX.sym("x")
    quiet: dict[str, Any] = {"print_time": False, "ipopt.sb": "yes", "ipopt.print_level": 5, "ipopt.max_iter": 0}
    with interrupt_deferred(), redirect_stdout(banner):
        ca.nlpsol("banner", "ipopt", {"x": x, "f": x * x}, quiet)(x0=0)
    found = re.search(r"Ipopt version (\d[\d.]*\d)", banner.getvalue())
    return found[1] if found else "unknown"
