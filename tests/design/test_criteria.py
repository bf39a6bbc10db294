"""What `solve` says that one criterion alone would allow is what solving the same file with it gives."""

from __future__ import annotations

import pytest
from conftest import DEVICE, mostly_slow

import vctune

FILES = {
    "drag free with both, absent with passive": DEVICE,
    "drag fixed": DEVICE + "[coupling]\ndrag = 2.0\n",
    "drag fixed, and gains": DEVICE + "[coupling]\ndrag = 2.0\n[gains]\nvelocity = 200.0\nposition = 9000.0\n",
}


def stated(text, criterion):
    return f'{text}[stability]\ncriterion = "{criterion}"\n'


@pytest.mark.parametrize("name", mostly_slow(FILES, ["drag free with both, absent with passive"]))
def test_one_criterion_alone_is_compared_as_the_file_states_it(tmp_path, name):
    errors = {}
    for criterion in ("both", "passive", "hands"):
        path = tmp_path / f"{criterion}.toml"
        path.write_text(stated(FILES[name], criterion))
        errors[criterion] = vctune.solve(path)
    said = {each.criterion: each.error for each in errors["both"].alternatives}
    for criterion in ("passive", "hands"):
        alone = errors[criterion].judgement
        assert (criterion in said) == (alone is not None)
        if alone is not None:
            assert said[criterion] == pytest.approx(alone.error, rel=1e-3)


@pytest.mark.slow
def test_a_criterion_that_contradicts_the_file_is_left_out(tmp_path):
    """Nothing is proved of unmodelled dynamics in hands alone."""
    text = DEVICE + "[uncertainty]\nunmodelled = [[10.0, 1e-4], [400.0, 0.001]]\n"
    (tmp_path / "device.toml").write_text(stated(text, "both"))
    solved = vctune.solve(tmp_path / "device.toml")
    assert solved.status == "certified" and [each.criterion for each in solved.alternatives] == ["passive"]
