"""The certificate of a design, and the margins of its velocity loop."""

from collections.abc import Iterator, Mapping
from math import degrees, log10
from typing import Annotated, Any

from vctune.analysis.margins import unstable_poles
from vctune.analysis.sampled_loop import spectral_radius
from vctune.design.judging.judge import Judgement
from vctune.design.records.claims import (
    AnyHandRecord,
    ClaimRecord,
    HandsRecord,
    WallRecord,
    any_hand_record,
    claim_records,
    display_of,
    hands_record,
    wall_record,
)
from vctune.document.records.part import DisplayPart, From, Nullable, Pair, Proof, RecordPart, Row, made, text
from vctune.model.fields import Shown
from vctune.model.hands import Hand, LeastOperator, passive_hand
from vctune.model.numbers.units import Units, finite_hertz
from vctune.model.problem import Problem
from vctune.model.worlds import OVER_LIMIT
from vctune.proof.claims.claim import ClaimId
from vctune.proof.claims.damping import DAMPING
from vctune.proof.claims.delays import delay_in_samples
from vctune.proof.claims.registry import claims_about
from vctune.proof.outcome import Outcome, Verdict, enclosed, worst_verdict


class WholeSampleRecord(RecordPart):
    """The worse verdict of a delay just below a whole number of samples and of this number, where the sensed force
    jumps. `delay` is the whole number in s."""

    verdict: Annotated[Proof, Shown("either side", "of {samples} T = {delay} s of delay, where the sensed force jumps")]
    samples: int
    delay: float


class CertificateRecord(DisplayPart):
    """The claims about a design, and the numbers that describe them."""

    # "proved" if every claim is proved
    verdict: Annotated[Proof, Shown("verdict", "{boxes} boxes"), From(lambda of: of.certificate.verdict.value)]
    band_hz: Annotated[
        Pair | None,
        Shown("band", "Hz; outside it nothing is claimed of the ratio"),
        From(lambda of: [*map(finite_hertz, of.band)] if of.band else None),
    ]
    proved_ratio: Annotated[Nullable, From(lambda of: of.certificate.proved_ratio)]
    min_ratio: Annotated[
        Nullable, Shown("{measured}", "at {worst_hz} Hz"), From(lambda of: of.min_ratio, Shown("least Re Z_c / R"))
    ]
    worst_hz: Annotated[
        Nullable, From(lambda of: finite_hertz(of.worst), Shown("where the ratio is least", of="frequency"))
    ]
    boxes: Annotated[int, From(lambda of: of.certificate.boxes)]
    claims: list[ClaimRecord]
    damping_ratio: Annotated[Nullable, From(lambda of: of.certificate.demands.damping_ratio)] = None  # demanded
    hands: HandsRecord | None = None  # claims in hands; null if the problem does not make them
    any_hand: AnyHandRecord | None = None
    wall: WallRecord | None = None
    whole_sample: WholeSampleRecord | None = None  # verdict beside a delay of a whole number of samples
    least_hand: Hand | None = None  # what the proof of any passive hand counts on in every hand; null for nothing

    def told(self, row: Row) -> Row:
        """Return the row of a least ratio with a note if it is an estimate alone."""
        labels = "unstable at", "least with walls", OVER_LIMIT, f"least {self.coupled} / R"
        if row.label in labels[:3] and row.value == "none":  # no multiple fails, at no place
            return Row(row.label, "no limit", "estimated")
        if row.label not in labels or enclosed(row.value, self.proved_ratio):
            return row
        return row._replace(unit=f"{row.unit}; estimated")

    @property
    def measured(self) -> str:
        """The name of the least ratio of all claims."""
        return f"least {self.coupled} / R" if self.hands is None else self.hands.measured

    @property
    def damped(self) -> str | None:
        """The verdict on the damping ratio; None if none is demanded."""
        return next((claim.verdict for claim in self.claims if claim.id == DAMPING.id), None)

    def passive_hand(self, units: Units) -> str:
        """Return the hands of a claim about any passive hand in words."""
        least = self.least_hand
        return passive_hand(None if least is None else LeastOperator(least.mass, least.damping), units)

    def rows(self, units: Units) -> Iterator[Row]:
        """Yield the rows, including the rows of unproved claims and, if there is a band, the rows of the band."""
        shown = list(super().rows(units))
        parts = [part for part in (self.any_hand, self.hands, self.wall) if part is not None]
        first = shown if self.band_hz is not None else shown[:1]  # the first row is the verdict
        yield from map(self.told, [*first, *(row for part in parts for row in part.rows(units))])
        yield from self.whole_sample.rows(units) if self.whole_sample else ()
        if self.damped is not None:
            yield Row("every oscillation", self.damped, f"has at least a damping ratio of {text(self.damping_ratio)}")
        for claim in self.claims:
            yield from claim.rows(units) if claim.verdict != "proved" else ()


