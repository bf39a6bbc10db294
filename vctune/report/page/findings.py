"""Sentences from a design's record: what its figures show, and what limits the design."""

from __future__ import annotations

from typing import NamedTuple

from vctune.analysis.feel import FREE_HZ, WALL_HZ, feel
from vctune.document.records.design_json import DesignRecord
from vctune.model.problem import Problem
from vctune.report.typography import quantity

MOST = 3  # Greatest number of active constraints on the first screen


# Names of active constraints, by a part of the formula
NAMES = {
    "|S|": "Robustness of the velocity loop",
    "|1 - S|": "Robustness against unmodelled dynamics",
    "walls in a hand": "Stability at walls",
    "in a hand": "Stability in the stated hands",
    " R": "Stability in any passive hand",
}


class Limit(NamedTuple):
    """A limit of a design: in words, with its formula and frequencies, and with the effect of weakening it."""

    words: str
    formula: str
    worth: str


def limits(record: DesignRecord) -> list[Limit]:
    """Return the active constraints, the most expensive first, then the worst hand and the best change of the
    device."""
    prices: dict[str, float] = {}
    for each in record.active:
        prices[each.demand] = prices.get(each.demand, 0.0) + each.multiplier
    dearest = sorted(prices, key=lambda demand: -prices[demand])
    found = [
        Limit(_named(demand), formula, f"with this limit 1 % weaker: error {-prices[demand]:+.2g} %")
        for formula, demand in zip(record.limits[:MOST], dearest, strict=False)
    ]
    if found and record.certificate is not None and (hand := _binding(record)):
        found.append(Limit("Worst hand", hand, ""))
    best = min(record.prices or [], key=lambda price: price.change, default=None)
    if best is not None and best.worth != "no difference":
        found.append(Limit("Best change of the device", f"{best.key} better by 1 %: error {best.worth}", ""))
    return found


def _named(demand: str) -> str:
    """Return a name of an active constraint for readers who do not know its formula."""
    return next((name for part, name in NAMES.items() if part in demand), "Constraint")


def _binding(record: DesignRecord) -> str:
    hands, units = record.certificate.hands if record.certificate is not None else None, record.units
    if hands is None:
        return ""
    world = hands.worst_world.row(None, units) if hands.worst_world else None
    article = "a " if world and world.unit.endswith("spring") else ""
    return hands.worst_hand.in_words(units) + (f", with {article}{world.value} {world.unit}" if world else "")


def findings(record: DesignRecord, problem: Problem) -> dict[str, str]:
    """Return a sentence about each figure of a design, by the figure's name; empty without a design."""
    proof, design, terms = record.certificate, record.design, record.transparency
    if proof is None or design is None or terms is None:
        return {}
    found, units, kind = {}, record.units, problem.device.kind
    if proof.hands is not None:
        in_hand = f"in the hand of {_binding(record)}"
        least = f"he ratio is least {_place(proof.hands.min_ratio, proof.hands.worst_hz)}, {in_hand}."
        found["hands"] = f"T{least}" if problem.worlds is None else f"With the environments of the problem t{least}"
    if proof.any_hand is not None:
        found["any-hand"] = f"The ratio is least {_place(proof.any_hand.min_ratio, proof.any_hand.worst_hz)}."
    if proof.hands is None or proof.hands.min_ratio != proof.min_ratio:
        found["llewellyn"] = f"The ratio is least {_place(proof.min_ratio, proof.worst_hz)}."
    if (loop := record.inner_loop) is not None:
        margins = (
            (loop.gain_margin_db, "dB", "gain"),
            (loop.phase_margin_deg, "deg", "phase"),
            (loop.delay_margin_s, "s", "delay"),
        )
        left = [f"{name} margin {quantity(value, unit, 3)}" for value, unit, name in margins if value is not None]
        peak = f"|S| is greatest {_place(loop.peak_sensitivity, loop.peak_sensitivity_hz)}"
        found["nyquist"] = f"{'; '.join([peak, *left])}."
    named = {"admittance": terms.admittance_label, "tracking": terms.tracking_label, "coupling": terms.coupling_label}
    sizes = {named[term]: getattr(terms, term) for term in kind.terms}
    most = max(sizes, key=lambda name: sizes[name] or 0.0)
    found["transparency"] = (
        f"The largest term of the error is {most}: {quantity(sizes[most], digits=3)} of "
        f"{quantity(terms.error, digits=3)}."
    )
    here = feel(problem.device, *design)
    mass = quantity(here.mass[0], units.mass, 3)
    wall = (
        f"; a wall feels like {quantity(here.stiffness, units.stiffness, 3)} at {WALL_HZ:g} Hz" if kind.own_loop else ""
    )
    found["impedance"] = f"In free motion the handle feels like {mass} at {FREE_HZ[0]:g} Hz{wall}."
    if (contact := record.contact) is not None:
        longest = max(contact.parts, key=lambda part: part.latency_s)
        share = f"{quantity(longest.latency_s, 's', 3)} of {quantity(contact.latency_s, 's', 3)}"
        found["latency"] = f"The longest part is the {longest.part}: {share}."
    if (bound := record.optimality) is not None and bound.gap is not None:
        found["optimality"] = f"No other design lowers the error by more than {100 * bound.gap:.3g} %."
    return found


def _place(value: float | None, hz: float | None) -> str:
    return f"{quantity(value)}" + ("" if hz is None else f" at {quantity(hz, 'Hz')}")
