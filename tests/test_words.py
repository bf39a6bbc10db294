"""Names are the field's terms: what was once coined, and renamed, does not come back."""

from __future__ import annotations

import ast

import pytest
from conftest import ROOT

FILES = {
    "balls": "arb_balls",
    "baseline": "region_json",
    "enclosed": "array_claims",
    "enclosures": "array_intervals",
    "exact": "polynomials",
    "guard": "region_check",
    "leaves": "nodes",
    "least": "lower_bounds",
    "levers": "parameter_changes",
    "low_end": "near_zero",
    "outcome": "row",
    "repaired": "repair",
    "shape": "nlp_structure",
}
NAMES = {
    "Alone": "NominalProof",
    "Crew": "WorkerPool",
    "Family": "RobustDesign",
    "Floors": "LowerBounds",
    "Glance": "SearchState",
    "Least": "LeastCoupling",
    "Leaves": "OpenNodes",
    "Lever": "ParameterChange",
    "Place": "ConstraintPoint",
    "Rest": "Equilibrium",
    "Shape": "NlpStructure",
    "Share": "BoundedQuotient",
    "Tested": "Decided",
    "Trial": "RepairTest",
    "Unfinished": "ResumeState",
    "ahead": "max_pending",
    "by_law": "by_integrator",
    "conditions_over": "prove_conditions_for_all",
    "decay_mean": "phi_1, of exponential integrators",
    "decay_ramp": "phi_2, of exponential integrators",
    "counted": "objective_devices",
    "demanded": "llewellyn_demand",
    "fallen": "pruned_bound",
    "floors": "lower_bounds",
    "followed": "peak_tracked",
    "gone": "unreachable",
    "held": "with_operator",
    "lifted": "as_series",
    "march": "extend_band",
    "mends": "repairs",
    "moving": "uncertain, varied or oscillating",
    "obstacles": "plane_errors",
    "quiet_gain": "sensitivity_any_phase",
    "relief": "operator_relief",
    "rest": "equilibrium",
    "seen": "scanned",
    "slack": "one_minus_pole",
    "slots": "capacities",
    "steady": "no_pole_crosses",
    "stiffest": "model_curve_end",
    "strain": "infeasibility",
    "suspects": "retries",
    "taken": "subset",
    "told": "commanded",
    "turn": "im_C_conj_Zd, or an angle",
    "whole": "whole_samples",
}
"""Former names of files, and of classes, functions, constants and fields, each with the one in its place."""
FOLDERS = ("analysis", "design", "identification", "model", "proof", "simulation", "study")


def public_names(path):
    """Yield the names that a module gives to others: its own, and those of its functions, classes, fields,
    constants."""
    bodies = [ast.parse(path.read_text()).body]
    while bodies:
        for node in bodies.pop():
            if isinstance(node, ast.ClassDef | ast.FunctionDef):
                yield node.name
            if isinstance(node, ast.ClassDef):
                bodies.append(node.body)
            targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
            for target in targets:
                yield from (name.id for name in ast.walk(target) if isinstance(name, ast.Name)) if target else ()


@pytest.mark.parametrize("folder", FOLDERS)
def test_coined_names_do_not_come_back(folder):
    for path in sorted((ROOT / "vctune" / folder).rglob("*.py")):
        assert path.stem not in FILES, f"{path}: {FILES.get(path.stem)}"
        for name in public_names(path):
            assert name not in NAMES, f"{path}: {name}: {NAMES.get(name)}"


def test_the_scan_for_names_finds_them(tmp_path):
    path = tmp_path / "module.py"
    path.write_text("MOST, LEAST = 1, 2\nclass Rest:\n    turn: int\n    def held(self): ...\n")
    assert set(public_names(path)) == {"MOST", "LEAST", "Rest", "turn", "held"}
