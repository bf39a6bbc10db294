"""Define the firmware's filters of samples as sections of second order with the gain 1 at rest (model/README.md,
section 12)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import astuple, dataclass
from fractions import Fraction
from functools import lru_cache
from math import sqrt

import numpy as np

from vctune.model.numbers.arithmetic import Number
from vctune.model.numbers.matrices import add, nothing, times

SectionRows = tuple[tuple[float, ...], ...]  # Sections as SciPy writes them: b0, b1, b2, a0, a1, a2 each
NUMBERS = 6
MOST_SECTIONS = 4
MOST_TIMES = 10**6  # Greatest numerator that is taken as meant, in gains at rest
GREATEST = 1e50  # Greatest magnitude of a number
GAIN_OFF = 1e-6  # Greatest deviation from 1 of the gain at rest that is taken as a rounding of the coefficients


@dataclass(frozen=True, slots=True)
class Section:
    """A section N/D in 1/z of which no rounding of the coefficients changes the gain 1 at rest: y += now (x - y) +
    before (x_1 - y) + earlier (x_2 - y) + again (y - y_2), with y, y_2, x_1 and x_2 of the samples before."""

    now: Number  # b_0, b_1, b_2 and a_2; the integer 0 for a coefficient that is 0 by structure
    before: Number = 0
    earlier: Number = 0
    again: Number = 0

    def mapped(self, f: Callable[[Number], Number]) -> Section:
        """Return the section with a function applied to its coefficients, but for those that are 0 by structure."""
        return Section(*(number if nothing(number) else f(number) for number in astuple(self)))

    @property
    def low_pass(self) -> bool:
        """Whether it is y += a (x - y)."""
        return nothing(self.before) and self.first_order

    @property
    def first_order(self) -> bool:
        """Whether it has no coefficient of 1/z^2."""
        return nothing(self.earlier) and nothing(self.again)

    @property
    def order(self) -> int:
        """The number of its poles, with those at z = 0."""
        return 1 if self.first_order else 2

    @property
    def rest(self) -> Number:
        """N(1) = D(1)."""
        return add(add(self.now, self.before), self.earlier)

    @property
    def lag(self) -> Number:
        """The lag at rest, in samples."""
        return add(add(1 - self.now, self.earlier), times(self.again, -1)) / self.rest

    def above(self, cos: Number, square: Number) -> tuple[Number, Number]:
        """Return the even and the odd part of z^(n/2) N for the order n (`EvenOdd`)."""
        if self.first_order:
            return self.rest * cos, add(self.now, times(self.before, -1))
        return self.rest - 2 * add(self.now, self.earlier) * square, 2 * add(self.now, times(self.earlier, -1)) * cos

    def below(self, cos: Number, square: Number) -> tuple[Number, Number]:
        """Return the even and the odd part of z^(n/2) D for the order n."""
        if self.first_order:
            return self.rest * cos, 2 - self.rest
        return self.rest - 2 * (1 + self.again) * square, 2 * (1 - self.again) * cos

    def below2(self, square: Number) -> Number:
        """Return |D|^2."""
        g = self.rest
        if self.first_order:
            return g * g + 4 * (1 - g) * square
        less = 1 - self.again
        return g * g + square * (4 * (less * less - g * (1 + self.again)) + 16 * self.again * square)

    def along(self, square: Number) -> Number:
        """Return Re(N conj D)."""
        g = self.rest
        if self.first_order:
            return add(g * (g + 2 * (1 - g) * square), times(self.before, -2 * (2 - g) * square))
        p, q = add(self.now, self.earlier), add(self.now, times(self.earlier, -1))
        more, less = 1 + self.again, 1 - self.again
        return g * g + square * (4 * q * less - 2 * g * (p + more) + 4 * (p * more - q * less) * square)

    def across(self, square: Number) -> Number:
        """Return -Im(N conj D)/sin theta."""
        g = self.rest
        if self.first_order:
            return g * (1 - self.now)
        q = add(self.now, times(self.earlier, -1))
        return g * (1 - self.again - q) - 2 * add(self.earlier, -(self.again * self.now)) * (2 * square)

    def missed(self, square: Number) -> Number:
        """Return Re((D - N) conj D)/(4 s^2)."""
        first = 1 - self.now
        if self.first_order:
            return first * (2 - self.rest) / 2
        second, less = add(self.earlier, -self.again), 1 - self.again
        # D - N = (1 - 1/z) (first + second/z), and D = rest - 2 (1 + again) s^2 + 2 j s less cos
        kept = (first + second) * less - (first - second) * self.rest / 2
        return kept + square * ((first - second) * (1 + self.again) - (first + second) * less)


ABOVE = 1.02  # Factor by which a bound of a gain may exceed the greatest gain found


@lru_cache(maxsize=64)
def greatest_gain(rows: SectionRows) -> float:
    """Return a proved bound of the gain of sections, |N/D| of each on the unit circle.

    With x = sin^2(theta/2), |N|^2 and |D|^2 are quadratic; m |D|^2 - |N|^2 is examined with fractions.
    """
    total = 1.0
    for section in sections_of_rows(rows):
        above, below = _squares(section)
        x = np.linspace(0.0, 1.0, 2001)
        values = [np.polynomial.polynomial.polyval(x, [float(each) for each in part]) for part in (above, below)]
        square = Fraction(float((values[0] / values[1]).max()) * ABOVE)
        while not _not_negative([square * b - a for a, b in zip(above, below, strict=True)]):
            square *= Fraction(ABOVE)
        total *= sqrt(float(square)) * (1 + GAIN_OFF)
    return total


def _squares(section: Section) -> tuple[list[Fraction], list[Fraction]]:
    """Return the coefficients of 1, x and x^2 in |N|^2 and |D|^2, from `above` and `below`."""
    now, before, earlier, again = map(Fraction, astuple(section))
    g, p, q = now + before + earlier, now + earlier, now - earlier
    if section.first_order:
        return [g * g, (now - before) ** 2 - g * g, Fraction(0)], [g * g, (2 - g) ** 2 - g * g, Fraction(0)]
    more, less = 1 + again, 1 - again
    above = [g * g, 4 * q * q - 4 * g * p, 4 * (p * p - q * q)]
    return above, [g * g, 4 * less * less - 4 * g * more, 16 * again]


def _not_negative(quadratic: Sequence[Fraction]) -> bool:
    """Return whether a quadratic is nowhere negative for 0 <= x <= 1."""
    a, b, c = quadratic
    inside = c > 0 and 0 < -b < 2 * c
    return a >= 0 and a + b + c >= 0 and not (inside and 4 * a * c < b * b)


@lru_cache(maxsize=64)
def sections_of_rows(rows: SectionRows) -> tuple[Section, ...]:
    """Return sections as floats, each with its gain at rest divided out."""
    found = []
    for row in rows:
        b0, b1, b2, a0, a1, a2 = map(Fraction, row)
        gain = (b0 + b1 + b2) / (a0 + a1 + a2)
        second = b2 != 0 or a2 != 0
        b0, b1, b2 = (b / (a0 * gain) for b in (b0, b1, b2))
        ends = (float(b2), float(a2 / a0)) if second else ()
        found.append(Section(float(b0), float(b1), *ends) if b1 or second else Section(float(b0)))
    return tuple(found)


def rows_of_sections(sections: Sequence[Section]) -> SectionRows:
    """Return sections as SciPy writes them."""
    return tuple((s.now, s.before, s.earlier, 1.0, s.rest - 1 - s.again, s.again) for s in sections)


def faults_of_rows(rows: SectionRows) -> Iterator[str]:
    """Yield what is wrong with sections, in words."""
    if not 1 <= len(rows) <= MOST_SECTIONS:
        yield f"has {len(rows)} sections; write 1 to {MOST_SECTIONS}, or leave it out"
    total = Fraction(1)
    for place, row in enumerate(rows, 1):
        if len(row) != NUMBERS or not all(abs(number) <= GREATEST for number in row) or row[3] == 0:
            yield (
                f"section {place} is no row of {NUMBERS} numbers [b0, b1, b2, a0, a1, a2] of at most {GREATEST:g}, "
                "with an a0 other than 0"
            )
            return
        b0, b1, b2, a0, a1, a2 = map(Fraction, row)
        a1, a2 = a1 / a0, a2 / a0
        if not abs(a2) < 1 or not abs(a1) < 1 + a2:
            yield f"section {place} is unstable: a pole is on or outside the unit circle"
            return
        gain = (b0 + b1 + b2) / a0 / (1 + a1 + a2)
        if gain == 0:
            yield f"section {place} has the gain 0 at rest, so that no steady motion passes"
            return
        if max(abs(b0), abs(b1), abs(b2)) > MOST_TIMES * abs(a0 * gain):
            yield f"section {place} has a b of more than {MOST_TIMES:g} times its gain at rest; check its numbers"
            return
        total *= gain
    if abs(total - 1) > GAIN_OFF:
        yield (
            f"the gain at rest is {float(total):.9g}, and must be 1 within {GAIN_OFF:g}: divide the first three "
            "numbers of one section by it, and write all digits, as sos.tolist() does"
        )
