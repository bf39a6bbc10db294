"""The passivity bounds of Keemink, van der Kooij, Stienen 2018 (IJRR 37(11)), from their model in exact fractions.

Admittance of the handle (their appendix 2, continuous time, ideal current loop, post-sensor mass left out: a mass at
the handle adds nothing to the real part of its impedance), with Y_r = 1/(m_r s + b_r) and K_p = k_p k_r^2:
    Y_a = Y_r (1 + k_r S_f (G_f + (C_fb + C_ff) k_r Y_v)) / (1 + Y_r k_r^2 C_fb),
    C_fb = k_p + k_i/s, C_ff = mu s + beta, S_f = 1/(tau_f s + 1), Y_v = (k_a s + 1)/(m_v s).
Their k_p is vctune's K_v and their k_i its K_p. Passive: Re Y_a(jw) >= 0 for all w (the poles are in the open left
half plane for positive numbers, but for a simple one at 0 with a positive residue).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import pairwise

import numpy as np

Polynomial = list[Fraction]  # in s, lowest power first


@dataclass(frozen=True)
class Robot:
    """Their device; masses kg, dampings N s/m, k_i N/m, times s; the defaults are table 1 with k_i = 0."""

    m_v: Fraction = Fraction(2)
    m_r: Fraction = Fraction(10)
    b_r: Fraction = Fraction(5)
    k_p: Fraction = Fraction(100)
    k_i: Fraction = Fraction(0)
    k_r: Fraction = Fraction(1)
    force_gain: Fraction = Fraction(0)
    mu: Fraction = Fraction(0)
    beta: Fraction = Fraction(0)
    tau_f: Fraction = Fraction(0)
    k_a: Fraction = Fraction(0)


def times(left: Polynomial, right: Polynomial) -> Polynomial:
    """Return the product of two polynomials."""
    product = [Fraction(0)] * (len(left) + len(right) - 1)
    for i, a in enumerate(left):
        for j, b in enumerate(right):
            product[i + j] += a * b
    return product


def plus(left: Polynomial, right: Polynomial) -> Polynomial:
    """Return the sum of two polynomials."""
    size = max(len(left), len(right))
    padded = [p + [Fraction(0)] * (size - len(p)) for p in (left, right)]
    return [a + b for a, b in zip(*padded, strict=True)]


def admittance(robot: Robot) -> tuple[Polynomial, Polynomial]:
    """Return numerator and denominator of Y_a, both multiplied by m_v s^2 (tau_f s + 1) (m/(N s))."""
    zero, one = Fraction(0), Fraction(1)
    slow = [one, robot.tau_f]
    virtual = [zero, zero, robot.m_v]
    feedback = [robot.k_i, robot.k_p]  # s C_fb
    drive = plus(feedback, [zero, robot.beta, robot.mu])  # s (C_fb + C_ff)
    commanded = times([robot.k_r**2], times(drive, [one, robot.k_a]))
    boosted = times([robot.k_r * robot.force_gain], virtual)
    numerator = plus(times(virtual, slow), plus(boosted, commanded))
    robot_loop = plus([zero, robot.b_r, robot.m_r], times([robot.k_r**2], feedback))  # s (Z_r + k_r^2 C_fb)
    return numerator, times(times([zero, robot.m_v], slow), robot_loop)


def real_part(robot: Robot) -> Polynomial:
    """Return Re(N(jw) D(-jw)) as a polynomial in w^2; its sign is that of Re Y_a."""
    numerator, denominator = admittance(robot)
    mirrored = [c * (-1) ** i for i, c in enumerate(denominator)]
    even = times(numerator, mirrored)[::2]
    return [c * (-1) ** i for i, c in enumerate(even)]


def is_passive(robot: Robot) -> bool:
    """Return whether Re Y_a(jw) >= 0 at every w > 0: its sign between and beyond its real roots, in fractions."""
    polynomial = real_part(robot)
    while polynomial and polynomial[-1] == 0:
        polynomial.pop()
    roots = np.roots([float(c) for c in reversed(polynomial)])
    marks = sorted({0.0, *(float(r.real) for r in roots if abs(r.imag) < 1e-9 * abs(r) and r.real > 0)})
    between = [Fraction((a + b) / 2) for a, b in pairwise(marks)] + [Fraction(2 * marks[-1] + 1)]
    return all(sum(c * x**i for i, c in enumerate(polynomial)) >= 0 for x in between)


def least_virtual_mass(robot: Robot, upper: Fraction = Fraction(10**4)) -> Fraction:
    """Return the least m_v (kg) that makes the handle passive, by halving on the model itself to 1 part in 2^50."""
    lower = Fraction(0)
    for _ in range(64):
        middle = (lower + upper) / 2
        lower, upper = (lower, middle) if is_passive(replace(robot, m_v=middle)) else (middle, upper)
    return upper


def bound_7(robot: Robot) -> Fraction:
    """Return eq. 7 (kg): m_v >= m_r K_p / (K_p + b_r), feedback alone, k_i = 0."""
    K_p = robot.k_p * robot.k_r**2
    return robot.m_r * K_p / (K_p + robot.b_r)


def bound_9(robot: Robot) -> Fraction:
    """Return eq. 9 (kg), feed-forward: ((K_p + beta k_r^2) m_r - (K_p + b_r) mu k_r^2) / ((G_f k_r + 1)(K_p + b_r)).

    With k_i > 0 eq. 10 joins it: beta k_r^2 >= b_r.
    """
    K_p, ratio = robot.k_p * robot.k_r**2, robot.k_r**2
    demand = (K_p + robot.beta * ratio) * robot.m_r - (K_p + robot.b_r) * robot.mu * ratio
    return demand / ((robot.force_gain * robot.k_r + 1) * (K_p + robot.b_r))


def bound_11(robot: Robot) -> Fraction:
    """Return eq. 11 (kg), first-order force filter, k_i = 0: m_r K_p / (K_p + b_r) + K_p tau_f."""
    return bound_7(robot) + robot.k_p * robot.k_r**2 * robot.tau_f


def bound_12(robot: Robot) -> Fraction:
    """Return eq. 12 (kg), phase lead k_a: (K_p m_r - k_a (K_p^2 + K_p b_r - K_i m_r)) / (K_p + b_r).

    With k_i > 0 a second one joins it: k_a K_i >= b_r.
    """
    K_p, K_i = robot.k_p * robot.k_r**2, robot.k_i * robot.k_r**2
    return (K_p * robot.m_r - robot.k_a * (K_p**2 + K_p * robot.b_r - K_i * robot.m_r)) / (K_p + robot.b_r)
