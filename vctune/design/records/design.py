"""The record of a design, in SI units and hertz: each key of design.json once (document/README.md, section 3)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, replace
from math import inf, isclose, isfinite
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from vctune.analysis.demands import transparency_error
from vctune.design.judging.judge import Judgement
from vctune.design.nlp.working_set import CONSTRAINT_KINDS
from vctune.design.records.active import ActiveRecord, active
from vctune.design.records.certificate import CertificateRecord, InnerLoopRecord, certificate_record
from vctune.design.records.claims import display_of, present
from vctune.design.records.contact import CONTACT, ContactRecord, contact_record
from vctune.design.records.felt import InHandRecord, in_hand_record
from vctune.design.records.optimality import OptimalityRecord, UncertaintyRecord, optimality_record, uncertainty_record
from vctune.design.records.rest import REST, RestRecord, rest_record
from vctune.design.records.shake import SHAKES, BuzzRecord, RingingRecord, notes, shaken
from vctune.design.records.warned import warnings
from vctune.design.result import Price, Relaxation, Repair, Solved
from vctune.design.variables import touched
from vctune.document.doubts import file_doubts
from vctune.document.reading import ProblemFile, digest_mistakes, stated_problem
from vctune.document.records.gains_json import AnyCouplingRecord, ProblemRecord, TransparencyRecord, stated_units
from vctune.document.records.part import RecordPart, Row, made, rows, text
from vctune.document.text.errors import Mistake, Note
from vctune.document.text.json import SealedDocument, as_record, read_json
from vctune.model.display import DISPLAYS
from vctune.model.gains import AnyCoupling, Gains, SpringDamper
from vctune.model.numbers.units import UNITS, Units, narrowed
from vctune.model.problem import Problem
from vctune.proof.outcome import Verdict, worst_verdict
from vctune.running import OutOfTimeError, unlimited
from vctune.version import versions

MAX_BYTES = 10_000_000
KIND = "a design.json of `vctune solve`"
# Text that replaces the active constraints if the search stopped early, or if it does not solve an NLP
UNKNOWN_LIMITS = "not known: the search ended without multipliers"
SAME_PLACE = 1.05  # Greatest ratio of two frequencies that belong to the same extremum of a response
# Relative difference of two errors of a design within which they are the same on any machine
SAME_ERROR = 1e-6
# Groups of the nominal device in a problem with a box of devices, and those of their rows that are of every device
NOMINAL = frozenset({"transparency", "in the hand", "velocity loop"})
OF_WALL = frozenset({"peak |S|", "phase margin"})  # rows of the certificate that are of the nominal device
OF_EVERY_DEVICE = frozenset({"peak |S|", "unstable poles"})
# Status of a design for each verdict of its certificate
STATUSES = {"proved": "certified", "refuted": "violated", "undecided": "undecided"}


class NearestRecord(RecordPart):
    """The design that misses the constraints of a problem without a design by the least."""

    gains: Gains
    coupling: AnyCouplingRecord


class DesignRecord(SealedDocument):
    """The result of a problem, in SI units and hertz: the object of design.json."""

    SCHEMA = "vctune/design/1"
    # The parts of the record that a table shows, with their names, in the order of the table
    GROUPS: ClassVar[dict[str, str]] = {
        "gains": "gains",
        "coupling": "coupling",
        "contact": "contact",
        "transparency": "transparency",
        "felt": "in the hand",
        "rest": "at rest",
        "ringing": "ringing",
        "buzz": "kicks",
        "certificate": "certificate",
        "uncertainty": "uncertainty",
        "optimality": "optimality",
        "inner_loop": "velocity loop",
    }

    problem: ProblemRecord
    status: Literal["certified", "violated", "undecided", "infeasible"]
    reason: str | None
    gains: Gains | None
    coupling: AnyCouplingRecord | None
    transparency: TransparencyRecord | None
    certificate: CertificateRecord | None
    inner_loop: InnerLoopRecord | None
    active: list[ActiveRecord]
    proved: bool | None = None
    idle: bool = False
    repairs: list[Repair] | None = None
    rule: Literal["euler"] | None = None  # of the coupling, if it is not the trapezoidal one
    nearest: NearestRecord | None = None  # the nearest miss of a problem without a design
    tried: list[str] | None = None  # keys, each with the value up to which it was changed alone in vain
    together: list[Repair] | None = None  # two changes that suffice together, of the law if none of it does alone
    relaxations: list[Relaxation] | None = None  # what a design of little use costs, the best first
    prices: list[Price] | None = None
    contact: ContactRecord | None = None
    felt: InHandRecord | None = None
    rest: RestRecord | None = None
    ringing: RingingRecord | None = None
    buzz: BuzzRecord | None = None
    at_bound: list[str]
    warnings: list[str]
    solver: dict[str, Any] = Field(default_factory=dict)
    optimality: OptimalityRecord | None = None
    versions: dict[str, str | None]
    date: str | None = None
    uncertainty: UncertaintyRecord | None = None

    @model_validator(mode="after")
    def _whole(self) -> DesignRecord:
        """Refuse a record that has only some of the parts of a design."""
        judged: list[Any] = [self.coupling, self.transparency, self.certificate]
        looped = self.gains is not None and self.gains.closed
        judged += [self.inner_loop] if looped else []
        if any((part is None) != (self.gains is None) for part in judged):
            raise ValueError(
                "gains, coupling, transparency, certificate and inner_loop must be there, or null, together"
            )
        return self

    def contradictions(self, source: str) -> Iterator[Mistake]:
        """Yield the first parts of problem, gains, transparency, claims and status that do not belong together."""
        file = stated_problem(self.problem, source)
        if mistakes := digest_mistakes(self.problem, file):
            yield from mistakes
            return
        for key, stated, found, of in self._judged_again(file.problem):
            if stated != found:
                message = f"is {stated}, and {of} {found}: one of them was changed"
                yield Mistake("damaged-document", key, message)
                return

    def _judged_again(self, problem: Problem) -> Iterator[tuple[str, Any, Any, str]]:
        """Yield the key of a stated value, this value, the value that other keys imply, and their names."""
        if self.transparency is None or self.certificate is None or self.design is None:
            of = "without gains a problem is undecided or"
            yield "status", self.status, "undecided" if self.status == "undecided" else "infeasible", of
            return
        verdict, claims = self.certificate.verdict, self.certificate.claims
        buzzes = problem.stability.calm and verdict == "proved" and self.buzz is not None and self.buzz.moving > 0
        open_ = problem.stability.calm and verdict == "proved" and self.buzz is None
        status = "violated" if buzzes else "undecided" if open_ else STATUSES[verdict]
        yield "status", self.status, status, f"certificate.verdict, {verdict}, makes it"
        worst = worst_verdict([Verdict(claim.verdict) for claim in claims] or [Verdict.UNDECIDED]).value
        yield "certificate.verdict", verdict, worst, "the worst verdict of certificate.claims is"
        with np.errstate(all="ignore"):
            errors = asdict(transparency_error(problem, *self.design))
        for name, error in errors.items():
            stated = getattr(self.transparency, name)
            same = error == stated or not isfinite(error) or isclose(error, stated or 0.0, rel_tol=SAME_ERROR)
            yield f"transparency.{name}", stated, stated if same else error, "gains, coupling and problem.text make it"

    @property
    def units(self) -> Units:
        """The units of the record, which are the device's units."""
        return UNITS[self.problem.units]

    @property
    def promise(self) -> str:
        """The proved claims about hands in words; empty if the design is not certified."""
        if self.certificate is None or self.status != "certified":
            return ""
        without = " without unmodelled dynamics" if self.uncertainty is not None and self.uncertainty.unmodelled else ""
        hands = [f"stable{without} {self.certificate.hands.promise(self.units)}"] if self.certificate.hands else []
        band = self.certificate.band_hz
        edges = None if band is None else narrowed(*(inf if edge is None else edge for edge in band))
        place = edges and f"from {edges[0]} to {edges[1]} Hz, as far as the frequency model goes"
        alone = any(claim.id == "alone" for claim in self.certificate.claims)
        hand = self.certificate.passive_hand(self.units)
        stable = f"stable in {hand} with nothing behind" if alone else f"absolutely stable in {hand}"
        passive = [f"{stable} {place}"] if place else []
        if self.certificate.any_hand:
            passive = [f"stable{without} {self.certificate.any_hand.promise(hand)}"]
        if self.certificate.wall:
            passive = [f"stable {self.certificate.wall.promise(hand, self.units)}"]
        ratio = self.certificate.damping_ratio
        calm = [] if ratio is None else [f"every oscillation there has a damping ratio of at least {text(ratio)}"]
        return "; ".join([*hands, *passive, *calm])

    @property
    def limits(self) -> list[str]:
        """The active constraints, the greatest multiplier first, each with the frequencies at which it is active."""
        if not self.active and self.solver.get("converged") is False:
            return [UNKNOWN_LIMITS]
        prices: dict[str, float] = {}
        places: dict[str, list[float]] = {}
        for entry in self.active:
            prices[entry.demand] = prices.get(entry.demand, 0.0) + (entry.multiplier or 0.0)
            at, proved_hz = places.setdefault(entry.demand, []), self._proved_hz(entry.demand)
            if entry.hz is not None:
                hz = proved_hz if proved_hz is not None and _together(entry.hz, proved_hz) else entry.hz
                at += [] if any(_together(hz, other) for other in at) else [hz]
        dearest = sorted(prices, key=lambda demand: -prices[demand])
        texts = {demand: ", ".join(dict.fromkeys(text(hz, 4) for hz in places[demand])) for demand in dearest}
        shown = {demand: " and ".join(at.rsplit(", ", 1)) for demand, at in texts.items()}
        return [f"{demand} at {hz} Hz" if hz else demand for demand, hz in shown.items()]

    def _proved_hz(self, demand: str) -> float | None:
        """Return the frequency of the extremum that the claim of a constraint names; None if the claim names none."""
        proof, loop = self.certificate, self.inner_loop
        if proof is None:
            return None
        if demand.startswith("|S|"):
            return None if loop is None else loop.peak_sensitivity_hz
        if demand.endswith("in a hand"):
            return None if proof.hands is None else proof.hands.worst_hz
        if demand.endswith("in any passive hand"):
            return None if proof.any_hand is None else proof.any_hand.worst_hz
        same = proof.hands is not None and proof.hands.min_ratio == proof.min_ratio
        return None if same else proof.worst_hz

    @property
    def design(self) -> tuple[Gains, AnyCoupling] | None:
        """The gains and the coupling; None without a design."""
        return None if self.gains is None or self.coupling is None else (self.gains, self.coupling)

    def groups(self) -> dict[str, list[Row]]:
        """Return the rows of a design by the titles of `GROUPS`; empty without a design."""
        if self.gains is None:
            return {}
        parts = {title: getattr(self, name) for name, title in self.GROUPS.items()}
        result = {title: list(rows(part, self.units)) for title, part in parts.items() if part is not None}
        if self.uncertainty is not None:
            result["certificate"] = [row.nominal() if row.label in OF_WALL else row for row in result["certificate"]]
            for title in NOMINAL & result.keys():
                result[title] = [row if row.label in OF_EVERY_DEVICE else row.nominal() for row in result[title]]
        if self.rule == "euler":  # which has no damper in series
            law = [
                row._replace(label=row.label[:-3] + of) for row, of in zip(result["coupling"][1:], "MD", strict=True)
            ]
            result["coupling"] = [Row("rule", "euler", "M a + D v = F, stepped by Euler's rule"), *law]
        if isinstance(self.coupling, SpringDamper):  # an impedance display has no K_p
            result["gains"] = result["gains"][:1]
        if self.transparency is not None and not DISPLAYS[self.transparency.display].own_loop:
            del result["gains"]
        return result


