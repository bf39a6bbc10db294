"""Filters of samples by their rational function of z: each formula in theta is a part of it."""

from __future__ import annotations

import numpy as np
import pytest
from draws import sections

import vctune
from vctune.model.sections import Section
from vctune.proof.claims.cases import case_at
from vctune.proof.claims.poles import coupling_curve

CASES = range(30)


def drawn(number):
    """Return a random section, N and D at some angles, and the angles."""
    rng = np.random.default_rng((195, number))
    theta = rng.uniform(0.05, np.pi, 5)
    z = np.exp(1j * theta)
    if number % 2:
        now, before = rng.uniform(0.1, 1, 2)
        section = Section(now, before if number % 4 == 1 else 0)
        b0, b1, rest = now, section.before, section.rest
        return section, (b0 + b1 / z), 1 - (1 - rest) / z, theta
    now, before, earlier, again = rng.uniform(-0.4, 0.6, 4)
    section = Section(now, before, earlier, again)
    # y + a1 y_1 + again y_2 with 1 + a1 + again = N(1)
    a1 = section.rest - 1 - again
    return section, now + before / z + earlier / z**2, 1 + a1 / z + again / z**2, theta


@pytest.mark.parametrize("number", CASES)
def test_a_section_in_theta_is_its_rational_function_of_z(number):
    section, N, D, theta = drawn(number)
    square, cos, n = np.sin(theta / 2) ** 2, np.cos(theta / 2), section.order
    turned = np.exp(1j * n * theta / 2)
    s, c = np.sin(theta / 2), np.cos(theta / 2)
    for found, of in ((section.above(cos, square), N), (section.below(cos, square), D)):
        even, odd = found
        whole = turned * of
        assert even + 1j * s * odd == pytest.approx(whole, rel=1e-12)
    product = N * D.conj()
    assert section.below2(square) == pytest.approx(abs(D) ** 2, rel=1e-12)
    assert section.along(square) == pytest.approx(product.real, rel=1e-11, abs=1e-13)
    assert section.across(square) * np.sin(theta) == pytest.approx(-product.imag, rel=1e-11, abs=1e-13)
    assert 4 * square * section.missed(square) == pytest.approx(((D - N) * D.conj()).real, rel=1e-10, abs=1e-13)
    assert c.shape == theta.shape


@pytest.mark.parametrize("number", range(4))
def test_the_curve_of_a_coupling_is_its_impedance(number):
    """(1 - 1/z) Z_c T = b F (1 - 1/z) + k T, with the sections in the velocity."""
    rng = np.random.default_rng((196, number))
    rows, T, b, k = sections(rng), 1e-3, 0.7, 150.0
    tables = {
        "device": {
            "display": "impedance", "mass": 0.05, "damping": 0.3, "sample_time": T, "velocity": {"sections": rows},
        },
        "coupling": {"damping": b, "stiffness": k},
    }  # fmt: skip
    problem = vctune.problem(tables).problem
    gains, coupling = problem.fixed_design
    theta = rng.uniform(0.05, 3.1, 4)
    z = np.exp(1j * theta)
    F = np.prod([np.polyval(row[2::-1], 1 / z) / np.polyval(row[:2:-1], 1 / z) for row in rows], axis=0)
    design = vctune.judge(problem, gains, coupling).certificate.design
    found = coupling_curve(case_at(design, problem.demands), theta)
    assert found.re + 1j * found.im == pytest.approx(b * F * (1 - 1 / z) + k * T, rel=1e-9)
