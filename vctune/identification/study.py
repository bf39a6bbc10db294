"""What a fit of one recording returns, whatever was recorded (README, section 5)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from vctune.document.recording import Floats, Recording
from vctune.document.records.identification_json import CandidateRecord, Estimate, NumberRecord, RecordingRecord
from vctune.document.text.errors import Note
from vctune.identification.responses import Lines


@dataclass(frozen=True, slots=True)
class Curves:
    """A measured signal over time, and the fit of it."""

    time: Floats
    measured: Floats
    fitted: Floats


@dataclass(frozen=True, slots=True)
class Study:
    """A recording with its fit."""

    recording: Recording
    record: RecordingRecord  # what identification.json and the page say of it
    estimates: list[Estimate]  # of the parameters that a problem file states
    lines: list[Lines] = field(default_factory=list)
    curves: Curves | None = None
    remarks: list[Note] = field(default_factory=list)
    friction: float | None = None  # Coulomb friction, N; None if none was found
    force_noise: float | None = None  # standard deviation of a sample of the hand's sensed force, N
    servo_orders: dict[int, float] = field(default_factory=dict)  # -2 log likelihood by the order of a servo


# Keys of [device] by the numbers of a mechanism's fit
KEYS = {
    "mass": "mass",
    "damping": "damping",
    "delay": "delay",
    "lag": "actuator.bandwidth_hz",
    "sensor_delay": "force_sensor.delay",
    "handle_mass": "structure.handle_mass",
    "frequency_hz": "structure.frequency_hz",
    "damping_ratio": "structure.damping_ratio",
}


def number(name: str, value: float, sigma: float | None = None) -> NumberRecord:
    """Return a number of the record."""
    return NumberRecord(name=name, value=float(value), sigma=None if sigma is None else float(sigma))


def record_of(recording: Recording, sample_time: float, **found: Any) -> RecordingRecord:
    """Return the record of a recording; what the kind of fit does not have is empty."""
    found = {"derived": [], "candidates": [], "remarks": []} | found
    known: dict[str, Any] = {"source": recording.name, "sha256": recording.sha256, "samples": len(recording)}
    return RecordingRecord(**known, sample_time=sample_time, **found)


def of_orders(
    name: str, fits: Sequence[tuple[int, float, float]], *, known: bool
) -> tuple[list[CandidateRecord], list[Note]]:
    """Return the candidates of a servo, and a remark unless its order is known; `fits` are orders, costs and shares of
    the motion that is left, the likelier first."""
    best = fits[0][1]
    candidates = [
        CandidateRecord(structure=f"order {order}", chosen=i == 0, chi2=cost / best, model_error=[share])
        for i, (order, cost, share) in enumerate(fits)
    ]
    text = f"{name}: orders 1 and 2 explain it equally well: the box contains both, and unmodelled covers the rest"
    return candidates, [] if known else [Note("remark-order", text)]
