"""What the numbers of a row, a region, a simulation and an identification mean, as `meaning` says it of a design.

The part of a row is its object in rows.jsonl, with a case that has its gains; of a simulation the traces are beside.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from math import inf, pi
from typing import Any

import frequency
import numpy as np
from arithmetic import DOUBLES
from loop import Loop, matrix
from meaning import (
    COUNTED,
    DESIGN,
    DIGEST,
    NAME,
    SHAKES,
    WORDS,
    Case,
    Elsewhere,
    Holds,
    Near,
    Oracle,
    Part,
    Said,
    Within,
    felt,
    lag,
    least_world,
    misses,
    yardstick,
)

DESIGNED = (
    "gains.velocity", "gains.position", "coupling.damping", "coupling.mass", "coupling.drag", "coupling.stiffness",
)  # fmt: skip

# ------------------------------------------------------------------ rows of a sweep


def as_design(path: str) -> Callable[[Case, Part], Any]:
    """Return the oracle that a design has at a path, of the record of the same gains."""

    def oracle(case: Case, _: Part) -> Any:
        part: Any = case.record
        for name in path.split(".")[:-1]:
            part = part.get(name) if part else None
        if part is None or part.get(path.rpartition(".")[2]) is None:
            return Said(None)
        found = DESIGN[path]
        assert callable(found)
        return found(case, part)

    return oracle


def felt_at(hz: float, *, damping: bool) -> Callable[[Case, Part], Any]:
    """Return the oracle of mass or damping of free motion."""

    def oracle(case: Case, _: Part) -> Any:
        if hz >= 0.5 / case.T:
            return Said(None)
        Z, unit = felt(case, hz, world=least_world(case)), 1.0 if damping else 2 * pi * hz
        value = Z.real if damping else Z.imag / unit
        return Within(value - 3e-6 * abs(Z) / unit, value + 3e-6 * abs(Z) / unit)

    return oracle


def stiffest_wall(case: Case, _: Part) -> Any:
    """|force/motion| at 10 Hz before a rigid world."""
    if 0.5 / case.T <= 10 or case.servo:
        return Said(None)
    world = (0.0, 0.0, inf)
    return Near(20 * pi * abs(felt(case, 10.0, world=world)), 1e-5)


def tracked(case: Case, hz: Any) -> Any:
    """Return |G_he|, or of an impedance display the force at the handle over the commanded one."""
    s = 2j * pi * np.asarray(hz)
    if not case.dual:
        return abs(frequency.demanded({"device": case.device}, case.gains, s, DOUBLES).G_he)
    push = frequency.low_pass(case.device.get("actuator", {}), s, DOUBLES) * frequency.hold(case.device, s, DOUBLES)
    P_hh, P_hu, P_mh, P_mu = frequency.mechanism(case.device, s, DOUBLES)
    velocity = case.device | {"velocity": {"from": "difference"} | case.device.get("velocity", {})}
    C = push * case.gains[0] * frequency.estimate(velocity, s, DOUBLES)
    return abs(P_hu * push / (1 + P_mu * C) / (P_hh - P_hu * C * P_mh / (1 + P_mu * C)))


def tracking_ends(case: Case, part: Part) -> Any:
    """Where tracking first falls below 1/sqrt 2."""
    found = part["tracking_bandwidth_hz"]
    if case.servo:
        return Holds(True)
    if found == 0:
        return Holds(bool(tracked(case, 1e-6 / case.T) < 0.5**0.5 + 1e-9))
    before = tracked(case, found * np.linspace(1e-3, 1 - 1e-3, 2000)).min() > 0.5**0.5 * (1 - 1e-3)
    ends = found >= 0.5 / case.T * (1 - 1e-9) or abs(tracked(case, found) - 0.5**0.5) < 1e-4
    return Holds(bool(before and ends))


def rest_ratio(case: Case, _: Part) -> Any:
    """2 f/(k q)."""
    q, f = case.device.get("velocity", {}).get("resolution"), case.device.get("friction")
    k = case.coupling[1] if case.dual else case.gains[1]
    rest = case.record.get("rest") or {}
    if f is None or not k or q is None or rest.get("encoder") is None:
        return Said(None)
    return 2 * f / (k * q)


def kicked(case: Case, _: Part) -> Any:
    """The share of kicks that keep moving, of the record of the same gains."""
    found = case.record.get("buzz")
    return Said(None) if not found else found["moving"] / found["kicks"]


def of_buzz(name: str) -> Callable[[Case, Part], Any]:
    """Return the oracle of a number of the worst kick, that of the record of the same gains."""

    def oracle(case: Case, _: Part) -> Any:
        value = (case.record.get("buzz") or {}).get(name)
        return Said(None) if value is None else value

    return oracle


ROWS: dict[str, Oracle] = {
    "schema": lambda *_: Said("vctune/rows/3"),
    "study": NAME,
    "axes[]": NAME,
    "key": DIGEST,
    "point.{}": lambda case, part: Holds(part["point"] == case.tables["_point"]),
    "status": as_design("status"),
    "idle": as_design("idle"),
    "reason": WORDS,
    "seconds": "elapsed time",
    "time_limit": Elsewhere("design/test_time_limit.py"),
    "error": as_design("transparency.error"),
    "admittance_term": as_design("transparency.admittance"),
    "tracking_term": as_design("transparency.tracking"),
    "coupling_term": as_design("transparency.coupling"),
    "velocity_gain": as_design("gains.velocity"),
    "position_gain": as_design("gains.position"),
    "coupling_damping": as_design("coupling.damping"),
    "coupling_mass": as_design("coupling.mass"),
    "coupling_drag": as_design("coupling.drag"),
    "coupling_stiffness": as_design("coupling.stiffness"),
    "min_ratio": as_design("certificate.min_ratio"),
    "worst_hz": lambda case, _: case.record["certificate"]["worst_hz"],
    "peak_sensitivity": as_design("inner_loop.peak_sensitivity"),
    "stability_high_hz": lambda case, _: case.tables["stability"].get("band_hz", [0, 0.05 / lag(case)])[1],
    "felt_mass_1hz": felt_at(1.0, damping=False),
    "felt_mass_10hz": felt_at(10.0, damping=False),
    "felt_damping_1hz": felt_at(1.0, damping=True),
    "felt_damping_10hz": felt_at(10.0, damping=True),
    "stiffest_wall": stiffest_wall,
    "tracking_bandwidth_hz": tracking_ends,
    "rest_ratio": rest_ratio,
    "chatter_m": as_design("rest.encoder.chatter_m"),
    "chatter_N": as_design("rest.encoder.chatter_N"),
    "damping_ratio": as_design("ringing.damping_ratio"),
    "ringing_hz": as_design("ringing.frequency_hz"),
    "ringing_s": as_design("ringing.time_constant_s"),
    "kicks_moving": kicked,
    "buzz_m": of_buzz("amplitude_m"),
    "buzz_N": of_buzz("force_N"),
    "buzz_hz": of_buzz("frequency_hz"),
    "yardstick_low_hz": lambda case, _: yardstick(case)[0][0],
    "yardstick_high_hz": lambda case, _: yardstick(case)[0][1],
    "reference_impedance": lambda case, _: yardstick(case)[1],
}


# ------------------------------------------------------------------ a region


def verdict_of_cell(case: Case, cell: list[Any], at: tuple[float, float]) -> bool | None:
    """Return whether the oracles find what a place of a cell is said to be; None of an undecided one."""
    axes = case.record["axes"]
    gains, coupling = dict(case.tables["gains"]), dict(case.tables["coupling"])
    for key, value in zip((axes["x"], axes["y"]), at, strict=True):
        table, _, name = key.partition(".")
        (gains if table == "gains" else coupling)[name] = float(value)
    if cell[5] is not None:
        coupling["damping"] = cell[5]
    design = {"gains": {"position": 0.0} | gains, "coupling": coupling}
    most = misses(replace(case, record=case.record | design))
    if cell[4] == "undecided":
        return None
    return most <= 1 + 1e-3 if cell[4] == "feasible" else most >= 1 - 1e-3


def cells(case: Case, part: Part) -> Any:
    """Some places of some cells are what they are said to be."""
    x, y = part["edges"]["x"], part["edges"]["y"]
    rng = case.rng
    for k in rng.permutation(len(part["cells"]))[:40]:
        cell = part["cells"][k]
        ends = (x[cell[0]], x[cell[1]]), (y[cell[2]], y[cell[3]])
        at = tuple(a + (b - a) * rng.random() for a, b in ends)
        if verdict_of_cell(case, cell, at) is False:
            return Holds(False)
    return Holds(True)


def areas(case: Case, part: Part) -> Any:
    """The shares of the plane, by counting the finest cells of each kind."""
    many = len(part["edges"]["x"]) - 1
    counted = dict.fromkeys(part["areas"], 0.0)
    for left, right, low, high, kind, _ in part["cells"]:
        counted[kind] += (right - left) * (high - low) / many**2
    return Holds(all(abs(counted[kind] - share) < 1e-9 for kind, share in part["areas"].items()))


def edges(axis: str) -> Callable[[Case, Part], Any]:
    """Return the oracle of the edges of a plane: they go from the least to the greatest of the range."""

    def oracle(case: Case, part: Part) -> Any:
        key = case.record["axes"][axis]
        table, _, name = key.partition(".")
        stated, found = case.tables[table][name], part[axis]
        rising = all(a < b for a, b in pairwise(found))
        within = stated["min"] * (1 - 1e-9) <= found[1] and abs(found[-1] / stated["max"] - 1) < 1e-9
        return Holds(rising and within)

    return oracle


def others(case: Case, part: Part) -> Any:
    """What is not an axis is as the problem states it."""
    for key, value in part["others"].items():
        table, _, name = key.partition(".")
        if isinstance(stated := case.tables.get(table, {}).get(name), float) and stated != value:
            return Holds(False)
    return Holds(True)


REGION: dict[str, Oracle] = {
    "schema": lambda *_: Said("vctune/region/1"),
    **{f"problem.{name}": DESIGN[f"problem.{name}"] for name in ("name", "sha256", "text", "units", "source")},
    "demands.safety_factor": lambda case, _: case.factor,
    "demands.max_sensitivity": lambda case, _: case.tables["stability"].get("max_sensitivity", 2.0),
    "demands.criterion": lambda case, _: Said(case.criterion),
    "demands.hands.{}[]": lambda case, part: Holds(all(
        np.allclose(part["hands"][name], pair) for name, pair in zip(
            ("mass", "damping", "stiffness"), zip(*case.box, strict=True), strict=True) if name in part["hands"]
    )),
    "axes.x": lambda case, _: Said(case.tables["_axes"][0]),
    "axes.y": lambda case, _: Said(case.tables["_axes"][1]),
    "others.{}": others,
    "others.{}.{}": others,
    "areas.{}": areas,
    "interrupted": lambda *_: Said(False),
    **{f"designs[].{path}": Elsewhere("study/test_region.py") for path in DESIGNED},
    "edges.x[]": edges("x"),
    "edges.y[]": edges("y"),
    "cells[][]": cells,
    "versions.{}": NAME,
    "sha256": DIGEST,
}  # fmt: skip


# ------------------------------------------------------------------ a simulation


def counted(run: Any, experiment: Part) -> np.ndarray:
    """Return the samples that count: without the first of several cycles, and of a wall those in contact."""
    hand, t = experiment["operator"], run.time
    travel = abs(hand.get("to", 0.05) - hand.get("from", 0.0))
    cycles, speed = hand.get("cycles", 3), hand.get("speed", 0.01)
    stroke = travel / (0.9 * speed) if hand.get("motion", "reciprocate") == "reciprocate" else pi / 2 * travel / speed
    found = t >= (2 * stroke * (1 - 1e-9) if cycles > 1 else 0.0)
    return found & (run.environment_force > 0) if experiment["environment"].get("wall") else found


def fitted(run: Any, experiment: Part) -> tuple[dict[str, float], dict[str, float], float, np.ndarray]:
    """Return the least-squares fit of the hand's force: numbers, standard errors, offset and what it leaves."""
    world = experiment["environment"]
    columns = {"stiffness": run.position, "damping": run.velocity}
    if world.get("mass", 0.0) > 0:
        columns["mass"] = np.gradient(run.velocity, run.time)
    names = [name for name in columns if world.get(name, 0.0) > 0] or ["damping"]
    kept = counted(run, experiment)
    A = np.column_stack([*(columns[name][kept] for name in names), np.ones(kept.sum())])
    normal = np.linalg.qr(A)
    x = np.linalg.solve(normal[1], normal[0].T @ run.force[kept])
    left = run.force[kept] - A @ x
    inverse = np.linalg.inv(normal[1])
    spread = np.sqrt((left @ left) / (len(left) - len(x)) * (inverse**2).sum(axis=1))
    return dict(zip(names, x, strict=False)), dict(zip(names, spread, strict=False)), float(x[-1]), left


