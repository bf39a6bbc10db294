"""vctune: the most transparent gains of a haptic device that are proved absolutely stable."""

from __future__ import annotations

from vctune.version import __version__

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

    from vctune.design.judge import Judgement as Judgement
    from vctune.design.judge import Status as Status
    from vctune.design.judge import judge as judge
    from vctune.design.record import design_record as design_record
    from vctune.design.result import Solved as Solved
    from vctune.design.solve import solve as solve
    from vctune.document.errors import InputError as InputError
    from vctune.document.problem import Problem as Problem
    from vctune.document.reading import ProblemFile as ProblemFile
    from vctune.document.reading import read_problem as read_problem
    from vctune.exits import ExitCode as ExitCode
    from vctune.model.quantities import Coupling as Coupling
    from vctune.model.quantities import Device as Device
    from vctune.model.quantities import Gains as Gains
    from vctune.proof.certificate import Certificate as Certificate
    from vctune.proof.certificate import certify as certify
    from vctune.simulation.experiment import Simulated as Simulated
    from vctune.simulation.experiment import simulate as simulate


_HOME = {
    "Certificate": "proof.certificate",
    "Coupling": "model.quantities",
    "Device": "model.quantities",
    "ExitCode": "exits",
    "Gains": "model.quantities",
    "InputError": "document.errors",
    "Judgement": "design.judge",
    "Problem": "document.problem",
    "ProblemFile": "document.reading",
    "Simulated": "simulation.experiment",
    "Solved": "design.result",
    "Status": "design.judge",
    "certify": "proof.certificate",
    "design_record": "design.record",
    "judge": "design.judge",
    "read_problem": "document.reading",
    "simulate": "simulation.experiment",
    "solve": "design.solve",
}
"""Public names and the modules that define them, imported when first used: `import vctune` stays cheap."""

__all__ = ["__version__", *_HOME]  # noqa: PLE0604


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'vctune' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"vctune.{_HOME[name]}"), name)
