"""vctune against what a user would pick instead: the same problems, the same starts, the same judges."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf, nan
from statistics import median
from time import process_time

from vctune.bench import paper, peers
from vctune.bench.benchmark import Measured, Size, Tick
from vctune.bench.dense import Dense, Stopped, casadi_solve, compiled_solver, dense
from vctune.bench.evaluator import spectral_radius
from vctune.bench.judged import Worth, worth
from vctune.bench.problems import reference_problems
from vctune.bench.timing import timed
from vctune.design.judge import Status
from vctune.design.optimum import WORTH_POLISHING
from vctune.design.scan import ScanResult, scan
from vctune.design.solve import solve
from vctune.design.start import Start
from vctune.design.units import dimensionless
from vctune.document.problem import Problem
from vctune.model.quantities import Coupling, Gains
from vctune.report.benchmarks import Panel, Series

GRID, COARSE, COARSEST = 2000, 1000, 200
"""Frequencies for Llewellyn's conditions, and as many for |S|: for most peers, for the slower and the slowest ones."""
RESERVE = 1e-5
"""Sharpening of the peers' demands on `GRID`, about what they miss between neighbours; grows as the spacing squared."""
MET = 1e-6
"""A violation on the grid up to which a peer's answer counts as one."""
REPEATS, SLOW = 5, 1.0
"""Pairs of a solver and vctune, and the seconds from which there is one only."""
OURS, MULTISTART = "vctune", "SciPy SLSQP"
AIM = 1 / 3
"""Share of the multi-start's time that a certified design should take at most."""
LEAST_GAP = 1e-7
Work = Callable[[Dense, int], "Stopped | tuple[Stopped, float]"]


@dataclass(frozen=True, slots=True)
class Peer:
    """A solver.

    Attributes
    ----------
    name, count : how it is called, and frequencies of each kind in its grid
    work : what it does with a problem; Octave counts its own time
    slow : whether it is left out where there is little time
    everywhere : whether it needs no starts but bounds
    compiles : name of the CasADi solver that is compiled before, if it is one
    """

    name: str
    count: int
    work: Work
    slow: bool = False
    everywhere: bool = False
    compiles: str | None = None


@dataclass(frozen=True, slots=True)
class Row:
    """One solver on one problem.

    Attributes
    ----------
    grid : frequencies of each kind; 0 for vctune, which chooses
    seconds : median processor time to its result, its functions compiled before; vctune's has the scan for the starts
        and the proof in it, the others' has not
    pace : vctune's time over the solver's, median of pairs measured one after the other
    starts, unstable : starts that it was run from, and how many answers it gave whose sampled loop is unstable
    error, gap : transparency error, and by what share it is above the best proved one of all solvers
    violation : relative, anywhere
    stable, verdict, consistent : see `vctune.bench.judged.Worth`
    """

    problem: str
    solver: str
    grid: int
    seconds: float
    pace: float
    starts: int
    unstable: int
    error: float
    gap: float
    violation: float
    stable: bool
    verdict: str
    consistent: bool


def _casadi(label: str, name: str, *, slow: bool = False) -> Peer:
    return Peer(label, GRID, lambda given, seed: casadi_solve(given, name), slow, compiles=name)


def all_peers(*, quick: bool) -> list[Peer]:
    """Return the peers that there are on this machine; the slow ones only without `quick`."""
    found = [
        Peer(MULTISTART, GRID, peers.slsqp),
        Peer("SciPy SLSQP, differences", GRID, peers.slsqp_differences),
        Peer("NLopt SLSQP", GRID, peers.nlopt_slsqp),
        _casadi("CasADi sqpmethod", "sqpmethod"),
        _casadi("IPOPT, dense grid", "ipopt"),
        _casadi("CasADi fatrop", "fatrop", slow=True),
        Peer("paper: SciPy BFGS", COARSE, paper.bfgs),
        Peer("SciPy trust-constr", COARSE, peers.trust_constr, slow=True),
        Peer("SciPy COBYQA", COARSEST, peers.cobyqa, slow=True),
        Peer("SciPy diff. evolution", COARSEST, peers.differential_evolution, slow=True, everywhere=True),
    ]
    if paper.octave():
        found.append(Peer("Octave sqp", COARSE, paper.octave_sqp, slow=True))
        found.append(Peer("paper: Octave fminunc", COARSE, paper.octave_fminunc, slow=True))
    return [peer for peer in found if not (quick and peer.slow)]


def measure(size: Size, tick: Tick) -> Measured:
    """Run every solver on the reference problems."""
    peers.need("scipy", "nlopt")
    rows: list[Row] = []
    for name, problem in reference_problems(1 if size.quick else None).items():
        rows += _problem_rows(name, problem, size, tick)
    return Measured(
        "vctune against other solvers",
        "Gap to the best proved error against processor time, one point a problem, for answers that are proved and for "
        f"those that are not; a gap below {LEAST_GAP:g} lies on the dotted line, as do those of answers that seem "
        "better than the best because they violate a demand.",
        {"solvers": rows},
        facts(rows),
        panels(rows),
    )


def _problem_rows(name: str, problem: Problem, size: Size, tick: Tick) -> list[Row]:
    tick(f"{name}: {OURS}")
    scaled = dimensionless(problem)
    seen = scan(scaled)
    rows = [_ours(name, problem)]
    for peer in all_peers(quick=size.quick):
        tick(f"{name}: {peer.name}")
        rows.append(_theirs(name, problem, scaled, seen, peer, size.seed))
    proved = [row.error for row in rows if row.verdict == Status.CERTIFIED]
    best = min(proved, default=nan)
    return [replace(row, gap=row.error / best - 1) for row in rows]