def _together(one: float, other: float) -> bool:
    """Return whether two frequencies belong to the same extremum."""
    return max(one, other) <= SAME_PLACE * min(one, other)


def read_design(path: Path) -> DesignRecord:
    """Return the record in a design.json."""
    return design_of(read_json(path, KIND, MAX_BYTES), str(path))


def design_of(value: Any, source: str) -> DesignRecord:
    """Return the record in the object of a design.json, or a record that a program has made, if its parts belong
    together."""
    value = value.to_json() if isinstance(value, DesignRecord) else value
    return as_record(value, DesignRecord, source, kind=KIND, remedy="solve the problem again")


def design_record(file: ProblemFile, solved: Solved, ipopt: str | None = None) -> dict[str, Any]:
    """Return the JSON object of a solved problem. Every number in the object is finite or null.

    Parameters
    ----------
    file : ProblemFile
        The problem and its text.
    solved : Solved
        Its result.
    ipopt : str, optional
        Version of IPOPT if the result needed it (`vctune.design.nlp.nlp.ipopt_version`).

    Returns
    -------
    dict
        The object of design.json, in SI units and hertz.
    """
    return record_of(file, solved, ipopt).to_json()


@np.errstate(all="ignore")
def record_of(file: ProblemFile, solved: Solved, ipopt: str | None = None, date: str | None = None) -> DesignRecord:
    """Return the record of a solved problem, from which `design_record` makes the JSON object."""
    judgement, problem = solved.judgement, solved.problem
    parts: dict[str, Any] = dict.fromkeys(("gains", "coupling", "transparency", "certificate", "inner_loop"))
    at_bound, warned = list[str](), list[Note]()
    if judgement is not None:
        parts["felt"] = in_hand_record(problem, judgement)
        try:
            parts["contact"] = contact_record(problem, judgement)
        except OutOfTimeError:
            solved = replace(solved, cut=(*solved.cut, CONTACT))
        try:
            parts["ringing"], parts["buzz"] = shaken(problem, judgement)
        except OutOfTimeError:
            solved = replace(solved, cut=(*solved.cut, SHAKES))
        try:
            parts["rest"] = rest_record(problem, judgement, parts.get("buzz"))
        except OutOfTimeError:
            solved = replace(solved, cut=(*solved.cut, REST))
        with unlimited():
            parts |= _judged(problem, judgement)
            at_bound = [key for key, _ in touched(problem, judgement.gains, judgement.coupling)]
            warned = warnings(problem, judgement)
        warned += notes(parts.get("ringing"), parts.get("buzz"), problem)
    also = {
        "date": date,
        "prices": solved.prices,
        "rule": "euler" if problem.device.rule == "euler" else None,
        "tried": solved.tried or None,
        "together": solved.together or None,
        "relaxations": solved.relaxations or None,
        "nearest": _nearest(solved),
        **{name: parts.pop(name, None) for name in ("contact", "felt", "rest", "ringing", "buzz", "uncertainty")},
    }
    said = [*solved.cut_short, *solved.notes, *file_doubts(file, Path(file.source).name), *warned]
    return DesignRecord(
        problem=ProblemRecord(name=problem.name, sha256=file.sha256, text=file.text, **stated_units(problem.device)),
        status=solved.status.value,
        reason=solved.reason,
        active=active(solved),
        proved=solved.infeasibility.proved if solved.infeasibility else None,
        idle=judgement is not None and judgement.idle,
        repairs=solved.repairs,
        at_bound=at_bound,
        warnings=[note.line for note in said],
        solver=solver_record(solved),
        optimality=optimality_record(problem, solved.optimality) if solved.optimality else None,
        versions=versions(ipopt),
        **parts,
        **present(also),
    )


