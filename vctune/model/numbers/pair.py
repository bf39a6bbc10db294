"""Represent complex numbers in any arithmetic: `Pair`, because CasADi has none, and `EvenOdd`, a number of the unit
circle whose parts stay regular at the angle 0 (model/README.md, section 14)."""

from __future__ import annotations

from dataclasses import dataclass

from vctune.model.numbers.arithmetic import Number


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

    def plus(self, real: Number) -> Pair:
        """Return the sum of this number and a real number."""
        return Pair(self.re + real, self.im)

    def abs2(self) -> Number:
        """Return the squared modulus."""
        return self.re * self.re + self.im * self.im


@dataclass(frozen=True, slots=True)
class EvenOdd:
    """The complex number even + j s odd with s^2 = square. Both parts stay regular for s -> 0."""

    even: Number
    odd: Number
    square: Number

    def __add__(self, other: EvenOdd) -> EvenOdd:
        return EvenOdd(self.even + other.even, self.odd + other.odd, self.square)

    def __mul__(self, other: EvenOdd) -> EvenOdd:
        even = self.even * other.even - self.square * (self.odd * other.odd)
        return EvenOdd(even, self.even * other.odd + self.odd * other.even, self.square)

    def scaled(self, factor: Number) -> EvenOdd:
        """Return this number times a real factor."""
        return EvenOdd(self.even * factor, self.odd * factor, self.square)

    def plus(self, real: Number) -> EvenOdd:
        """Return the sum of this number and a real number."""
        return EvenOdd(self.even + real, self.odd, self.square)

    def abs2(self) -> Number:
        """Return the squared modulus."""
        return self.even * self.even + self.square * (self.odd * self.odd)


def re_conj_product(a: Pair, b: Pair) -> Number:
    """Return Re(a conj(b)) = Re a Re b + Im a Im b."""
    return a.re * b.re + a.im * b.im


def im_conj_product(a: Pair, b: Pair) -> Number:
    """Return Im(a conj(b)) = Im a Re b - Re a Im b."""
    return a.im * b.re - a.re * b.im
