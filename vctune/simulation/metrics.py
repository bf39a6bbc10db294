"""Measure the traces of a run: rendering, non-overlap, ripple, energies, effort."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vctune.document.records.part import Nullable, RecordPart
from vctune.model.device import Commanded
from vctune.model.experiment import Environment, MovingHand
from vctune.model.gains import AnyCoupling, SpringDamper
from vctune.model.numbers.arithmetic import Floats
from vctune.simulation.run import Traces
from vctune.simulation.scene import evaluated_from, stroke_time

# Share of the travel at each end that counts as a turning point; also the share of the greatest speed that counts as
# near zero
TURNING_POINT = 0.1
N_POSITIONS = 400  # Number of positions at which the code compares loading and unloading
SATURATED = 1 - 1e-9  # Share of the limit above which a force counts as at the limit


class Fit(RecordPart):
    """A mass, damping or stiffness of the environment as the hand feels it, fitted by least squares; SI units."""

    value: Nullable  # value that the hand feels
    asked: Nullable  # value of the parameter in the environment; 0 for the damping of free motion
    standard_error: Nullable  # standard error of the value, from the residual


class Metrics(RecordPart):
    """The measures of a run; null for a measure that does not exist."""

    non_overlap: Nullable
    fits: dict[str, Fit]
    offset: Nullable  # force of the fit at the origin, N
    residual: Nullable  # root mean square difference of the force from the fit, N
    ripple: Nullable
    handle_energy: Nullable  # work of the hand on the handle, J
    environment_energy: Nullable  # energy absorbed by the environment, J
    motor_energy: Nullable  # work of the commanded motor force on the device, J; None for a servo
    handle_deficit: Nullable
    environment_deficit: Nullable
    peak_motor: Nullable  # greatest magnitude of the command u, N
    saturated: Nullable  # share of the samples at the actuator's limit; 0 without a limit
    peak_force: Nullable  # greatest |f_h|, N


def metrics(
    traces: Traces,
    environment: Environment,
    operator: MovingHand,
    limit: float | None,
    commanded: Commanded = "force",
    coupling: AnyCoupling | None = None,
) -> Metrics:
    """Measure a run. The spring of an impedance display's coupling is part of what is rendered."""
    counted = traces.time >= evaluated_from(operator)
    if environment.wall:
        counted &= in_contact(traces, environment)
    fitted = None if operator.stays else _fit(traces, with_spring(environment, coupling), counted)
    driven = traces.velocity if traces.motor_velocity is None else traces.motor_velocity
    pushed = float(_energy(traces.time, traces.motor * driven)[-1]) if commanded == "force" else None
    handle = _energy(traces.time, traces.force * traces.velocity)
    rendered = _energy(traces.time, traces.environment_force * traces.desired)
    return Metrics(
        non_overlap=_non_overlap(traces, counted, stroke_time(operator))
        if environment.stiffness > 0 and not operator.stays
        else None,
        fits=fitted.fits if fitted else {},
        offset=fitted.offset if fitted else None,
        residual=float(np.sqrt(np.mean(fitted.about**2))) if fitted else None,
        ripple=_ripple(fitted.about, np.abs(traces.velocity[counted])) if fitted else None,
        handle_energy=float(handle[-1]),
        environment_energy=float(rendered[-1]),
        motor_energy=pushed,
        handle_deficit=float(abs(handle.min())),
        environment_deficit=float(abs(rendered.min())),
        peak_motor=float(np.abs(traces.motor).max()),
        saturated=float(np.mean(np.abs(traces.motor) >= limit * SATURATED)) if limit is not None else 0.0,
        peak_force=float(np.abs(traces.force).max()),
    )


def in_contact(traces: Traces, environment: Environment) -> NDArray[np.bool_]:
    """Return at which samples a wall is met: where its spring and its damper push, its mass aside."""
    if environment.mass == 0:
        return traces.environment_force > 0
    depth = traces.reference - environment.zero
    return np.asarray(environment.stiffness * depth + environment.damping * traces.desired > 0)


def with_spring(environment: Environment, coupling: AnyCoupling | None) -> Environment:
    """Return an environment whose spring is in series with that of a coupling, if it has one."""
    if not isinstance(coupling, SpringDamper) or environment.stiffness == 0:
        return environment
    return replace(environment, stiffness=1 / (1 / coupling.stiffness + 1 / environment.stiffness))


@dataclass(frozen=True, slots=True)
class _Fitted:
    """A fit of the force: the parameters, the force at the origin, and the residual force of each counted sample, N."""

    fits: dict[str, Fit]
    offset: float
    about: Floats


def _fit(traces: Traces, environment: Environment, counted: NDArray[np.bool_]) -> _Fitted | None:
    """Return the least-squares fit of the force to the environment's terms: position, velocity, acceleration."""
    columns = {"stiffness": traces.position, "damping": traces.velocity}
    if environment.mass > 0:
        columns["mass"] = np.gradient(traces.velocity, traces.time)
    names = [name for name in columns if getattr(environment, name) > 0] or ["damping"]
    force = traces.force[counted]
    if force.size <= len(names) + 1:
        return None
    regressors = np.column_stack([*(columns[name][counted] for name in names), np.ones(force.size)])
    scale = np.abs(regressors).max(axis=0)
    scale[scale == 0] = 1.0
    scaled = regressors / scale
    solution = np.linalg.lstsq(scaled, force, rcond=None)[0]
    about = force - scaled @ solution
    variance = np.sum(about**2) / (force.size - solution.size)
    errors = np.sqrt(variance * np.diag(np.linalg.pinv(scaled.T @ scaled))) / scale
    values = solution / scale
    fits = {
        name: Fit(value=float(value), asked=getattr(environment, name), standard_error=float(error))
        for name, value, error in zip(names, values, errors, strict=False)
    }
    return _Fitted(fits, float(values[-1]), about)


def _ripple(about: Floats, speed: Floats) -> float | None:
    """Return the greatest minus the least residual force of the fit near zero velocity; None if no sample is there."""
    slow = about[speed < TURNING_POINT * speed.max()]
    return float(np.ptp(slow)) if slow.size else None


def _non_overlap(traces: Traces, counted: NDArray[np.bool_], stroke: float) -> float | None:
    """Return the greatest distance between the force curves of the two directions at the same position."""
    number = np.floor(traces.time / stroke + 1e-9).astype(int)
    strokes = [np.flatnonzero((number == k) & counted) for k in np.unique(number[counted])]
    strokes = [at for at in strokes if at.size > 1]
    if len({number[at[0]] % 2 for at in strokes}) < 2:
        return None
    low = max(traces.position[at].min() for at in strokes)
    high = min(traces.position[at].max() for at in strokes)
    if high <= low:
        return None
    positions = np.linspace(low + TURNING_POINT * (high - low), high - TURNING_POINT * (high - low), N_POSITIONS)
    curves: dict[int, list[Floats]] = {0: [], 1: []}
    for at in strokes:
        order = np.argsort(traces.position[at], kind="stable")
        curves[number[at[0]] % 2].append(np.interp(positions, traces.position[at][order], traces.force[at][order]))
    outward, inward = np.array(curves[0]), np.array(curves[1])
    apart = np.maximum(outward.max(axis=0) - inward.min(axis=0), inward.max(axis=0) - outward.min(axis=0))
    return float(apart.max())


def _energy(time: Floats, power: Floats) -> Floats:
    """Return the running integral of a power by the trapezoidal rule, J."""
    steps = np.diff(time) * (power[1:] + power[:-1]) / 2
    return np.concatenate([[0.0], np.cumsum(steps)])