def of_run(measure: Callable[[Any, Part, Part], Any]) -> Callable[[Case, Part], Any]:
    """Return the oracle of a number of a run: of its traces, of the experiment's table and of the part."""
    return lambda case, part: measure(case.tables["_traces"][id(part)][0], case.tables["_traces"][id(part)][1], part)


def work(time: np.ndarray, power: np.ndarray) -> np.ndarray:
    """Return the running integral of a power."""
    return np.r_[0.0, np.cumsum(np.diff(time) * (power[1:] + power[:-1]) / 2)]


def fits(key: str) -> Callable[[Any, Part, Part], Any]:
    """Return the oracle of a number of a fit: one of those that a least-squares fit of the traces has."""

    def measure(run: Any, experiment: Part, part: Part) -> Any:
        values, spread, _, _ = fitted(run, experiment)
        asked = {name: experiment["environment"].get(name, 0.0) for name in values}
        wanted = {"asked": asked, "value": values, "standard_error": spread}[key]
        return Holds(any(abs(part[key] - value) <= 1e-5 * abs(value) + 1e-12 for value in wanted.values()))

    return measure


def ripple(run: Any, experiment: Part, _: Part) -> Any:
    """The range of what the fit leaves, at less than a tenth of the greatest speed."""
    speed = abs(run.velocity[counted(run, experiment)])
    left = fitted(run, experiment)[3][speed < 0.1 * speed.max()]
    return Near(float(left.max() - left.min()), 1e-5)


def residual(run: Any, experiment: Part, _: Part) -> Any:
    """The root mean square of what the fit leaves."""
    return Near(float(np.sqrt(np.mean(fitted(run, experiment)[3] ** 2))), 1e-5)


def offset(run: Any, experiment: Part, _: Part) -> Any:
    """The force of the fit at the origin."""
    found = fitted(run, experiment)[2]
    return Within(found - 1e-6 * abs(run.force).max(), found + 1e-6 * abs(run.force).max())


METRICS: dict[str, Oracle] = {
    "non_overlap": Elsewhere("simulation/test_simulate_command.py"),
    "fits.{}.asked": of_run(fits("asked")),
    "fits.{}.value": of_run(fits("value")),
    "fits.{}.standard_error": of_run(fits("standard_error")),
    "offset": of_run(offset),
    "residual": of_run(residual),
    "ripple": of_run(ripple),
    "handle_energy": of_run(lambda run, *_: Near(float(work(run.time, run.force * run.velocity)[-1]), 1e-6)),
    "environment_energy": of_run(
        lambda run, *_: Near(float(work(run.time, run.environment_force * run.desired)[-1]), 1e-6)
    ),
    "motor_energy": of_run(lambda run, *_: Near(float(work(run.time, run.motor * (
        run.velocity if run.motor_velocity is None else run.motor_velocity))[-1]), 1e-6)),
    "handle_deficit": of_run(lambda run, *_: Near(float(-work(run.time, run.force * run.velocity).min()), 1e-6)),
    "environment_deficit": of_run(
        lambda run, *_: Near(float(-work(run.time, run.environment_force * run.desired).min()), 1e-6)
    ),
    "peak_motor": of_run(lambda run, *_: float(abs(run.motor).max())),
    "saturated": of_run(lambda run, experiment, _: float(np.mean(
        abs(run.motor) >= experiment.get("actuator", {}).get("limit", inf) * (1 - 1e-9)))),
    "peak_force": of_run(lambda run, *_: float(abs(run.force).max())),
}  # fmt: skip


def held_loop(case: Case, part: Part) -> np.ndarray:
    """Return the eigenvalues of the design's linear loop in the hand and the environment of an experiment."""
    _, experiment = case.tables["_traces"][id(part)]
    hand, world = experiment["operator"], experiment["environment"]
    loop = case.loop((hand.get("mass", 0.0), hand.get("damping", 2.0), hand.get("stiffness", 1000.0)))
    rest = world.get("mass", 0.0), world.get("damping", 0.0), world.get("stiffness", 0.0)
    return np.linalg.eigvals(matrix(Loop(loop.device, loop.gains, loop.coupling, loop.hand, rest)).astype(float))


def loop_of_run(of: Callable[[np.ndarray, Case], Any]) -> Callable[[Case, Part], Any]:
    """Return the oracle of a number of the linear loop; its rules and walls are those of tests elsewhere."""

    def oracle(case: Case, part: Part) -> Any:
        _, experiment = case.tables["_traces"][id(part)]
        if experiment["environment"].get("rule") != "trapezoid" or experiment["environment"].get("wall"):
            return Holds(True)
        return of(held_loop(case, part), case)

    return oracle


def _run(of: str) -> dict[str, Oracle]:
    design = of.endswith("design")
    shaken = Elsewhere("simulation/test_walls.py")
    return {f"{of}.metrics.{name}": oracle for name, oracle in METRICS.items()} | {
        f"{of}.curve[][]": Elsewhere("simulation/test_simulate_command.py"),
        f"{of}.diverged_s": Elsewhere("simulation/test_simulate_command.py"),
        f"{of}.loop.hz": lambda case, _: Within(0.0, 0.5 / case.T * (1 + 1e-9)),
        f"{of}.loop.spectral_radius": loop_of_run(
            lambda z, _: Near(float(abs(z).max()), 1e-6)
        ) if design else Elsewhere("simulation/test_growth.py", "radius"),
        f"{of}.loop.stable": lambda case, part: Said(part["spectral_radius"] < 1),
        f"{of}.motion.kind": shaken, f"{of}.motion.frequency_hz": shaken, f"{of}.motion.amplitude_m": shaken,
        f"{of}.motion.rests": SHAKES,
    }  # fmt: skip


def _stated(name: str, default: Any = 0.0) -> Callable[[Case, Part], Any]:
    """Return the oracle of a number of an experiment's environment."""

    def oracle(case: Case, part: Part) -> Any:
        value = case.tables["_traces"][id(part)]["environment"].get(name, default)
        return Said(value) if isinstance(value, str | bool) else float(value)

    return oracle


SIMULATION: dict[str, Oracle] = {
    "schema": lambda *_: Said("vctune/simulation/1"),
    "sha256": DIGEST,
    "problem.name": NAME,
    "problem.sha256": DIGEST,
    "problem.experiments_sha256": DIGEST,
    "problem.units": lambda case, _: Said(case.device.get("units", "linear")),
    **{path: DESIGN[path] for path in DESIGNED},
    "commanded": lambda case, _: Said(case.device["servo"].get("command", "velocity") if case.servo else None),
    "versions.{}": NAME,
    "experiments[].name": NAME,
    "experiments[].axis": lambda case, part: Said(
        "position" if part["environment"]["stiffness"] else "velocity"
    ),
    "experiments[].samples": lambda case, part: len(case.tables["_traces"][id(part["design"])][0].time),
    **{f"experiments[].environment.{name}": _stated(name) for name in ("mass", "damping", "stiffness", "zero")},
    "experiments[].environment.wall": _stated("wall", False),
    "experiments[].environment.rule": _stated("rule", "backward"),
    "experiments[].environment.late": _stated("late", 0),
    **_run("experiments[].baseline"),
    **_run("experiments[].design"),
}  # fmt: skip


# ------------------------------------------------------------------ an identification

DEVICES, FILES = (
    Elsewhere("identification/test_identified_devices.py"),
    Elsewhere("identification/test_identified_files.py"),
)
RECORDED, SERVOS = (
    Elsewhere("identification/test_identified_recordings.py"), Elsewhere("identification/test_identified_servos.py"),
)  # fmt: skip
RESPONSES = Elsewhere("identification/test_measured_responses.py")
IDENTIFICATION: dict[str, Oracle] = {
    "schema": lambda *_: Said("vctune/identification/1"),
    "name": NAME,
    "description": NAME,
    "rotary": SERVOS,
    "sample_time": DEVICES,
    "device": DEVICES,
    "assumed[]": SERVOS,
    **{f"numbers[].{name}": DEVICES for name in ("key", "value", "share", "low", "high")},
    "numbers[].unit": RECORDED,
    "numbers[].limit": FILES,
    "numbers[].estimates[].value": DEVICES,
    "numbers[].estimates[].sigma": DEVICES,
    "numbers[].estimates[].source": NAME,
    "unmodelled[][]": RESPONSES,
    "friction.coulomb": DEVICES,
    "force_noise": DEVICES,
    "recordings[].source": NAME,
    "recordings[].sha256": DIGEST,
    "recordings[].samples": FILES,
    "recordings[].used": COUNTED,
    "recordings[].sample_time": FILES,
    "recordings[].kind": SERVOS,
    "recordings[].residual_share": FILES,
    "recordings[].chi2": FILES,
    "recordings[].numbers[].name": Elsewhere(RECORDED.test, "damping_back"),
    "recordings[].numbers[].value": DEVICES,
    "recordings[].numbers[].sigma": DEVICES,
    "recordings[].derived[].name": SERVOS,
    "recordings[].derived[].value": SERVOS,
    "recordings[].derived[].sigma": RECORDED,
    "recordings[].candidates[].structure": FILES,
    "recordings[].candidates[].chosen": SERVOS,
    "recordings[].candidates[].chi2": RESPONSES,
    "recordings[].candidates[].model_error[]": RESPONSES,
    "recordings[].remarks[]": WORDS,
    "remarks[]": WORDS,
    "warnings[]": WORDS,
    "versions.{}": NAME,
}
