"""Solve a problem by the usual alternative to vctune's search: SciPy's SLSQP on a fixed grid."""

from __future__ import annotations

import warnings
from importlib.util import find_spec

import numpy as np

from vctune.bench.dense import DenseProblem, Stopped
from vctune.document.text.errors import InputError


def need(package: str) -> None:
    """Check that a package of the extra `bench` is installed."""
    if find_spec(package) is None:
        lacking = f"needs {package}, which it compares with: pip install {package}"
        raise InputError.of("vctune bench", "missing-package", lacking)


def slsqp(dense: DenseProblem) -> Stopped:
    """Solve a problem on its grid by SciPy's SLSQP with exact derivatives."""
    return _slsqp(dense, exact=True)


def slsqp_differences(dense: DenseProblem) -> Stopped:
    """Solve a problem on its grid by SciPy's SLSQP with its own finite differences, as most users do."""
    return _slsqp(dense, exact=False)


def _slsqp(dense: DenseProblem, *, exact: bool) -> Stopped:
    from scipy.optimize import Bounds, minimize

    slopes = {"jac": lambda z: dense.slopes(z)[1]} if exact else {}
    with warnings.catch_warnings(action="ignore"):  # SLSQP warns about its own progress
        found = minimize(
            lambda z: float(dense.values(z)[0][0]),
            dense.numbers.guess,
            method="SLSQP",
            jac=(lambda z: dense.slopes(z)[0]) if exact else None,
            bounds=Bounds(dense.numbers.low, dense.numbers.high),
            constraints={"type": "ineq", "fun": lambda z: dense.values(z)[1], **slopes},
            options={"maxiter": 200, "ftol": 1e-10},
        )
    return Stopped(np.asarray(found.x), bool(found.success))
