"""vctune: the most transparent gains of a haptic device that are proved stable."""

from __future__ import annotations

from vctune.version import __version__

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

    from vctune.analysis.responses import Loop as Loop
    from vctune.api.bounding import Bounded as Bounded
    from vctune.api.bounding import bound as bound
    from vctune.api.checking import check as check
    from vctune.api.checking import check_region as check_region
    from vctune.api.comparing import Comparison as Comparison
    from vctune.api.comparing import compare as compare
    from vctune.api.explaining import Explanation as Explanation
    from vctune.api.explaining import explain as explain
    from vctune.api.exporting import Exported as Exported
    from vctune.api.exporting import export as export
    from vctune.api.exporting import write_export as write_export
    from vctune.api.feeling import felt_impedance as felt_impedance
    from vctune.api.identifying import Identification as Identification
    from vctune.api.identifying import identify as identify
    from vctune.api.identifying import write_identification as write_identification
    from vctune.api.regions import AdmissibleGains as AdmissibleGains
    from vctune.api.regions import region as region
    from vctune.api.simulating import Simulation as Simulation
    from vctune.api.simulating import simulate as simulate
    from vctune.api.solving import solve as solve
    from vctune.api.solving import write_design as write_design
    from vctune.api.solving import write_report as write_report
    from vctune.api.sweeping import Swept as Swept
    from vctune.api.sweeping import sweep as sweep
    from vctune.design.check import Checked as Checked
    from vctune.design.judging.judge import Judgement as Judgement
    from vctune.design.judging.judge import Status as Status
    from vctune.design.judging.judge import judge as judge
    from vctune.design.records.design import design_record as design_record
    from vctune.design.result import Solved as Solved
    from vctune.document.building import Device as Device
    from vctune.document.building import ProblemSource as ProblemSource
    from vctune.document.building import problem as problem
    from vctune.document.reading import ProblemFile as ProblemFile
    from vctune.document.reading import read_problem as read_problem
    from vctune.document.text.errors import InputError as InputError
    from vctune.exit_codes import ExitCode as ExitCode
    from vctune.model.experiment import Experiment as Experiment
    from vctune.model.gains import Coupling as Coupling
    from vctune.model.gains import Gains as Gains
    from vctune.model.gains import SpringDamper as SpringDamper
    from vctune.model.hands import Hand as Hand
    from vctune.model.hands import LeastOperator as LeastOperator
    from vctune.model.parts import Actuator as Actuator
    from vctune.model.parts import ForceSensor as ForceSensor
    from vctune.model.parts import Structure as Structure
    from vctune.model.parts import VelocityEstimate as VelocityEstimate
    from vctune.model.problem import Problem as Problem
    from vctune.model.problem import Range as Range
    from vctune.proof.certificate import Certificate as Certificate
    from vctune.proof.certificate import certify as certify
    from vctune.report.panels import draw_error as draw_error
    from vctune.report.panels import draw_impedance as draw_impedance
    from vctune.report.panels import draw_nyquist as draw_nyquist
    from vctune.report.panels import draw_ratio as draw_ratio
    from vctune.report.panels import draw_required as draw_required
    from vctune.simulation.two_runs import Simulated as Simulated


# Public names and modules that contain them, imported when first used: `import vctune` stays cheap
_HOME = {
    "Actuator": "model.device",
    "AdmissibleGains": "api.regions",
    "Bounded": "api.bounding",
    "Certificate": "proof.certificate",
    "Checked": "design.check",
    "Comparison": "api.comparing",
    "Coupling": "model.gains",
    "Device": "document.building",
    "ExitCode": "exit_codes",
    "Experiment": "model.experiment",
    "Explanation": "api.explaining",
    "Exported": "api.exporting",
    "ForceSensor": "model.device",
    "Gains": "model.gains",
    "Hand": "model.hands",
    "Identification": "api.identifying",
    "InputError": "document.text.errors",
    "Judgement": "design.judging.judge",
    "LeastOperator": "model.hands",
    "Loop": "analysis.responses",
    "Problem": "model.problem",
    "ProblemFile": "document.reading",
    "ProblemSource": "document.building",
    "Range": "model.problem",
    "Simulated": "simulation.two_runs",
    "Simulation": "api.simulating",
    "Solved": "design.result",
    "SpringDamper": "model.gains",
    "Status": "design.judging.judge",
    "Structure": "model.device",
    "Swept": "api.sweeping",
    "VelocityEstimate": "model.device",
    "bound": "api.bounding",
    "certify": "proof.certificate",
    "check": "api.checking",
    "check_region": "api.checking",
    "compare": "api.comparing",
    "design_record": "design.records.design",
    "draw_error": "report.panels",
    "draw_impedance": "report.panels",
    "draw_nyquist": "report.panels",
    "draw_ratio": "report.panels",
    "draw_required": "report.panels",
    "explain": "api.explaining",
    "export": "api.exporting",
    "felt_impedance": "api.feeling",
    "identify": "api.identifying",
    "judge": "design.judging.judge",
    "problem": "document.building",
    "read_problem": "document.reading",
    "region": "api.regions",
    "simulate": "api.simulating",
    "solve": "api.solving",
    "sweep": "api.sweeping",
    "write_design": "api.solving",
    "write_export": "api.exporting",
    "write_identification": "api.identifying",
    "write_report": "api.solving",
}

__all__ = ["__version__", *_HOME]  # noqa: PLE0604


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'vctune' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"vctune.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return __all__
