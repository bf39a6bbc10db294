"""Define simulation.json, which `vctune simulate --json` prints and which a report reads."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from vctune.document.reading import parse_problem
from vctune.document.records.design_json import DesignRecord
from vctune.document.records.gains_json import AnyCouplingRecord
from vctune.document.records.part import Nullable, RecordPart
from vctune.document.text.json import SealedDocument, as_record, experiments_digest, read_json
from vctune.model.experiment import Environment
from vctune.model.gains import Gains
from vctune.model.numbers.units import UNITS, Units, UnitSystem

FILE = "simulation.json"
MAX_BYTES = 100_000_000
KIND = "a simulation.json of `vctune simulate`"


class SimulatedProblemRecord(RecordPart):
    """The problem: its name, its digest, the digest of its experiments, and the motion of its device."""

    name: str
    sha256: str
    experiments_sha256: str
    units: UnitSystem = "linear"


class FitRecord(RecordPart):
    """A number of the environment as the hand feels it: its value, the rendered value, and its standard error."""

    value: Nullable
    asked: Nullable
    standard_error: Nullable


class MetricsRecord(RecordPart):
    """The measures of one simulated run, as `vctune.simulation.metrics.Metrics` describes them; null for a measure that
    does not exist."""

    non_overlap: Nullable
    fits: dict[str, FitRecord]
    offset: Nullable
    residual: Nullable
    ripple: Nullable
    handle_energy: Nullable
    environment_energy: Nullable
    motor_energy: Nullable
    handle_deficit: Nullable
    environment_deficit: Nullable
    peak_motor: Nullable
    saturated: Nullable
    peak_force: Nullable


class SimulatedLoopRecord(RecordPart):
    """The linear sampled loop of device, hand and environment."""

    stable: bool
    spectral_radius: Nullable
    hz: float


class MotionRecord(RecordPart):
    """What the handle does beside the hand's own motion: it is calm, settles after a disturbance, or buzzes; in a hand
    that stays it rests, settles or buzzes."""

    kind: Literal["calm", "settles", "buzzes", "rests"]
    frequency_hz: Nullable = None  # frequency of an oscillation that goes on, Hz
    amplitude_m: Nullable = None  # its amplitude, m
    rests: bool | None = None  # whether the handle comes to rest; null in a hand that moves


class RunRecord(RecordPart):
    """One controller in one experiment."""

    diverged_s: Nullable  # time at which the run diverged, s; null if it did not
    metrics: MetricsRecord | None  # measures; null if the run diverged
    loop: SimulatedLoopRecord  # linear loop of this controller
    motion: MotionRecord | None = None  # what the trace does; null if the run diverged
    curve: Annotated[list[Annotated[list[float], Field(min_length=2, max_length=2)]], Field(min_length=1)]


class ExperimentRecord(RecordPart):
    """An experiment with the runs of the regular PID and of the design."""

    name: str
    environment: Environment
    axis: Literal["position", "velocity"]  # quantity of the horizontal axis of the curves
    samples: int  # number of samples of the design's run
    baseline: RunRecord | None
    design: RunRecord


class SimulationRecord(SealedDocument):
    """Simulated experiments, in SI units and hertz: the object of simulation.json."""

    SCHEMA = "vctune/simulation/1"

    problem: SimulatedProblemRecord
    gains: Gains
    coupling: AnyCouplingRecord
    experiments: Annotated[list[ExperimentRecord], Field(min_length=1)]
    versions: dict[str, str | None]
    commanded: Literal["velocity", "position"] | None = None

    @property
    def units(self) -> Units:
        """The units of the record."""
        return UNITS[self.problem.units]

    @property
    def command_unit(self) -> str:
        """The unit of the firmware's command: a force, or for a servo a velocity or a position."""
        return {"velocity": self.units.speed, "position": self.units.position, None: self.units.force}[self.commanded]

    def is_of(self, design: DesignRecord) -> bool:
        """Return whether a simulation belongs to the design and the experiments in a design.json, and used no other
        controller."""
        given = design.problem
        if self.problem.sha256 != given.sha256 or (self.gains, self.coupling) != (design.gains, design.coupling):
            return False
        experiments = parse_problem(given.text, given.name, given.name).experiments
        return self.problem.experiments_sha256 == experiments_digest(experiments)


def simulation_beside(folder: Path, design: DesignRecord) -> SimulationRecord | None:
    """Return the content of a folder's simulation.json if there is one and it belongs to a given design; else None."""
    path = folder / FILE
    if not path.exists():
        return None
    remedy = "simulate again, or remove the file"
    record = as_record(read_json(path, KIND, MAX_BYTES), SimulationRecord, str(path), kind=KIND, remedy=remedy)
    return record if record.is_of(design) else None
