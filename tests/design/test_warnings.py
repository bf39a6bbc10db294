"""What `--strict` fails on has a remedy that works: each warning is gone once its page was followed."""

from __future__ import annotations

import pytest
from command import run
from conftest import DEVICE, FIXED

from vctune.document.text.errors import ENDING
from vctune.exit_codes import ExitCode

PASSIVE = '[stability]\ncriterion = "passive"\n'
BOUNDED = "[gains]\nvelocity = { min = 1.0, max = 200.0 }\n"


def warned(text, folder):
    """Solve a problem strictly; return the codes of its warnings, having seen that they and the exit code agree."""
    (folder / "device.toml").write_text(text)
    done = run("solve", "device.toml", "--strict", cwd=folder)
    codes = {ENDING.search(line)[1] for line in done.stdout.splitlines() if line.startswith("warning: ")}
    assert done.returncode == (ExitCode.FAILED if codes else ExitCode.OK), done
    return codes


def test_three_numbers_are_solved_strictly_but_for_how_they_ring(tmp_path):
    """Which hands that damp do away with."""
    assert warned(DEVICE, tmp_path) == {"warn-rings"}
    assert warned(DEVICE + "[operator]\ndamping = { min = 20.0, max = 30.0 }\n", tmp_path) == set()


@pytest.mark.parametrize(
    "remedy",
    [
        PASSIVE.replace("passive", "both"),
        pytest.param(PASSIVE.replace("passive", "hands"), marks=pytest.mark.slow),
        pytest.param(PASSIVE + "band_hz = [0.0, 500.0]\n", marks=pytest.mark.slow),
    ],
    ids=["both", "hands", "all frequencies"],
)
def test_a_design_at_the_edge_of_its_band_is_warned_of_with_passive_alone(tmp_path, remedy):
    """Not where the claim in hands, which has no band, is proved too, nor where the band ends at half the rate."""
    assert warned(DEVICE + PASSIVE, tmp_path) == {"warn-band-edge"}
    assert "warn-band-edge" not in warned(DEVICE + remedy, tmp_path)


@pytest.mark.parametrize(
    "remedy",
    [("max = 200.0", "max = 2000.0"), pytest.param(("{ min = 1.0, max = 200.0 }", "200.0"), marks=pytest.mark.slow)],
    ids=["a wider range", "a number in its place"],
)
def test_a_number_on_a_bound_is_warned_of_until_the_bound_is_wider_or_no_range(tmp_path, remedy):
    assert "warn-bound" in warned(DEVICE + BOUNDED, tmp_path)
    assert "warn-bound" not in warned((DEVICE + BOUNDED).replace(*remedy), tmp_path)


def test_gains_that_are_idle_without_need_are_not_so_once_solved(tmp_path):
    weak = "[gains]\nvelocity = 0.5\nposition = 0.0\n[coupling]\ndamping = 100.0\nmass = 1.0\n"
    (tmp_path / "weak.toml").write_text(weak)
    assert "warn-idle" not in warned(DEVICE + PASSIVE, tmp_path)
    for gains, said in (("weak.toml", True), ("results/device/gains.toml", False)):
        done = run("check", "device.toml", gains, "--strict", cwd=tmp_path)
        assert ("warn-idle" in done.stdout) == said


@pytest.mark.parametrize(
    ("code", "doubted", "meant"),
    [
        ("warn-sample-time", DEVICE.replace("1e-3", "1.0"), DEVICE),
        ("warn-name", f'name = "aux"\n{DEVICE}', f'name = "other"\n{DEVICE}'),
    ],
)
def test_what_is_probably_not_meant_is_warned_of_until_it_is_what_is_said(tmp_path, code, doubted, meant):
    given = PASSIVE + "band_hz = [0.001, 0.1]\n" if code == "warn-sample-time" else PASSIVE
    (tmp_path / "doubted.toml").write_text(doubted + FIXED.format(160.0) + given)
    (tmp_path / "meant.toml").write_text(meant + FIXED.format(160.0) + PASSIVE)
    assert f"[{code}]" in run("check", "doubted.toml", "--strict", cwd=tmp_path).stdout
    done = run("check", "meant.toml", "--strict", cwd=tmp_path)
    assert done.returncode == ExitCode.OK, done


def test_a_rate_in_the_place_of_a_sample_time_is_told_with_its_seconds(tmp_path):
    given = PASSIVE + "band_hz = [1e-6, 1e-4]\n"
    (tmp_path / "rate.toml").write_text(DEVICE.replace("1e-3", "500.0") + FIXED.format(160.0) + given)
    done = run("check", "rate.toml", cwd=tmp_path)
    assert "device.sample_time is 500 s;" in done.stdout and "the rate of 500 Hz? Then write 0.002" in done.stdout


@pytest.mark.parametrize(
    ("environment", "limp"), [("mass = 0.0\nstiffness = 0.0", False), ("stiffness = 2000.0", True)]
)
def test_a_law_without_a_spring_holds_no_force_where_there_is_one_to_hold(tmp_path, environment, limp):
    text = DEVICE + "[gains]\nvelocity = 120.0\nposition = 0.0\n[coupling]\ndamping = inf\nmass = 1.0\ndrag = 20.0\n"
    (tmp_path / "device.toml").write_text(f"{text}[environment]\n{environment}\n")
    assert ("[warn-limp]" in run("check", "device.toml", cwd=tmp_path).stdout) == limp
