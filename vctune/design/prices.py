"""What a better device would be worth: each of its numbers better by a tenth, the problem solved again.

Demands are met in double precision; nothing is proved. See design/README.md, section 11.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf
from time import perf_counter

import numpy as np

from vctune.design.estimate import Estimate, estimated, estimated_from
from vctune.design.exchange import TIGHTENING
from vctune.design.judge import Judgement, Status, judge
from vctune.design.prepared import prepare
from vctune.design.result import Solved
from vctune.design.scan import ScanResult, start_at
from vctune.design.start import Start
from vctune.design.variables import design_of, point
from vctune.design.working_set import WorkingSet
from vctune.document.building import problem as restated
from vctune.document.errors import InputError
from vctune.document.prices import NO_DIFFERENCE
from vctune.model.gains import Gains
from vctune.model.problem import Problem

STEP = 0.1
"""By what share each number gets better: what another part of the same kind offers. Of half the step the price is about
half, and twice the step is another device, whose design may lie in another basin."""
LONGEST = 10.0
"""Seconds after which no other number is tried: a device whose every design takes long has its prices in part. Half
leaves out prices of uncertain devices on a slow machine, twice waits for a table that nobody asked for."""
OTHER_BASINS = 1.25
"""By what factor the scanned error of a start may exceed the best one's if it is tried on the better device, too: a
tenth of the sample time is worth up to a quarter of the error, and not the same in each basin. That which then wins in
`problems/extremes/feather.toml` is at 1.09: half as far still sees it. Twice as far is time for starts that do not
win."""
LESS, MORE = 1 - STEP, 1 + STEP
BETTER = {
    "mass": (LESS, MORE),
    "damping": (LESS, MORE),
    "sample_time": (LESS,),
    "delay": (LESS,),
    "velocity.filter_hz": (LESS, MORE),
    "actuator.bandwidth_hz": (MORE,),
    "force_sensor.bandwidth_hz": (MORE,),
    "force_sensor.delay": (LESS,),
    "structure.handle_mass": (LESS, MORE),
    "structure.frequency_hz": (MORE,),
    "structure.damping_ratio": (LESS, MORE),
}
"""Factors that make a number of the device better. Which of two it is depends on the rest of the device: less mass is
moved more easily, more of it needs less of a coupling; a filter that is faster may raise a peak of |S|, and the
firmware may as well have a slower one."""

Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Price:
    """What a better number of the device is worth, everything else of the problem as it is.

    Attributes
    ----------
    key : of the number in the problem file
    old, new : its values, in SI units and hertz; the new one None if there was no time to try any
    error : of the best design that was found with the new value, nothing of it proved; None where none was
    change : of the error, relative to that of the design as it is; None where there is none
    """

    key: str
    old: float
    new: float | None
    error: float | None
    change: float | None


@dataclass(frozen=True, slots=True)
class _Known:
    """The design at hand.

    Attributes
    ----------
    judgement : of it
    others : gains of the other basins that the scan saw, SI units
    peak_sensitivity : that the scan saw
    demands : where its last NLP posed the demands, in SI units; None of a box of devices
    tightening : by what share the demands had to be sharpened for its proof
    """

    judgement: Judgement
    others: tuple[Gains, ...]
    peak_sensitivity: float
    demands: WorkingSet | None
    tightening: float


def with_prices(solved: Solved, progress: Progress = lambda stage: None) -> Solved:
    """Return what came of a problem with what each better number of its device is worth, if its design is certified.

    Parameters
    ----------
    solved : what came of a problem
    progress : told what is tried
    """
    judgement, began = solved.judgement, perf_counter()
    if judgement is None or judgement.status is not Status.CERTIFIED:
        return solved
    known, found = _known(solved, judgement), []
    for key in solved.problem.device.numbers():
        progress(f"a better device: {key}")
        better = _better(solved.problem, key)
        late = perf_counter() - began > LONGEST
        found += [_price(solved.problem, known, key, {} if late else better)] if better else []
    found.sort(key=lambda price: inf if price.change is None else price.change)
    return replace(solved, prices=found, seconds={**solved.seconds, "prices": perf_counter() - began})


def _known(solved: Solved, judgement: Judgement) -> _Known:
    scanned, polished = solved.scanned, solved.polished
    if scanned is None or polished is None:
        return _Known(judgement, (), 0.0, None, TIGHTENING)
    units, demands = prepare(solved.problem).units, None
    near = [start for start in scanned.starts if start.error <= OTHER_BASINS * scanned.starts[0].error]
    others = [units.to_si(point(start.gains, start.coupling)) for start in near if start is not polished.start]
    if solved.problem.uncertainty is None:
        demands = polished.working_set.on_device(solved.problem.device, 1 / units.impedance, 1 / units.time)
    gains = tuple(design_of(values)[0] for values in others)
    return _Known(judgement, gains, scanned.peak_sensitivity, demands, polished.tightening)


def _better(problem: Problem, key: str) -> dict[float, Problem]:
    """Return the problems with a better number of the device, by that number, as far as there can be one."""
    old, device = problem.device.number(key), problem.device
    better = [float(f"{old * factor:.12g}") for factor in BETTER[key]] if old > 0 else []
    problems = {new: replace(problem, device=device.with_numbers({key: new})) for new in better}
    return {new: changed for new, changed in problems.items() if _can_be_stated(changed)}


@np.errstate(all="ignore")
def _price(problem: Problem, known: _Known, key: str, better: dict[float, Problem]) -> Price:
    """Return what the best of some better numbers is worth."""
    old, before = problem.device.number(key), known.judgement.error
    errors: dict[float, float] = {}
    for new, changed in better.items():
        errors[new] = _polished_again(changed, known, min(errors.values(), default=inf))
    if not problem.bounds.fixed and min(errors.values(), default=inf) > before * (1 + NO_DIFFERENCE):
        errors = {
            new: min(errors[new], _error_of(estimated(changed, known.tightening))) for new, changed in better.items()
        }
    best = min(errors, key=lambda each: errors[each], default=None)
    error = errors[best] if best is not None and errors[best] < inf else None
    return Price(f"device.{key}", old, best, error, None if error is None else error / before - 1)


def _can_be_stated(problem: Problem) -> bool:
    """Return whether a problem file may say so: the corner of a filter, for one, stays below Nyquist."""
    try:
        restated(problem)
    except InputError:
        return False
    return True


def _polished_again(problem: Problem, known: _Known, incumbent: float) -> float:
    """Return the error of the best design that the known one, and those of other basins, lead to.

    It is inf without any, and where it would be above the incumbent's.

    The NLP is that of the known design, so that nothing is compiled again, and begins with the demands where that met
    them.
    """
    if problem.bounds.fixed:
        judgement = judge(problem, *problem.fixed_design)
        return judgement.error if judgement.status is Status.CERTIFIED else inf
    prepared, judgement = prepare(problem), known.judgement
    units = prepared.units
    law = design_of(units.to_dimensionless(point(judgement.gains, judgement.coupling)))
    starts = [Start(*law, prepared.scaled.error(*law))]
    for gains in known.others:
        moved = start_at(prepared.scaled, units.gains(gains))
        starts += [moved] if moved is not None else []
    demands = known.demands
    if demands is not None:
        demands = demands.on_device(prepared.scaled.problem.device, units.impedance, units.time)
    scanned = ScanResult(starts, known.peak_sensitivity)
    found = estimated_from(prepared, scanned, demands=demands, tightening=known.tightening, incumbent=incumbent)
    return _error_of(found)


def _error_of(found: Estimate | None) -> float:
    return inf if found is None else found.error
