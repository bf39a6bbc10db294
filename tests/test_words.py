"""Names are the field's terms: what was once coined, and renamed, does not come back."""

from __future__ import annotations

import ast

import pytest
from conftest import ROOT

BANNED = {
    "alone": "a proof of the nominal device is a NominalProof",
    "balls": "Arb's balls are in arb_balls",
    "conditions_over": "prove_conditions_for_all",
    "decay_mean": "phi_1, of exponential integrators",
    "decay_ramp": "phi_2, of exponential integrators",
    "demanded": "llewellyn_demand",
    "enclosed": "claims on arrays are in array_claims",
    "enclosures": "intervals on arrays are in array_intervals",
    "exact": "polynomials with rational coefficients are in polynomials",
    "family": "a design on a box of devices is a RobustDesign",
    "floors": "LowerBounds, lower_bounds",
    "least": "lower bounds are in lower_bounds",
    "lag": "the loop's is loop_lag; the hold's is HoldResponse.lag",
    "lifted": "as_series",
    "low_end": "the proof next to omega = 0 is in near_zero",
    "march": "extend_band",
    "moving": "uncertain, varied or oscillating",
    "quiet_gain": "sensitivity_any_phase",
    "relief": "operator_relief",
    "rest": "equilibrium",
    "slack": "one_minus_pole",
    "steady": "no_pole_crosses",
    "stiffest": "model_curve_end",
    "strain": "infeasibility",
    "taken": "subset",
    "tested": "Decided",
    "turn": "im_C_conj_Zd, or an angle",
}
"""Former names of files, classes, functions, constants and fields, and what says what they are."""
FOLDERS = ("analysis", "model", "proof", "simulation")
ALLOWED = {("model/loop.py", "lag"), ("proof/box_tests.py", "tested")}
"""The one that the rule itself names, and the private class of a test."""


def public_names(path):
    """Yield the names that a module gives to others: its own, and those of its functions, classes, fields,
    constants."""
    yield path.stem
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
        place = str(path.relative_to(ROOT / "vctune"))
        for name in public_names(path):
            if (place, name) not in ALLOWED:
                assert name.lower() not in BANNED, f"{place}: {name}: {BANNED[name.lower()]}"


def test_the_scan_for_names_finds_them(tmp_path):
    path = tmp_path / "held.py"
    path.write_text("MOST, LEAST = 1, 2\nclass Rest:\n    turn: int\n    def lag(self): ...\n")
    assert set(public_names(path)) == {"held", "MOST", "LEAST", "Rest", "turn", "lag"}
