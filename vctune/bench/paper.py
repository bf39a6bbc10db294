"""The paper's own way: a quasi-Newton method with line search on a penalty, in SciPy and, where it is, in Octave."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from importlib.resources import files
from pathlib import Path

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.bench.dense import Dense, Stopped

PENALTIES = [10.0**k for k in range(1, 9)]
"""Weights of the squared violations, one after the other, each from the last one's answer."""
OCTAVE_SECONDS = 120.0


def bfgs(dense: Dense, seed: int) -> Stopped:
    """SciPy's BFGS with exact gradients on objective + weight * sum of squared violations, the weight growing."""
    from scipy.optimize import minimize

    numbers, z, rounds, done = dense.numbers, dense.numbers.guess, 0, True

    def penalised(z: Floats, weight: float) -> tuple[float, Floats]:
        (f, g), (df, dg) = dense.values(z), dense.slopes(z)
        short, below, above = np.minimum(g, 0), np.minimum(z - numbers.low, 0), np.minimum(numbers.high - z, 0)
        value = float(f[0]) + weight * float(short @ short + below @ below + above @ above)
        return value, df + 2 * weight * (short @ dg + below - above)

    for weight in PENALTIES:
        found = minimize(penalised, z, args=(weight,), jac=True, method="BFGS", options={"gtol": 1e-6, "maxiter": 100})
        if not np.isfinite(found.x).all():
            return Stopped(z, False, rounds)
        z, rounds, done = np.asarray(found.x), rounds + int(found.nit), bool(found.success)
    return Stopped(z, done, rounds)


def octave() -> str | None:
    """Return where GNU Octave is, None if it is not on PATH."""
    return shutil.which("octave-cli") or shutil.which("octave")


def octave_sqp(dense: Dense, seed: int) -> tuple[Stopped, float]:
    """Octave's sqp, and the processor time that Octave itself counts, s."""
    return _octave(dense, "sqp")


def octave_fminunc(dense: Dense, seed: int) -> tuple[Stopped, float]:
    """Octave's fminunc (quasi-Newton) on the penalty of `bfgs`."""
    return _octave(dense, "fminunc")


def _octave(dense: Dense, method: str) -> tuple[Stopped, float]:
    where = octave()
    assert where is not None
    with tempfile.TemporaryDirectory() as folder:
        script = files("vctune.bench").joinpath("peer.m").read_text()
        (Path(folder) / "peer.m").write_text(script)
        (Path(folder) / "given.m").write_text(_given(dense, method))
        try:
            done = subprocess.run(
                [where, "--quiet", "--no-gui", "--eval", "peer"],
                cwd=folder,
                capture_output=True,
                text=True,
                check=True,
                timeout=OCTAVE_SECONDS,
            )
            seconds, converged, rounds, *z = (float(word) for word in done.stdout.split())
        except (subprocess.SubprocessError, ValueError):
            return Stopped(dense.numbers.guess, False, 0), OCTAVE_SECONDS
    return Stopped(np.array(z), bool(converged), int(rounds)), seconds


def _given(dense: Dense, method: str) -> str:
    """Return the problem as Octave assignments; the formulas are in peer.m, written once more."""
    from vctune.analysis.demands import sampled_span

    scaled, numbers = dense.scaled, dense.numbers
    device, wanted, stability = scaled.device, scaled.transparency, scaled.stability
    reserve = float(dense.levels.max() - np.log(stability.safety_factor))

    def row(numbers: list[float] | Floats) -> str:
        return "[" + " ".join(repr(float(x)) for x in numbers) + "]"

    said = {
        "method": repr(method),
        "device": row([device.mass, device.damping, device.sample_time, device.delay, device.hold == "zoh"]),
        "fixed": row(list(dense.fixed)),
        "index": row([c.index + 1 for c in dense.free]),
        "scale": row([c.scale for c in dense.free]),
        "low": row(numbers.low),
        "high": row(numbers.high),
        "guess": row(numbers.guess),
        "band": row(list(sampled_span(scaled))),
        "felt": row([wanted.band.min, wanted.band.max]),
        "weights": row([wanted.weights.admittance, wanted.weights.tracking, wanted.weights.coupling]),
        "demands": row([stability.safety_factor, stability.max_sensitivity, reserve]),
        "count": str(dense.levels.size // 2),
        "integrator": str(int(dense.shape.integrator)),
        "penalties": row(PENALTIES),
    }
    return "\n".join(f"{name} = {value};" for name, value in said.items()) + "\n"
