"""The head of a page: the verdict as a word and a sign, one sentence, the error on its scale, and a warning stamp."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, floor, inf, log10
from typing import Literal

from vctune.analysis.demands import transparency_error
from vctune.document.records.certificate_json import CertificateRecord
from vctune.document.records.design_json import DesignRecord
from vctune.document.records.gains_json import SpringRecord
from vctune.document.records.part import text
from vctune.model.gains import Coupling, Gains
from vctune.model.numbers.units import Units
from vctune.model.problem import Problem
from vctune.proof.claims.registry import CLAIMS
from vctune.report.typography import quantity

LITTLE_USE = 0.75  # Share of the error without a loop at or above which a design is of little use
LINEAR_UP_TO = 10.0  # Greatest error on a linear scale; a greater error needs a logarithmic scale
MARGIN = 1.08  # Ratio of a linear scale's end to its greatest error
NOTHING = Coupling(1e-18, 1e-18, 0.0)  # A coupling that is practically absent, without drag

Kind = Literal["good", "doubtful", "bad"]


@dataclass(frozen=True, slots=True)
class Mark:
    """A mark on the error's scale."""

    label: str  # name of the mark, or text of a tick
    share: float  # position as a share of the scale's length
    value: str = ""  # the error as text; "" for a tick


@dataclass(frozen=True, slots=True)
class Scale:
    """The error on its yardstick."""

    marks: list[Mark]  # errors, this design first
    ticks: list[Mark]  # ticks of the scale
    little_use: float  # position at or above which a design is of little use; 1 if there is no such position
    logarithmic: bool  # whether the scale is logarithmic

    @property
    def said(self) -> str:
        """The scale in words."""
        axis = "logarithmic, 1 is off by the reference impedance" * self.logarithmic
        return "; ".join(
            [f"{mark.label} {mark.value}" for mark in self.marks]
            + [axis or "0 is perfect, 1 is off by the reference impedance"]
        )


@dataclass(frozen=True, slots=True)
class Summary:
    """The summary of a design for the first screen."""

    kind: Kind  # good, doubtful or bad
    sign: str  # the kind as one character
    word: str  # the verdict
    sentence: str  # the proved claim, or the reason why nothing is proved
    measure: str  # quality of the design; "" without a design
    next: str  # advice on the next step
    scale: Scale | None  # the error on its yardstick; None without a design


SIGNS: dict[Kind, str] = {"good": "✓", "doubtful": "!", "bad": "✗"}


def summary(record: DesignRecord, problem: Problem) -> Summary:
    """Return the summary of a design."""
    kind, word, sentence = _verdict(record, problem)
    measure, scale = _measure(record, problem), _scale(record, problem)
    return Summary(kind, SIGNS[kind], word, sentence, measure, _next(record, problem, kind), scale)


def _next(record: DesignRecord, problem: Problem, kind: Kind) -> str:
    """Return advice on the next step with a design."""
    if kind == "good":
        return "`vctune export design.json` makes the controller."
    if record.repairs:
        return "make one of the changes below in the problem file, and solve it again."
    if record.status == "certified":
        if problem.bounds.fixed:
            return "delete gains from the problem file; `vctune solve` then looks for better ones."
        return "a more useful design needs weaker constraints or a better device; see what limits this one."
    if record.status == "undecided":
        return "solve it with more time, or with weaker constraints: nothing is proved."
    return "weaken several constraints, or take a better device: no change of one number is known to suffice."


def doubt(record: DesignRecord, problem: Problem) -> str:
    """Return the text across each figure of a design; empty for a design that is certified and useful."""
    if record.status != "certified":
        return f"{record.status}: not for use"
    return "of little use" if _little_use(record, problem) else ""


def _little_use(record: DesignRecord, problem: Problem) -> bool:
    """Return whether a design is idle, has no error, or hardly reduces the error of the device without a loop."""
    error = record.transparency.error if record.transparency is not None else None
    return record.idle or error is None or error >= _useless_from(problem)


def _useless_from(problem: Problem) -> float:
    """Return the error at or above which a design is of little use."""
    if not problem.device.kind.banded:
        return inf
    return LITTLE_USE * _without_loop(problem)


def _without_loop(problem: Problem) -> float:
    """Return the error of an admittance display without a velocity loop and without a coupling."""
    return transparency_error(problem, Gains(0.0, 0.0), NOTHING).error


def _verdict(record: DesignRecord, problem: Problem) -> tuple[Kind, str, str]:
    """Return kind, verdict and sentence, as in `Summary`."""
    proof = record.certificate
    if proof is None:
        kind: Kind = "bad" if record.status == "infeasible" else "doubtful"
        reason = record.reason or ("no design meets the constraints" if kind == "bad" else "no design was found")
        return kind, record.status, f"{reason[0].upper()}{reason[1:]}."
    if record.status == "violated":
        return "bad", "violated", f"Not for use: {_failed(proof, 'refuted', record.units)}."
    if record.status == "undecided":
        return "doubtful", "undecided", f"Not proved, so not for use: {_failed(proof, 'undecided', record.units)}."
    return _certified(record, problem)