def _nearest(solved: Solved) -> NearestRecord | None:
    if solved.infeasibility is None or solved.infeasibility.nearest is None:
        return None
    gains, coupling = solved.infeasibility.nearest
    return NearestRecord(gains=gains, coupling=coupling)


def _judged(problem: Problem, judgement: Judgement) -> dict[str, Any]:
    gains, coupling = judgement.gains, judgement.coupling
    return {
        "gains": gains,
        "coupling": coupling,
        "transparency": TransparencyRecord(**asdict(judgement.transparency), **_apart(problem), **display_of(problem)),
        "certificate": certificate_record(problem, judgement),
        "inner_loop": made(InnerLoopRecord, judgement) if gains.closed else None,
        "uncertainty": uncertainty_record(problem, judgement),
    }


def _apart(problem: Problem) -> dict[str, Any]:
    """Return the record of the weighted terms that the error does not count; empty if it counts them all."""
    return {"apart": list(problem.apart)} if problem.apart else {}


def solver_record(solved: Solved) -> dict[str, Any]:
    """Return the record of the optimiser: starts, sizes of the NLP, and iterations; empty without an NLP."""
    if solved.polished is None or solved.scanned is None:
        return {}
    polished = solved.polished
    return {
        "name": "ipopt",
        "converged": polished.solution.converged,
        "starts": len(solved.scanned.starts),
        "optima": solved.optima,
        "variables": polished.structure.variables,
        "constraints": sum(polished.working_set.sizes())
        + 2 * polished.structure.tracked_peaks
        + polished.structure.mean_errors,
        "frequencies": dict(zip(CONSTRAINT_KINDS, polished.working_set.sizes(), strict=True)),
        "rounds": len(polished.rounds),
        "iterations": sum(each.iterations for each in polished.rounds),
    }
