"""Two arithmetics with one face, so that an oracle is written once: doubles (numpy, scipy) and 50 digits (mpmath).

A number that enters the 50 digits goes through its shortest decimal (1e-3 is one thousandth, not a double).
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import numpy as np
import scipy.linalg
from mpmath.ctx_mp import MPContext


class Doubles:
    """IEEE doubles; matrices are numpy arrays, and formulas take arrays of frequencies too."""

    pi = math.pi
    i = 1j
    exp = staticmethod(np.exp)
    sqrt = staticmethod(math.sqrt)

    def number(self, value: float | Fraction) -> float:
        """Return the value as a double."""
        return float(value)

    def array(self, values: Any) -> np.ndarray:
        """Return nested lists of numbers as an array of doubles (or complex doubles)."""
        return np.array(values, dtype=complex if np.iscomplexobj(values) else float)

    def eye(self, size: int) -> np.ndarray:
        """Return the identity."""
        return np.eye(size)

    def expm(self, matrix: np.ndarray) -> np.ndarray:
        """Return the matrix exponential."""
        return scipy.linalg.expm(matrix)

    def solve(self, matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
        """Return the solution x of matrix x = right."""
        return np.linalg.solve(matrix, right)

    def eigenvalues(self, matrix: np.ndarray) -> list[complex]:
        """Return all eigenvalues."""
        return list(np.linalg.eigvals(matrix))


class Digits:
    """Mpmath numbers of 50 digits in a context of their own; matrices are numpy arrays of objects."""

    def __init__(self, digits: int = 50) -> None:
        self.context = MPContext()
        self.context.dps = digits
        self.pi = +self.context.pi
        self.i = self.context.mpc(0, 1)
        self.exp = self.context.exp
        self.sqrt = self.context.sqrt

    def number(self, value: float | Fraction) -> Any:
        """Return the decimal that the value is printed as (a Fraction exactly)."""
        if isinstance(value, Fraction):
            return self.context.mpf(value.numerator) / value.denominator
        return self.context.mpf(str(value))

    def array(self, values: Any) -> np.ndarray:
        """Return nested lists of numbers as an array of objects."""
        return np.array(values, dtype=object)

    def eye(self, size: int) -> np.ndarray:
        """Return the identity."""
        return self.array([[self.number(int(i == j)) for j in range(size)] for i in range(size)])

    def expm(self, matrix: np.ndarray) -> np.ndarray:
        """Return the matrix exponential."""
        return self._from(self.context.expm(self.context.matrix(matrix.tolist())))

    def solve(self, matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
        """Return the solution x of matrix x = right."""
        solution = self.context.lu_solve(self.context.matrix(matrix.tolist()), self.context.matrix(right.tolist()))
        return self._from(solution)[:, 0]

    def eigenvalues(self, matrix: np.ndarray) -> list[Any]:
        """Return all eigenvalues."""
        return list(self.context.eig(self.context.matrix(matrix.tolist()), left=False, right=False))

    def _from(self, matrix: Any) -> np.ndarray:
        return np.array(matrix.tolist(), dtype=object)


Arithmetic = Doubles | Digits
DOUBLES = Doubles()
DIGITS = Digits()