def _certified(record: DesignRecord, problem: Problem) -> tuple[Kind, str, str]:
    """Return kind, verdict and sentence of a certified design, as in `Summary`."""
    useless = _little_use(record, problem)
    word = "certified, of little use" if useless else "certified"
    return "doubtful" if useless else "good", word, f"Proved {record.promise}{_for_devices(problem)}."


def _for_devices(problem: Problem) -> str:
    """Return the devices for which the claim holds, in words; "" if it holds only for the stated device."""
    if problem.uncertainty is None:
        return ""
    known = [
        f"{key} ± {100 * width:.3g} %".replace("_hz", "").replace("_", " ")
        for key, width in problem.uncertainty.half_widths
        if width
    ]
    return f"; for every device within {', '.join(known)}" if known else ""


def _measure(record: DesignRecord, problem: Problem) -> str:
    """Return a sentence about the quality of a design, whether it is proved or not; "" without a design."""
    transparency = record.transparency
    if transparency is None:
        return ""
    if isinstance(record.coupling, SpringRecord):
        wall = f"A wall may be as stiff as {text(record.coupling.stiffness, 4)} {problem.units.stiffness}"
        moved = f"in free motion the handle is {text(transparency.admittance, 3)} of Z_0 = {_reference(problem)}"
        return f"{wall}; {moved}, {_norm_and_band(problem)}."
    if (contact := record.contact) is not None and contact.stiffest_contact is not None:
        bears = f"The stiffest contact is {text(contact.stiffest_contact, 7)} {problem.units.stiffness}"
        late = (
            f"with a latency of {text(1e3 * contact.latency_s, 3)} ms, contacts up to {text(contact.stiffness, 7)} "
            f"{problem.units.stiffness} need a drag of at least {text(contact.rest_drag, 4)} {problem.units.damping}"
        )
        return f"{bears}; {late}."
    if record.idle:
        return (
            f"The velocity loop hardly moves the handle: |1 - G_he| is {text(transparency.tracking, 3)}, "
            "and 1 means no loop at all."
        )
    off = f"The handle differs from the ideal by {text(transparency.error, 3)} of Z_0 = {_reference(problem)}"
    if not problem.device.kind.banded:
        return f"{off}, {_norm_and_band(problem)}."
    return f"{off}, {_norm_and_band(problem)}; the device without a loop differs by {text(_without_loop(problem), 3)}."


def _failed(proof: CertificateRecord, verdict: str, units: Units) -> str:
    """Return the first claim with a given verdict and where it fails; if no claim has it, the certificate's verdict."""
    claim = next((claim for claim in proof.claims if claim.verdict == verdict), None)
    if claim is None:
        return f"the certificate is {proof.verdict}"
    where = f" at {text(claim.witness_hz, 4)} Hz" if claim.witness_hz is not None else ""
    hand = f" in the hand of {claim.witness_hand.in_words(units)}" if claim.witness_hand is not None else ""
    one_is_proved = claim.id == "passive" and proof.proved_ratio == 1
    safe = " (a ratio of 1 is proved, the safety factor is missed)" if one_is_proved else ""
    return f"{CLAIMS[claim.id].label}, “{claim.claim}”, is {verdict}{where}{hand}{safe}"


def _reference(problem: Problem) -> str:
    return f"{problem.transparency.reference_impedance:.4g} {problem.units.damping}"


def _norm_and_band(problem: Problem) -> str:
    """Return the norm and the band of the error, in words."""
    low, high = problem.transparency.band.hz
    return f"{'in the mean' if problem.transparency.norm == 'rms' else 'at most'} from {low:.4g} to {high:.4g} Hz"


def _scale(record: DesignRecord, problem: Problem) -> Scale | None:
    if record.transparency is None or record.transparency.error is None:
        return None
    errors = {"this design": record.transparency.error}
    if problem.device.kind.banded:
        errors["device without a loop"] = _without_loop(problem)
    found = record.optimality
    if found is not None and found.lower_bound is not None and found.terms is None:
        errors["no design is below"] = found.lower_bound
    most, useless = max(errors.values()), _useless_from(problem)
    logarithmic = most > LINEAR_UP_TO
    if logarithmic:
        low = floor(log10(min([1.0, *filter(None, errors.values())])))
        high = float(ceil(log10(most * MARGIN)))
        ticks = {_number(10.0**k): 10.0**k for k in range(low, int(high) + 1, max(1, int(high - low) // 4))}
    else:
        high = MARGIN * max(most, 1.0)
        step = next(each for each in (0.25, 0.5, 1.0, 2.0) if high / each < 6)
        ticks = {_number(k * step): k * step for k in range(int(high / step) + 1)}

    def share(error: float) -> float:
        place = (log10(error or 10.0**low) - low) / (high - low) if logarithmic else error / high
        return round(min(max(place, 0.0), 1.0), 4)

    return Scale(
        [Mark(label, share(error), _number(error)) for label, error in errors.items()],
        [Mark(label, share(at)) for label, at in ticks.items()],
        share(useless) if useless < inf else 1.0,
        logarithmic,
    )


def _number(error: float) -> str:
    return str(quantity(error, digits=3))