def _ours(name: str, problem: Problem) -> Row:
    solve(problem)
    solved, seconds = timed(lambda: solve(problem), REPEATS)
    assert solved.judgement is not None
    found = worth(problem, solved.judgement.gains, solved.judgement.coupling)
    return _row(name, OURS, 0, seconds, 1.0, solved.optima, 0, found)


def _theirs(name: str, problem: Problem, scaled: Problem, seen: ScanResult, peer: Peer, seed: int) -> Row:
    posed = [
        dense(problem, scaled, start, peer.count, RESERVE * (GRID / peer.count) ** 2) for start in _starts(seen, peer)
    ]
    for given in posed:
        given.evaluated(1)
        if peer.compiles:
            compiled_solver(peer.compiles, given.shape)
    times: list[float] = []
    paces = []
    while not times or (len(times) < REPEATS and times[0] < SLOW):
        answers, seconds = _multistart(posed, seen, peer, seed)
        times.append(seconds)
        paces.append(timed(lambda: solve(problem))[1] / seconds)
    design = min(answers, key=lambda answer: answer.rank).design
    unstable = sum(not answer.stable for answer in answers)
    found = worth(problem, *design)
    return _row(name, peer.name, peer.count, median(times), median(paces), len(answers), unstable, found)


def _starts(seen: ScanResult, peer: Peer) -> list[Start]:
    """Return the starts that vctune's own search would polish; for a global solver the first with and without K_p."""
    workable = [start for start in seen.starts if start.admissible] or seen.starts[:2]
    if not peer.everywhere:
        return workable
    faces = {start.gains.position > 0: start for start in reversed(workable)}
    return list(faces.values())


@dataclass(frozen=True, slots=True)
class _Answer:
    design: tuple[Gains, Coupling]
    error: float
    missed: float
    stable: bool

    @property
    def rank(self) -> tuple[bool, float]:
        """Answers that meet their grid in a stable loop first, best first; then by how much is missed."""
        good = self.missed <= MET and self.stable
        return (not good, self.error if good else self.missed + 1e3 * (not self.stable))


def _multistart(posed: list[Dense], seen: ScanResult, peer: Peer, seed: int) -> tuple[list[_Answer], float]:
    """Run a peer from every start that can still win; return its answers and the processor time, s."""
    answers: list[_Answer] = []
    elsewhere, began = 0.0, process_time()
    for given, start in zip(posed, _starts(seen, peer), strict=True):
        good = [answer.error for answer in answers if not answer.rank[0]]
        if start.error > WORTH_POLISHING * min(good, default=inf):
            continue
        found = peer.work(given, seed)
        if isinstance(found, tuple):
            found, seconds = found
            elsewhere += seconds
        f, g = given.values(found.z)
        design = given.design(found.z)
        stable = spectral_radius(given.problem.device, design[0]) < 1
        answers.append(_Answer(design, float(f[0]), max(0.0, -float(g.min())), stable))
    return answers, process_time() - began + elsewhere


def _row(
    name: str, solver: str, grid: int, seconds: float, pace: float, starts: int, unstable: int, found: Worth
) -> Row:
    return Row(
        name, solver, grid, seconds, pace, starts, unstable, found.error, nan, found.violation, found.stable,
        found.verdict.value, found.consistent,
    )  # fmt: skip


CLOSE = 1e-3


def facts(rows: list[Row]) -> list[str]:
    """Say who wins where, and what becomes of the rest."""
    said = []
    said.append(
        f"Prover and independent evaluator contradict each other {sum(not row.consistent for row in rows)} times."
    )
    for solver in dict.fromkeys(row.solver for row in rows if row.solver != OURS):
        own = [row for row in rows if row.solver == solver]
        good = [row for row in own if row.verdict == Status.CERTIFIED and row.gap <= CLOSE]
        faster = [row for row in good if row.pace > 1]
        aim = f", aim {AIM:.2f}" if solver == MULTISTART else ""
        unproved = sum(row.verdict != Status.CERTIFIED for row in own)
        said.append(
            f"{solver}: as good as the best (within {CLOSE:.1%}) and proved on {len(good)} of {len(own)} problems, "
            f"faster than vctune on {len(faster)} of these; {unproved} answers are not proved; vctune takes "
            f"{median(row.pace for row in own):.2f} of its time (median over the problems{aim}; "
            f"{min(row.pace for row in own):.2g} to {max(row.pace for row in own):.2g})."
        )
    better = [row for row in rows if row.solver == OURS and row.gap > LEAST_GAP]
    said.append(f"Problems on which a peer's proved error is lower than vctune's: {_named(better)}.")
    return said


def _named(rows: list[Row]) -> str:
    return ", ".join(f"{row.problem} (by {row.gap:.2g})" for row in rows) or "none"


def panels(rows: list[Row]) -> list[Panel]:
    """Draw gap against run time, the proved answers apart from the rest."""
    drawn = []
    for title, proved in (("proved", True), ("not proved", False)):
        series = []
        for solver in dict.fromkeys(row.solver for row in rows):
            own = [row for row in rows if row.solver == solver and (row.verdict == Status.CERTIFIED) == proved]
            series.append(Series(solver, [row.seconds for row in own], [row.gap for row in own]))
        drawn.append(Panel(title, "processor time, s", "gap to the best proved error", series, LEAST_GAP))
    return drawn