class NyquistRecord(RecordPart):
    """Nyquist's count for the sampled loop: Z = N + P unstable poles of the closed loop."""

    N: Annotated[int | None, From(lambda of: unstable_poles(of.device, of.gains))]
    P: Annotated[int, From(lambda of: 0)]
    Z: Annotated[
        int | None,
        Shown("unstable poles", "= N + P: {N} encirclements of -1 and {P} poles of the open loop"),
        From(lambda of: 0 if of.certificate.outcomes["stable"].verdict is Verdict.PROVED else None),
    ]


def _stable(outcomes: Mapping[ClaimId, Outcome]) -> bool | None:
    """Return whether the loop is proved stable; None if that is undecided."""
    poles = [outcomes[claim].verdict for claim in claims_about("poles") if claim in outcomes]
    return False if Verdict.REFUTED in poles else None if Verdict.UNDECIDED in poles else True


def loudest(of: Any) -> float | None:
    """Return the peak of |S| of the loop that a design closes, its velocity loop or a wall's; None without one."""
    wall = of.closed_loop
    return of.peak_sensitivity if of.gains.closed else None if wall is None else wall.peak


class InnerLoopRecord(RecordPart):
    """The sampled velocity loop of a device with a loop of its own. A margin that is infinite is null."""

    stable: Annotated[bool | None, From(lambda of: _stable(of.certificate.outcomes))]
    spectral_radius: Annotated[
        Nullable, Shown("spectral radius", "{stability}"), From(lambda of: spectral_radius(of.device, of.gains))
    ]
    peak_sensitivity: Annotated[
        Nullable,
        Shown("peak |S|", "at {peak_sensitivity_hz} Hz"),
        From(loudest, Shown("peak |S|")),
    ]
    peak_sensitivity_hz: Annotated[Nullable, From(lambda of: finite_hertz(of.worst_sensitivity))]
    gain_margin_db: Annotated[Nullable, Shown("gain margin", "dB"), From(lambda of: 20 * log10(of.loop_margins.gain))]
    phase_margin_deg: Annotated[Nullable, Shown("phase margin", "deg"), From(lambda of: degrees(of.loop_margins.phase))]
    delay_margin_s: Annotated[Nullable, Shown("delay margin", "s"), From(lambda of: of.loop_margins.delay)]
    nyquist: Annotated[NyquistRecord, From(lambda of: made(NyquistRecord, of))]

    def rows(self, units: Units) -> Iterator[Row]:
        """Yield the rows, including Nyquist's count."""
        for row in super().rows(units):
            yield row if row.value != "none" else row._replace(value="no limit", unit="")
        yield from self.nyquist.rows(units)

    @property
    def stability(self) -> str:
        """The verdict on the stability of the loop, in words."""
        return {True: "stable", False: "unstable", None: "undecided"}[self.stable]


def certificate_record(problem: Problem, judgement: Judgement) -> CertificateRecord:
    """Return the record of all claims about a design."""
    return made(
        CertificateRecord,
        judgement,
        claims=claim_records(problem, judgement),
        hands=hands_record(problem, judgement),
        any_hand=any_hand_record(problem, judgement),
        wall=wall_record(problem, judgement),
        whole_sample=_whole_sample(problem, judgement),
        least_hand=_least_hand(problem),
        **display_of(problem),
    )


def _least_hand(problem: Problem) -> Hand | None:
    """Return what the proof of any passive hand counts on in every hand; None for nothing."""
    least = problem.device.counted_on if problem.passive or problem.any_hand else None
    return None if least is None else Hand(least.mass, least.damping, 0.0)


def _whole_sample(problem: Problem, judgement: Judgement) -> WholeSampleRecord | None:
    """Return the record of the design with a delay of a whole number of samples, if the delay is near such a value."""
    if not (beside := judgement.certificate.beside):
        return None
    verdict, samples = worst_verdict(each.verdict for each in beside), round(delay_in_samples(problem.device))
    delay = float(f"{samples * problem.device.sample_time:.15g}")
    return WholeSampleRecord(verdict=verdict.value, samples=samples, delay=delay)
