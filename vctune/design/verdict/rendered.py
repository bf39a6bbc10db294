"""Find the stiffest spring and the lightest tool with which given gains are proved stable, beyond a problem's box."""

from __future__ import annotations

from dataclasses import replace
from math import ceil, floor, log10

from vctune.analysis.in_hands import least_ratios
from vctune.design.prepared import pose
from vctune.design.verdict.judge import Judgement
from vctune.model.problem import Problem
from vctune.model.worlds import Worlds
from vctune.proof.claims.every_hand import prove_hands
from vctune.proof.claims.margins_of_claims import Design
from vctune.proof.outcome import Verdict
from vctune.running import OutOfTimeError

SOFTEST, STIFFEST = 1.0, 1e7  # N/m, or N m/rad
LIGHTEST, HEAVIEST = 1e-4, 1e3  # kg, or kg m^2
HALVINGS = 14  # Number of bisections: the limit is found to .1 %
RESERVES = (5e-3, 0.03, 0.1)  # Distances from the limit in doubles at which a proof is tried


def rendered_in_words(problem: Problem, judgement: Judgement) -> str:
    """Return "proved are springs up to ... and tools from ..."; "" without a box of linear environments."""
    worlds, units = problem.worlds, problem.units
    if problem.hands_met is None or worlds is None or worlds.walls or worlds.exact:
        return ""
    spring = tool = None
    try:
        spring = _limit(problem, judgement, "stiffness", SOFTEST, STIFFEST)
        tool = _limit(problem, judgement, "mass", LIGHTEST, HEAVIEST)
    except OutOfTimeError:
        return ""
    found = [f"springs up to {spring:g} {units.stiffness}"] if spring is not None else []
    found += [f"tools from {tool:g} {units.mass}"] if tool is not None else []
    return f"proved are {' and '.join(found)}" if found else ""


def _limit(problem: Problem, judgement: Judgement, name: str, low: float, high: float) -> float | None:
    """Return the greatest stiffness or the least mass that is proved, with the box's other ranges; None if none is."""
    stiff = name == "stiffness"
    good, bad = (low, high) if stiff else (high, low)
    if not _holds(problem, judgement, name, good):
        return None
    for _ in range(HALVINGS):
        middle = (good * bad) ** 0.5
        good, bad = (middle, bad) if _holds(problem, judgement, name, middle) else (good, middle)
    for reserve in RESERVES:
        value = _rounded(good * (1 - reserve), up=False) if stiff else _rounded(good * (1 + reserve), up=True)
        if _proved(problem, judgement, name, value):
            return value
    return None


def _with_end(worlds: Worlds, name: str, value: float) -> Worlds:
    """Return the box with another greatest stiffness or least mass; the other end moves with it where it must."""
    low, high = getattr(worlds.low, name), getattr(worlds.high, name)
    ends = (min(low, value), value) if name == "stiffness" else (value, max(high, value))
    return replace(worlds, low=replace(worlds.low, **{name: ends[0]}), high=replace(worlds.high, **{name: ends[1]}))


def _holds(problem: Problem, judgement: Judgement, name: str, value: float) -> bool:
    """Return whether the design seems stable with the other box, in doubles."""
    assert problem.worlds is not None
    posed = pose(replace(problem, worlds=_with_end(problem.worlds, name, value)))
    ratios = (least_ratios(case, judgement.gains, judgement.coupling)[0].ratio for case in posed.hand_cases)
    return min(ratios) >= problem.stability.safety_factor


def _proved(problem: Problem, judgement: Judgement, name: str, value: float) -> bool:
    assert problem.worlds is not None
    posed = pose(replace(problem, worlds=_with_end(problem.worlds, name, value)))
    design = Design(posed.demands.device, judgement.gains, judgement.coupling)
    return prove_hands(design, posed.demands, posed.box).verdict is Verdict.PROVED


def _rounded(value: float, *, up: bool) -> float:
    """Return a number of three digits that is not beyond the given one."""
    unit = 10.0 ** (floor(log10(value)) - 2)
    return float(f"{(ceil if up else floor)(value / unit) * unit:.3g}")
