"""The head of a page: the verdict as a word and a mark, one sentence, and the error on its scale."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Literal

from vctune.analysis.demands import transparency_error
from vctune.document.records.certificate_json import CertificateRecord
from vctune.document.records.design_json import DesignRecord
from vctune.document.records.gains_json import SpringRecord, TransparencyRecord
from vctune.document.records.part import text
from vctune.model.gains import Coupling, Gains
from vctune.model.numbers.units import Units
from vctune.model.problem import Problem

LITTLE_USE = 0.75
"""Share of the error without a loop from which on a design is of little use: a design that removes less than a quarter
of it is hardly worth a force sensor. Half would say so of designs that halve the error, twice of none that is worse
than no loop."""
LINEAR_UP_TO = 1.5
"""Error up to which the scale is linear; greater errors come ever closer to its end."""
NOTHING = Coupling(1e-18, 1e-18, 0.0)
"""Practically no coupling, but not 0, because formulas divide by it."""

Kind = Literal["good", "doubtful", "bad"]


@dataclass(frozen=True, slots=True)
class Mark:
    """A place on the error's scale.

    Attributes
    ----------
    label : text at the mark
    error : its value
    share : its place as a share of the scale's length
    """

    label: str
    error: float
    share: float


@dataclass(frozen=True, slots=True)
class Summary:
    """The summary of a design at a glance.

    Attributes
    ----------
    kind : good, doubtful or bad
    sign : the kind as one character
    word : the verdict
    sentence : the meaning of the verdict
    marks : marks on the error's scale, this design first; empty without a design
    ticks : ticks of the scale
    little_use : place on the scale from which on a design is of little use
    """

    kind: Kind
    sign: str
    word: str
    sentence: str
    marks: list[Mark]
    ticks: list[Mark]
    little_use: float


SIGNS: dict[Kind, str] = {"good": "✓", "doubtful": "!", "bad": "✗"}


def summary(record: DesignRecord, problem: Problem) -> Summary:
    """Return the summary of a design.

    Parameters
    ----------
    record : record of the design, or of the reason why there is none
    problem : stated by the record
    """
    kind, word, sentence = _verdict(record, problem)
    useless = _useless_from(problem)
    ticks = [_mark(label, at) for label, at in (("0: perfect", 0.0), ("0.5", 0.5), ("1: off by Z_0", 1.0), ("2", 2.0))]
    return Summary(
        kind, SIGNS[kind], word, sentence, _marks(record, problem), ticks, _share(useless) if useless < inf else 1.0
    )


def doubt(record: DesignRecord, problem: Problem) -> str:
    """Return the text across each figure of a design; empty for a design that is certified and useful.

    Parameters
    ----------
    record : record of the design
    problem : stated by the record
    """
    if record.status != "certified":
        return f"{record.status}: not for use"
    return "of little use" if _little_use(record, problem) else ""


def _little_use(record: DesignRecord, problem: Problem) -> bool:
    error = record.transparency.error if record.transparency is not None else None
    return record.idle or error is None or error >= _useless_from(problem)


def _useless_from(problem: Problem) -> float:
    """Return the error from which on a design is of little use; infinite for an impedance display."""
    if not problem.device.kind.banded:
        return inf
    return LITTLE_USE * _without_loop(problem)


def _without_loop(problem: Problem) -> float:
    return transparency_error(problem, Gains(0.0, 0.0), NOTHING).error


def _verdict(record: DesignRecord, problem: Problem) -> tuple[Kind, str, str]:
    proof, transparency = record.certificate, record.transparency
    if proof is None or transparency is None:
        kind: Kind = "bad" if record.status == "infeasible" else "doubtful"
        reason = record.reason or ("no design meets the constraints" if kind == "bad" else "no design was found")
        return kind, record.status, f"{reason[0].upper()}{reason[1:]}."
    if record.status == "violated":
        return "bad", "violated", f"Not for use: {_failed(proof, 'refuted', record.units)}."
    if record.status == "undecided":
        return "doubtful", "undecided", f"Not proved, so not for use: {_failed(proof, 'undecided', record.units)}."
    return _certified(record, transparency, problem)


def _certified(record: DesignRecord, transparency: TransparencyRecord, problem: Problem) -> tuple[Kind, str, str]:
    proved, useless = f"Proved {record.promise}", "certified, of little use"
    if isinstance(record.coupling, SpringRecord):
        wall = f"a wall may be as stiff as {text(record.coupling.stiffness, 4)} {problem.units.stiffness}"
        moved = f"in free motion the handle is {text(transparency.admittance, 3)} of Z_0 = {_reference(problem)}"
        return "good", "certified", f"{proved}; {wall}, {moved}, {_mean(problem)}."
    if (contact := record.contact) is not None and contact.stiffest_contact is not None:
        bears = f"it bears contacts of {text(contact.stiffest_contact, 7)} {problem.units.stiffness}"
        late = (
            f"the lightest drag for contacts up to {text(contact.stiffness, 7)} {problem.units.stiffness} behind "
            f"{text(1e3 * contact.latency_s, 3)} ms is {text(contact.rest_drag, 4)} {problem.units.damping}"
        )
        return "good", "certified", f"{proved}; {bears}; {late}."
    off = (
        f"the handle is off the ideal by {text(transparency.error, 3)} of Z_0 = {_reference(problem)}, "
        f"{_mean(problem)}, the device without a loop by {text(_without_loop(problem), 3)}"
    )
    if record.idle:
        idle = f"the velocity loop hardly moves the handle: |1 - G_he| is {text(transparency.tracking, 3)}"
        return "doubtful", useless, f"{proved}; but {idle}, and 1 means no loop at all."
    if _little_use(record, problem):
        return "doubtful", useless, f"{proved}; but {off}."
    return "good", "certified", f"{proved}; {off}."


def _failed(proof: CertificateRecord, verdict: str, units: Units) -> str:
    """Return the first claim with a verdict and where it fails; the certificate's own verdict if no claim has it."""
    claim = next((claim for claim in proof.claims if claim.verdict == verdict), None)
    if claim is None:
        return f"the certificate is {proof.verdict}"
    where = f" at {text(claim.witness_hz, 4)} Hz" if claim.witness_hz is not None else ""
    hand = f" in the hand of {claim.witness_hand.in_words(units)}" if claim.witness_hand is not None else ""
    safe = " (a ratio of 1 is proved, the safety factor is missed)" if proof.proved_ratio == 1 else ""
    return f"“{claim.claim}” is {verdict}{where}{hand}{safe}"


def _reference(problem: Problem) -> str:
    return f"{problem.transparency.reference_impedance:.4g} {problem.units.damping}"


def _mean(problem: Problem) -> str:
    low, high = problem.transparency.band.hz
    return f"{'in the mean' if problem.transparency.norm == 'rms' else 'at most'} from {low:.4g} to {high:.4g} Hz"


def _marks(record: DesignRecord, problem: Problem) -> list[Mark]:
    if record.transparency is None or record.transparency.error is None:
        return []
    marks = [_mark("this design", record.transparency.error)]
    if problem.device.kind.banded:
        marks += [_mark("device without a loop", _without_loop(problem))]
    found = record.optimality
    if found is not None and found.lower_bound is not None and found.terms is None:
        marks += [_mark("no design is below", found.lower_bound)]
    return marks


def _mark(label: str, error: float) -> Mark:
    return Mark(label, error, _share(error))


def _share(error: float) -> float:
    """Return a place on the scale: linear up to `LINEAR_UP_TO`, which takes three quarters of it, then ever closer."""
    placed = error if error <= LINEAR_UP_TO else LINEAR_UP_TO + 0.5 * (1 - LINEAR_UP_TO / error)
    return round(placed / (LINEAR_UP_TO + 0.5), 5)
