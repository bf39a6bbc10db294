"""A complex number as a pair of reals of any arithmetic (CasADi has no complex numbers)."""

from __future__ import annotations

from dataclasses import dataclass

from vctune.model.arithmetic import Number


@dataclass(frozen=True, slots=True)
class Pair:
    """The complex number re + j im."""

    re: Number
    im: Number

    def __add__(self, other: Pair) -> Pair:
        return Pair(self.re + other.re, self.im + other.im)

    def __mul__(self, other: Pair) -> Pair:
        return Pair(self.re * other.re - self.im * other.im, self.re * other.im + self.im * other.re)

    def scaled(self, factor: Number) -> Pair:
        """Return this number times a real factor."""
        return Pair(self.re * factor, self.im * factor)

    def abs2(self) -> Number:
        """Return the squared modulus."""
        return self.re * self.re + self.im * self.im


def re_conj_product(a: Pair, b: Pair) -> Number:
    """Return Re(a conj(b)).

    Parameters
    ----------
    a, b : in numbers of the same arithmetic
    """
    return a.re * b.re + a.im * b.im


def im_conj_product(a: Pair, b: Pair) -> Number:
    """Return Im(a conj(b)).

    Parameters
    ----------
    a, b : in numbers of the same arithmetic
    """
    return a.im * b.re - a.re * b.im
