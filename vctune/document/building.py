"""Make problems and designs from the data that a program passes: a path, tables, or the objects themselves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, is_dataclass
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from vctune.analysis.responses import Loop
from vctune.document.reading import (
    GAINS_DOCUMENTS,
    GainsFile,
    ProblemFile,
    called,
    problem_at,
    problem_of_gains,
    read_gains,
    read_problem,
)
from vctune.document.schema.problem_schema import ProblemDocument
from vctune.document.schema.rules import impossible_parts
from vctune.document.schema.statement import device_table, statement
from vctune.document.schema.validation import examined, refusal, shown
from vctune.document.text.errors import InputError
from vctune.document.text.toml import toml_text, unlisted
from vctune.model import device as devices
from vctune.model.display import ADMITTANCE, DISPLAYS, STEPPED, Display
from vctune.model.fields import table_of, with_plain_signature
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.hands import Hand
from vctune.model.problem import Problem

# A problem: the path of its file, the file's tables, or the problem itself
ProblemSource = str | Path | Mapping[str, Any] | Problem | ProblemFile
DesignSource = Gains | GainsFile | str | Path  # A design: the path of a gains file, the file itself, or gains


@with_plain_signature
@dataclass(frozen=True, slots=True, repr=False)
class Device(devices.Device):
    """An admittance or impedance display as a user states it, with the checks of the [device] table of a problem file.

    The tables of a problem state a servo.

    Attributes
    ----------
    mass : float
        Moving mass, kg.
    damping : float
        Viscous damping, N s/m.
    sample_time : float
        Sample time of the firmware, s.
    delay : float
        Delay from sampling to actuation in addition to the hold, s.
    hold : str
        "zoh", the exact zero-order hold, or "lag", the first-order lag 2/(2 + sT).
    operator : LeastOperator, optional
        The least operator, a load that is always at the handle; None if the handle may be free.
    velocity, actuator, force_sensor, structure : optional
        Parts of the device (`vctune.model.parts`); None for a part that is absent or ideal.
    display : str
        "admittance" or "impedance".
    servo, unmodelled : None
        Other values are refused.
    units : str
        "linear", or "rotary" with kg m2, N m s/rad and so on instead of kg and N s/m.

    Raises
    ------
    InputError
        If a value is not a number or out of range, or if two values contradict each other.
    """

    def loop(self, gains: Gains, coupling: AnyCoupling | None = None, hand: Hand | None = None) -> Loop:
        """Return the device's sampled loop with given gains, for arrays, state space and python-control.

        Parameters
        ----------
        gains : Gains
            Gains of the velocity loop; for an impedance display K_p is 0.
        coupling : AnyCoupling, optional
            Coupling, for Z_c; None if Z_c is not needed.
        hand : Hand, optional
            Hand at the handle; None for a device without a hand.
        """
        return Loop(self, gains, coupling, hand)

    def __post_init__(self) -> None:
        _, faults = examined(ProblemDocument, {"device": plain(self)}, impossible_parts)
        if faults:
            raise refusal([fault._replace(path=fault.path[1:]) for fault in faults], None, "Device")


def problem(source: ProblemSource) -> ProblemFile:
    """Return a problem, read from a file or built from data.

    Parameters
    ----------
    source : ProblemSource
        Path of a problem file; its tables as a dict, `{"device": {"mass": 0.4, ...}, ...}`, whose numbers may
        be NumPy's and whose tables may be `Device`, `Range` and so on; or a `Problem`, changed with
        `dataclasses.replace`.

    Returns
    -------
    ProblemFile
        The `problem` with all defaults filled in, and the `text` that states it.

    Raises
    ------
    InputError
        If the problem is invalid; the error lists the mistakes (`refusal`) with dotted key, value and remedy, and with
        the line if there is a file.
    """
    if isinstance(source, ProblemFile):
        return source
    if isinstance(source, str | Path):
        return read_problem(source)
    if not isinstance(source, Mapping | Problem):
        message = f"{shown(source)} states none; give the path of a problem file, or its tables as a dict"
        raise InputError.of("problem", "bad-option", message)
    document = statement(source) if isinstance(source, Problem) else unlisted(plain(source))
    if isinstance(source, Mapping) and (operator := getattr(source.get("device"), "operator", None)) is not None:
        document["operator"] = plain(operator)  # that of a `Device` has a table of its own
    posed, faults = problem_at(document, "problem")
    if posed is None:
        raise refusal(faults, None, "problem")
    return ProblemFile(posed, toml_text(document))


def design(gains: DesignSource | None, coupling: AnyCoupling | None = None, kind: Display = ADMITTANCE) -> GainsFile:
    """Return a design, read from a file or built from gains and coupling; of a servo, which has no gains, from the
    coupling alone."""
    if isinstance(gains, GainsFile) and coupling is None:
        return gains
    if isinstance(gains, str | Path) and coupling is None:
        return read_gains(gains)
    if gains is None and not any(key.startswith("gains.") for key in kind.stated):
        gains = Gains(0.0, 0.0)
    if not (isinstance(gains, Gains) and isinstance(coupling, AnyCoupling)):
        message = "is no design; give the path of a gains file, or Gains(...) and Coupling(...) or SpringDamper(...)"
        raise InputError.of("design", "bad-option", message)
    if not isinstance(coupling, kind.coupling):
        kind = next(display for display in DISPLAYS.values() if isinstance(coupling, display.coupling))
    stated = {"gains": plain(gains), "coupling": plain(coupling)}
    for key in kind.absent:
        table, _, name = key.partition(".")
        usual = inf if table == "coupling" else 0
        if stated[table].pop(name) != usual:
            message = f"{key}: {called(kind.name)} has none; leave it at {usual}"
            raise InputError.of("design", "contradiction", message)
    if kind is STEPPED:
        stated["coupling"]["rule"] = "euler"
    raw = {table: numbers for table, numbers in stated.items() if numbers}
    _, faults = examined(GAINS_DOCUMENTS[kind.name], raw)
    if faults:
        raise refusal(faults, None, "design")
    gains = Gains(**{"velocity": 0.0, "position": 0.0, **raw.get("gains", {})})
    return GainsFile(kind, gains, coupling, None, None, toml_text(raw))


def design_for(
    file: ProblemFile, gains: DesignSource | None, coupling: AnyCoupling | None = None
) -> tuple[ProblemFile, GainsFile]:
    """Return a design, read from a file or built from gains and coupling, after the problem in whose rule it is
    stated."""
    stated = design(gains, coupling, file.problem.device.kind)
    return problem_of_gains(file, stated), stated


def plain(value: Any) -> Any:
    """Return a value in TOML's types: objects become tables without None, NumPy's numbers become Python's."""
    if is_dataclass(value) and not isinstance(value, type):
        value = device_table(value) if isinstance(value, devices.Device) else table_of(value)
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items() if entry is not None}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    return value.tolist() if isinstance(value, np.generic | np.ndarray) else value
