"""What a user would pick instead: SciPy's and NLopt's solvers on a fixed grid, each with its best reasonable settings.

Settings of trust-constr and COBYQA were chosen by trying a few grids, radii and barriers on friction-wheel, two-basins
and at-bound.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Any

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.bench.dense import MISSED, Dense, Stopped
from vctune.bench.evaluator import spectral_radius
from vctune.document.errors import InputError, Mistake

PACKAGES = {"scipy": "SciPy", "nlopt": "NLopt", "mpmath": "mpmath"}


def need(*packages: str) -> None:
    """Make sure that packages of the extra `bench` are installed.

    Raises
    ------
    InputError
        If some are not.
    """
    missing = [PACKAGES[name] for name in packages if find_spec(name) is None]
    if missing:
        lacking = f"needs {' and '.join(missing)}; install what it compares with: pip install 'vctune[bench]'"
        raise InputError("vctune bench", [Mistake("", lacking)])


def slsqp(dense: Dense, seed: int) -> Stopped:
    """SciPy's SLSQP with exact derivatives."""
    return _slsqp(dense, exact=True)


def slsqp_differences(dense: Dense, seed: int) -> Stopped:
    """SciPy's SLSQP as it is called most often: its own finite differences."""
    return _slsqp(dense, exact=False)


def _slsqp(dense: Dense, *, exact: bool) -> Stopped:
    slope = {"jac": lambda z: dense.slopes(z)[1]} if exact else {}
    demand = {"type": "ineq", "fun": lambda z: dense.values(z)[1], **slope}
    options = {"maxiter": 200, "ftol": 1e-10}
    return _minimize(dense, "SLSQP", demand, options, exact=exact)


def trust_constr(dense: Dense, seed: int) -> Stopped:
    """SciPy's trust-constr with exact derivatives of both orders, sparse, begun cautiously."""
    from scipy.optimize import NonlinearConstraint
    from scipy.sparse import csr_matrix

    nothing = np.zeros(dense.levels.size)
    demand = NonlinearConstraint(
        lambda z: dense.values(z)[1],
        0,
        np.inf,
        jac=lambda z: csr_matrix(dense.slopes(z)[1]),
        hess=lambda z, multipliers: dense.curvature(z, 0.0, multipliers),
    )
    options = {
        "maxiter": 300,
        "gtol": 1e-8,
        "xtol": 1e-9,
        "initial_tr_radius": 0.1,
        "initial_barrier_parameter": 1e-3,
        "initial_barrier_tolerance": 1e-3,
    }
    hessian = {"hess": lambda z: dense.curvature(z, 1.0, nothing)}
    return _minimize(dense, "trust-constr", demand, options, exact=True, **hessian)


def cobyqa(dense: Dense, seed: int) -> Stopped:
    """SciPy's COBYQA, without derivatives."""
    from scipy.optimize import NonlinearConstraint

    demand = NonlinearConstraint(lambda z: dense.values(z)[1], 0, np.inf)
    options = {"maxfev": 200, "initial_tr_radius": 0.1, "final_tr_radius": 1e-7}
    return _minimize(dense, "COBYQA", demand, options, exact=False)


def differential_evolution(dense: Dense, seed: int) -> Stopped:
    """SciPy's differential evolution over all of the bounds, the sampled loop's stability among the demands."""
    from scipy.optimize import NonlinearConstraint
    from scipy.optimize import differential_evolution as evolve

    def worst(z: Floats) -> float:
        stable = spectral_radius(dense.problem.device, dense.design(z)[0]) < 1
        return float(dense.values(z)[1].min()) if stable else -MISSED

    with _quiet():
        found = evolve(
            lambda z: float(dense.values(z)[0][0]),
            _bounds(dense),
            constraints=NonlinearConstraint(worst, 0, np.inf),
            rng=np.random.default_rng(seed),
            popsize=15,
            maxiter=200,
            tol=1e-8,
            init="sobol",
            polish=False,
            x0=dense.numbers.guess,
        )
    return Stopped(np.asarray(found.x), bool(found.success), int(found.nit))


def _minimize(dense: Dense, method: str, demand: Any, options: dict[str, Any], *, exact: bool, **more: Any) -> Stopped:
    from scipy.optimize import minimize

    slope = {"jac": lambda z: dense.slopes(z)[0]} if exact else {}
    with _quiet():
        found = minimize(
            lambda z: float(dense.values(z)[0][0]),
            dense.numbers.guess,
            bounds=_bounds(dense),
            method=method,
            constraints=demand,
            options=options,
            **slope,
            **more,
        )
    return Stopped(np.asarray(found.x), bool(found.success), int(found.nit))


def nlopt_slsqp(dense: Dense, seed: int) -> Stopped:
    """NLopt's SLSQP with exact derivatives."""
    import nlopt

    def objective(z: Floats, gradient: Floats) -> float:
        if gradient.size:
            gradient[:] = dense.slopes(z)[0]
        return float(dense.values(z)[0][0])

    def demands(result: Floats, z: Floats, gradient: Floats) -> None:
        if gradient.size:
            gradient[:] = -dense.slopes(z)[1]
        result[:] = -dense.values(z)[1]

    solver = nlopt.opt(nlopt.LD_SLSQP, dense.numbers.guess.size)
    solver.set_lower_bounds(dense.numbers.low)
    solver.set_upper_bounds(dense.numbers.high)
    solver.set_min_objective(objective)
    solver.add_inequality_mconstraint(demands, np.full(dense.levels.size, 1e-9))
    solver.set_xtol_rel(1e-10)
    solver.set_maxeval(300)
    try:
        z, done = np.asarray(solver.optimize(dense.numbers.guess)), solver.last_optimize_result() > 0
    except (nlopt.RoundoffLimited, RuntimeError):
        z, done = dense.numbers.guess, False
    return Stopped(z, done, int(solver.get_numevals()))


def _bounds(dense: Dense) -> Any:
    from scipy.optimize import Bounds

    return Bounds(dense.numbers.low, dense.numbers.high)


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep the solvers' warnings about their own progress from stderr."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield
