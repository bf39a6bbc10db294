"""Whole answers through public names, and how two of them differ."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import asdict
from functools import partial
from math import isclose, isfinite
from pathlib import Path
from typing import Any

import numpy as np
from conftest import ROOT
from identification_logs import Log, random_case
from posed import POSED
from servo_logs import servo_case

import vctune
from vctune.design.advice.prices import with_prices
from vctune.design.records.design import design_of, design_record
from vctune.design.ros.admittance_check import check_parameters
from vctune.document.reading import ProblemFile, parse_problem
from vctune.document.ros import read_admittances
from vctune.report.curves import requirements
from vctune.report.design_figures import design_figures
from vctune.report.experiments import simulation_figure
from vctune.report.identification import identification_files
from vctune.report.page import report_files
from vctune.report.region_figure import region_figure
from vctune.report.sweep_figure import sweep_figure
from vctune.running import time_limit

PROBLEMS = ROOT / "problems"
DIGITS = 7
OF_WORDS = 3e-3
"""Relative difference of numbers in words, which are rounded, that says nothing."""
SOUGHT, PLACES = 3e-3, ("hand", "worst", "hz", "witness", "figures")
"""Relative difference of a place at which something is least or greatest, and words in the keys of such places."""
WORK = 0.2
"""Relative difference of the boxes of a proof: more of them make it slower, fewer prove less than the whole."""
ALONE = "R in "
"""How the label of the curve of a single hand begins."""
ELSEWHERE = ("versions", "sha256", "problem", "schema", "solver", "curve")
"""Parts of a record that are of the release or of the input, and traces, whose pictures are looked at."""
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")


def plain(part: Any) -> Any:
    """Return a part of an answer as JSON without rounding errors of the last digits."""
    if isinstance(part, dict):
        return {str(key): plain(value) for key, value in part.items() if key not in ELSEWHERE}
    if isinstance(part, list | tuple | np.ndarray):
        return [plain(value) for value in part]
    if isinstance(part, float | np.floating):
        return float(f"{part:.{DIGITS}g}") if isfinite(part) else str(part)
    return part


def drawn(figure: Any) -> Iterator[list[Any]]:
    """Yield what each pair of axes shows: its texts, its range, and of each line its label, its ends and its range; not
    the curves of single hands, of which several are as hard."""
    for axes in figure.axes:
        legend = axes.get_legend()
        texts = [axes.get_title("left"), axes.get_title(), axes.get_xlabel(), axes.get_ylabel()]
        texts += [text.get_text() for text in (*axes.texts, *(legend.texts if legend else ()))]
        yield [*(each for each in texts if ALONE not in each), *axes.get_xlim(), *axes.get_ylim()]
        for line in (each for each in axes.lines if ALONE not in str(each.get_label())):
            curve = np.array(line.get_data(), float)
            finite = curve[:, np.isfinite(curve).all(axis=0)]
            sizes = [*finite[:, 0], *finite[:, -1], *finite.min(axis=1), *finite.max(axis=1)] if finite.size else []
            yield [str(line.get_label()), *sizes, *np.abs(finite).mean(axis=1)] if sizes else [str(line.get_label())]


def sentences(text: str) -> list[str]:
    """Return the sentences of a page, without its pictures."""
    text = re.sub(r"<(svg|style|script).*?</\1>|sha256[^<]*|\b[0-9a-f]{12,}\b", " ", text, flags=re.DOTALL)
    found = (re.sub(r"\s+", " ", part).strip() for part in re.split(r"<[^>]*>", text))
    return [part for part in found if part and "vctune" not in part]


def told(found: Any) -> Any:
    """Return the record of a design, its rows, its figures and its page."""
    record = design_of(found, "x")
    problem, shown = parse_problem(record.problem.text, "x", "x"), []
    if record.design is not None:
        shown = design_figures(problem, record, requirements(problem, *record.design), "")
    return {
        "record": found, "page": sentences(list(report_files(record, Path("x")).values())[-1]),
        "rows": [[title, *row] for title, rows in record.groups().items() for row in rows],
        "figures": [[each.title, each.name, *drawn(each.figure)] for each in shown],
    }  # fmt: skip


def of_design(kind: str, seed: int) -> Any:
    """Return what a check of a drawn design says."""
    return told(vctune.check(POSED[kind](np.random.default_rng((931, list(POSED).index(kind), seed)))).finding.record())


def of_problem(name: str) -> Any:
    """Return what the design of a problem says."""
    file = vctune.read_problem(PROBLEMS / f"{name}.toml")
    return told(design_record(file, with_prices(vctune.solve(file.problem))))


def of_text(text: str) -> Any:
    """Return what the design of a problem says, or a check of the design that it states."""
    file = ProblemFile(parse_problem(text, "x", "x"), text)
    with time_limit(300.0):  # without one some searches end by the clock
        return told(design_record(file, with_prices(vctune.solve(file.problem))))


def of_bound(name: str, gap: float) -> Any:
    """Return the proved bound of a problem."""
    return asdict(vctune.bound(PROBLEMS / f"{name}.toml", gap=gap).optimality)


def of_parameters() -> Any:
    """Return what a check of an admittance controller of ROS says, on a servo and on an arm with gains."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "ros.yaml"
        path.write_text(PARAMETERS)
        problems = [ProblemFile(parse_problem(text, "x", "x"), text) for text in (ARM, ROBOT)]
        each = [check_parameters([one], path, read_admittances(path)[0], print) for one in problems]
    return [[check.message, check.finding and check.finding.record()] for checks in each for check in checks]


def of_loop(kind: str, seed: int) -> Any:
    """Return the responses of a loop at some frequencies, and its state space."""
    tables = POSED[kind](np.random.default_rng((931, list(POSED).index(kind), seed)))
    judged = vctune.check(tables).finding.judgement
    found = [getattr(judged.loop(judged.posed.problem.hands.middle), name) for name in ("L", "S", "Z_seen", "Z_c")]
    each = [one.at([1.0, 30.0, 900.0]) for one in found]
    return [[repr(one), *np.abs(one.values), *np.angle(one.values)] for one in each]


def of_region(name: str, *axes: str) -> Any:
    """Return the cells of a region and its picture."""
    found = vctune.region(PROBLEMS / f"{name}.toml", *axes, resolution=1 / 16)
    figure = region_figure(found.file.problem, found.region, found.designs, None, contours=True)
    return {"record": found.record(), "rows": list(found.rows()), "figure": list(drawn(figure))}


def of_sweep(name: str, key: str, *values: float) -> Any:
    """Return the rows of a sweep, and its picture."""
    table = vctune.sweep(PROBLEMS / f"{name}.toml", {key: list(values)}).table
    figure = sweep_figure(table, grid=True)
    return {"rows": list(table.rows()), "figure": [] if figure is None else list(drawn(figure))}


def of_log(log: Log, *, servo: bool = False) -> Any:
    """Return what is identified from a log."""
    with tempfile.TemporaryDirectory() as folder:
        found = vctune.identify(*log.write(Path(folder)), servo=servo)
        *_, shown = identification_files(found.found, found.record, Path(folder)).values()
    record, text = found.record.to_json(), found.text
    return {
        "record": record, "rows": list(found.rows()), "file": text[text.index("[") :], "page": sentences(shown),
    }  # fmt: skip


def of_simulation(name: str) -> Any:
    """Return what a simulation measures, and its picture."""
    found = vctune.simulate(PROBLEMS / f"{name}.toml", ROOT / f"tests/gains/{name}.toml")
    return {
        "record": found.record(),
        "rows": list(found.rows()),
        "figure": list(drawn(simulation_figure(found.measured()).figure)),
    }


ARM = """device = { mass = 10.0, damping = 20.0, sample_time = 1e-3, delay = 1e-3 }
gains = { velocity = 800.0, position = 8000.0 }
"""
ROBOT = """device = { sample_time = 2e-3, servo = { delay = 0.006, bandwidth_hz = 8.0, order = 1 } }
operator = { stiffness = { max = 400.0 } }
"""
PARAMETERS = """admittance_controller:
  ros__parameters:
    joints: [j1]
    ft_sensor:
      name: ft
      filter_coefficient: 0.05
    admittance:
      selected_axes: [true, false, false, false, false, false]
      mass: [5.0, 5.0, 5.0, 0.1, 0.1, 0.1]
      damping_ratio: [2.5, 2.5, 2.5, 2.5, 2.5, 2.5]
      stiffness: [50.0, 50.0, 50.0, 10.0, 10.0, 10.0]
"""
TEXTS = {
    "late by samples": """device = { mass = 0.4, damping = 2.0, sample_time = 1e-3, delay = 2e-3 }
gains = { velocity = 60.0, position = 900.0 }
coupling = { damping = 200.0, mass = 0.5, drag = 15.0 }
stability = { criterion = "hands" }
uncertainty = { delay = 0.45 }
""",
    "springs": """device = { mass = 0.4, damping = 2.0, sample_time = 1e-3 }
gains = { velocity = 100.0, position = 900.0 }
coupling = { damping = 60.0, mass = 0.3, drag = 1.0 }
operator = { mass = { max = 0.3 }, damping = { max = 10.0 }, stiffness = { max = 500.0 } }
environment = { mass = { min = 0.1, max = 1.0 }, stiffness = { min = 100.0, max = 600.0 }, damping = { min = 0.5 } }
stability = { criterion = "hands" }
""",
    "walls": """device = { mass = 0.4, damping = 2.0, sample_time = 1e-3 }
gains = { velocity = 100.0, position = 900.0 }
coupling = { damping = 20.0, mass = 0.3, drag = 0.2 }
operator = { mass = { max = 0.3 }, damping = { max = 10.0 }, stiffness = { max = 500.0 } }
environment = { mass = { min = 0.1, max = 1.0 }, stiffness = { max = 600.0 }, damping = { min = 0.5 }, walls = true }
stability = { criterion = "hands" }
""",
    "nothing behind": """device = { mass = 2.0, damping = 5.0, sample_time = 1e-3, delay = 1e-3 }
gains = { velocity = 120.0, position = 0.0 }
coupling = { damping = inf }
operator = { stiffness = { max = 500.0 } }
environment = { mass = { max = 0.0 }, stiffness = { max = 0.0 } }
stability = { criterion = "hands" }
""",
    "steps": """[device]
display = "impedance"
mass = 0.06
damping = 0.1
friction = 0.02
sample_time = 1e-3
velocity = { filter_hz = 60.0, resolution = 2e-5 }
[coupling]
damping = 0.8
stiffness = 300.0
[stability]
criterion = "hands"
""",
    "flexible display": """[device]
display = "impedance"
mass = 0.3
damping = 1.0
sample_time = 1e-3
structure = { handle_mass = 0.08, frequency_hz = 90.0, damping_ratio = 0.03 }
[coupling]
damping = 0.3
stiffness = 30.0
""",
    "whole axis": """device = { mass = 0.4, damping = 2.0, sample_time = 1e-3, hold = "lag" }
gains = { velocity = 100.0, position = 2000.0 }
coupling = { damping = 60.0, mass = 0.3, drag = 6.0 }
operator = { damping = { min = 0.5, max = 20.0 } }
stability = { criterion = "passive", band_hz = [0.0, inf] }
""",
    "weak motor": """device = { mass = 0.4, damping = 2.0, sample_time = 1e-3 }
gains = { velocity = { min = 1.0, max = 2.0 }, position = 5000.0 }
""",
    "drifting": """device = { mass = 0.4, damping = 2.0, sample_time = 1e-3 }
gains = { velocity = 0.0, position = 0.0 }
coupling = { damping = 20.0, mass = 0.3, drag = 0.0 }
stability = { criterion = "hands" }
""",
}
SOLVED = (
    "friction-wheel", "infeasible", "knob", "wall", "arm-contact", "friction-wheel-hands", "delta-4khz",
    "friction-wheel-uncertain", "keemink", "desktop", "encoder", "late-arm",
    "extremes/everything", "extremes/peak", "../tests/reference/worlds/world-tools",
    "../tests/reference/real/real-everything",
    "../tests/reference/hands/hands-everything",
)  # fmt: skip
REGIONS: dict[str, tuple[str, ...]] = {
    "friction-wheel": (), "wall": (), "friction-wheel-hands": (), "paddle": ("coupling.damping", "coupling.stiffness"),
    "late-arm": ("coupling.mass", "coupling.drag"),
}  # fmt: skip
QUICK = {
    "both": (5, 1), "band": (0, 2), "band, disc": (4,), "band, uncertain": (4, 2), "hands": (1, 0, 5),
    "hands, weak": (3,), "hands, uncertain": (20, 11), "hands, nothing behind": (4, 0),
    "hands, environments": (3,), "hands, walls": (21, 15), "servo": (1, 3, 5), "servo, nothing behind": (5, 1),
    "servo, environments": (21,), "servo, uncertain": (4,), "servo, disc": (5, 2), "servo, spring": (3, 2),
    "display": (4, 5), "display, both": (0, 2), "display, uncertain": (6,), "wall": (0, 1),
    "wall in any hand": (0, 3), "wall, uncertain": (0,),
}  # fmt: skip
"""Draws of each kind that are judged in few seconds, violated ones among them."""
ANSWERS: dict[str, Callable[[], Any]] = {
    **{f"design: {kind} {seed}": partial(of_design, kind, seed) for kind, seeds in QUICK.items() for seed in seeds},
    **{f"problem: {name}": partial(of_problem, name) for name in SOLVED},
    **{f"text: {name}": partial(of_text, text) for name, text in TEXTS.items()},
    **{f"region: {name}": partial(of_region, name, *axes) for name, axes in REGIONS.items()},
    "bound: wheel": partial(of_bound, "friction-wheel", 0.1),
    "bound: hands": partial(of_bound, "friction-wheel-hands", 0.3),
    "bound: display": partial(of_bound, "desktop-arm", 0.3),
    "ros": of_parameters,
    "loop": partial(of_loop, "hands", 1),
    "sweep: damping": partial(of_sweep, "friction-wheel", "device.damping", 0.5, 2.0, 8.0),
    "sweep: late": partial(of_sweep, "arm-contact", "device.servo.delay", 0.005, 0.01),
    "sweep: mass": partial(of_sweep, "friction-wheel-hands", "device.mass", 0.3, 0.4, 0.5),
    **{f"log: {seed}": lambda seed=seed: of_log(random_case(seed).log) for seed in (2, 3)},
    **{
        f"servo log: {seed}": lambda seed=seed: of_log(Log(servo_case(seed).columns, ""), servo=True)
        for seed in range(3)
    },
    "simulation: friction-wheel": partial(of_simulation, "friction-wheel"),
}  # fmt: skip


def differences(then: Any, now: Any, near: float, path: str = "") -> Iterator[str]:
    """Yield each part of an answer that is not as it was, with its path."""
    if isinstance(then, dict) and isinstance(now, dict):
        for key in sorted(then.keys() | now.keys()):
            sought = max(near, SOUGHT) if any(word in key for word in PLACES) else near
            yield from differences(then.get(key), now.get(key), WORK if key == "boxes" else sought, f"{path}.{key}")
    elif isinstance(then, list) and isinstance(now, list) and len(then) == len(now):
        for k, (one, other) in enumerate(zip(then, now, strict=True)):
            yield from differences(one, other, near, f"{path}[{k}]")
    elif not alike(then, now, near):
        yield f"{path} was {then!r} and is {now!r}"


def alike(then: Any, now: Any, near: float) -> bool:
    """Return whether two values say the same: numbers up to rounding, also those in words."""
    if isinstance(then, str) and isinstance(now, str):
        numbers = zip(NUMBER.findall(then), NUMBER.findall(now), strict=False)
        return NUMBER.sub("0", then) == NUMBER.sub("0", now) and all(
            isclose(
                float(one), float(other), rel_tol=OF_WORDS, abs_tol=max(1e-12, 1.01 * last(one), 1.01 * last(other))
            )
            for one, other in numbers
        )
    if isinstance(then, bool) or isinstance(now, bool) or None in (then, now) or isinstance(then, str | list | dict):
        return bool(then == now)
    return isclose(then, now, rel_tol=near, abs_tol=1e-12)


def last(number: str) -> float:
    """Return one unit in the last place of a number in words, by which a rounding may differ; 0 of a whole number."""
    digits, _, exponent = number.partition("e")
    whole = "." not in digits and not exponent
    return 0.0 if whole else 10.0 ** (int(exponent or 0) - len(digits.partition(".")[2]))
