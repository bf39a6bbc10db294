"""Devices without a key: each recipe is the real thing, stepped as it is."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

import vctune
from vctune import Gains
from vctune.model.gains import Coupling

T, M, B, K_T, R = 1e-3, 0.02, 0.05, 1.5, 2.0
WORDS = (
    "voltage", "back-EMF", "PWM", "PD loop", "feed-forward", "teleoperation", "several rates", "limit cycle", "notch",
    "quantisation", "friction compensation", "moving average", "gravity compensation",
)  # fmt: skip


def held(A: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a mechanism and its held input over a sample."""
    whole = expm(np.block([[A, b[:, None]], [np.zeros((1, len(A) + 1))]]) * T)
    return whole[:-1, :-1], whole[:-1, -1]


def of_voltage(K_v: float, L: float) -> float:
    """Return the spectral radius of a motor on a voltage whose firmware asks for the force -K_v v."""
    A = np.array([[-B / M, K_T / M], [-K_T / L, -R / L]])
    over, pushed = held(A, np.array([0.0, R / K_T / L]))  # the voltage that would give the force without back-EMF
    return float(np.abs(np.linalg.eigvals(over - np.outer(pushed, [K_v, 0.0]))).max())


def limit(radius, low: float, high: float) -> float:
    """Return the gain at which a loop loses its stability."""
    for _ in range(60):
        middle = (low * high) ** 0.5
        low, high = (middle, high) if radius(middle) < 1 else (low, middle)
    return low


def stable(device: dict, velocity: float, position: float = 0.0) -> bool:
    """Return whether vctune proves the velocity loop stable; it refutes it otherwise."""
    stability = {"criterion": "passive", "max_sensitivity": 1e9}
    problem = vctune.problem({"device": device, "stability": stability}).problem
    outcome = vctune.judge(problem, Gains(velocity, position), Coupling(1.0, 1.0, 1.0)).certificate.outcomes["stable"]
    assert outcome.verdict.value in ("proved", "refuted")
    return outcome.verdict.value == "proved"


def test_a_motor_on_a_voltage_is_damped_by_its_back_emf():
    greatest = limit(lambda K_v: of_voltage(K_v, 1e-8), 1.0, 1e3)
    device = {"mass": M, "damping": B + K_T**2 / R, "sample_time": T}
    assert stable(device, greatest * 0.999) and not stable(device, greatest * 1.001)


@pytest.mark.parametrize("L", [1e-4, 3e-4])
def test_with_inductance_the_recipe_is_near(L):
    """R/(2 pi L) is 1 to 3 kHz, where the loop's limit is at half the sampling rate."""
    greatest = limit(lambda K_v: of_voltage(K_v, L), 1.0, 1e3)
    device = {"mass": M - K_T**2 * L / R**2, "damping": B + K_T**2 / R, "sample_time": T}
    device["actuator"] = {"bandwidth_hz": R / (2 * np.pi * L)}
    assert stable(device, greatest * 0.98) and not stable(device, greatest * 1.02)


def test_pd_on_the_position_is_pi_on_the_velocity():
    """u = K_p (x_d - x) + K_d (v_d - v): its own loop is that of x and v, whatever moves x_d and v_d."""
    over, pushed = held(np.array([[0.0, 1.0], [0.0, -B / M]]), np.array([0.0, 1 / M]))

    def radius(K_d: float) -> float:
        return float(np.abs(np.linalg.eigvals(over - np.outer(pushed, [300.0, K_d]))).max())

    greatest = limit(radius, 5.0, 1e3)
    device = {"mass": M, "damping": B, "sample_time": T}
    assert stable(device, greatest * 0.999, 300.0) and not stable(device, greatest * 1.001, 300.0)


def of_two_handles(K: float, B: float, late: int) -> float:
    """Return the spectral radius of two equal handles whose firmware couples them by a spring and a damper, each by the
    other's position `late` samples ago; without what moves both together, which nothing holds."""
    over, pushed = held(np.array([[0.0, 1.0], [0.0, -B_PADDLE / M_PADDLE]]), np.array([0.0, 1 / M_PADDLE]))
    n = 4 * (late + 2)  # position and velocity of both, and positions of both one to late + 1 samples ago
    A = np.zeros((n, n))
    for one in (0, 1):
        other, row, past = 1 - one, 2 * one, 4 + (late + 1) * np.array([0, 1])
        force = np.zeros(n)

        def at(which: int, ago: int, past=past) -> int:
            return 2 * which if ago == 0 else int(past[which]) + ago - 1

        for ago, sign, which in ((0, -1, one), (late, 1, other)):
            force[at(which, ago)] += sign * (K + B / T)
            force[at(which, ago + 1)] -= sign * B / T
        A[row : row + 2, row : row + 2] += over
        A[row : row + 2] += np.outer(pushed, force)
        A[past[one], row] = 1.0
        for ago in range(late):
            A[past[one] + ago + 1, past[one] + ago] = 1.0
    z = np.linalg.eigvals(A)
    return float(np.abs(z[np.abs(z - 1) > 1e-5]).max())


M_PADDLE, B_PADDLE = 0.01, 0.3


@pytest.mark.parametrize("late", [0, 1, 2])
def test_two_coupled_handles_are_one_before_a_wall_of_twice_the_spring(late):
    damping = 0.5
    own = limit(lambda K: of_two_handles(K, damping, late), 1.0, 1e5)
    device = {"display": "impedance", "mass": M_PADDLE, "damping": B_PADDLE, "sample_time": T, "delay": late * T / 2}
    tables = {
        "device": device,
        "environment": {"stiffness": np.inf},
        "operator": {"mass": {"max": 0.0}, "damping": {"max": 0.0}, "stiffness": {"max": 0.0}},
        "stability": {"criterion": "hands", "safety_factor": 1.0},
    }
    problem, verdicts = vctune.problem(tables).problem, []
    for share in (0.97, 1.03):
        wall = vctune.SpringDamper(2 * damping, 2 * own * share)
        verdicts.append(vctune.judge(problem, Gains(0.0, 0.0), wall).status.value)
    assert verdicts == ["certified", "violated"]


@pytest.mark.parametrize("word", WORDS)
def test_explain_knows_the_words(word):
    entries = vctune.explain(word).entries
    assert any(each.kind == "device" for each in entries), [each.kind for each in entries]
