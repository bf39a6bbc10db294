"""Coefficients of quadratics in the gains, from the constants of a loop that is affine in them.

See design/bound/README.md, section 1.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from vctune.model.affine import Affine, LoopConstants
from vctune.model.arithmetic import Number
from vctune.model.pair import Pair, re_conj_product
from vctune.proof.array_intervals import Enclosure

Coefficients = tuple[
    Enclosure, tuple[Enclosure, Enclosure] | None, tuple[Enclosure, Enclosure] | None, Enclosure | None
]
"""Of a quadratic: constant, linear, square, cross."""
Term = tuple[Coefficients, Coefficients]
"""Re(X conj X_0) and |X_0|^2 |D|^2."""


def quadratic(of: Callable[[Pair, Pair], Number], a: Affine, b: Affine, *, crossed: bool) -> Coefficients:
    """Return the coefficients of a real product of two numbers that are affine in the gains.

    Parameters
    ----------
    of : Re or Im of the first times the conjugate of the second
    a, b : at the same frequencies; a coefficient is not there where both its factors are not
    crossed : whether K_v and K_p contribute together, which they do not where their shares are at right angles
    """

    def product(*pairs: tuple[Pair | None, Pair | None]) -> Number:
        found = [of(x, y) for x, y in pairs if x is not None and y is not None]
        return sum(found[1:], start=found[0]) if found else None

    def both(one: Number, two: Number) -> tuple[Number, Number] | None:
        if one is None and two is None:
            return None
        return 0 * two if one is None else one, 0 * one if two is None else two

    linear = both(
        product((a.constant, b.velocity), (a.velocity, b.constant)),
        product((a.constant, b.position), (a.position, b.constant)),
    )
    square = both(product((a.velocity, b.velocity)), product((a.position, b.position)))
    cross = product((a.velocity, b.position), (a.position, b.velocity)) if crossed else None
    constant = product((a.constant, b.constant))
    if constant is None:
        constant = 0 * (linear or square or (0.0,))[0]
    return constant, linear, square, cross


def error_term(at: LoopConstants, X: Affine, *, crossed: bool) -> Term:
    """Return a term |X|^2/|D|^2 at frequencies, of X that is X_0 with both gains 0.

    Parameters
    ----------
    at : the loop there
    X : one of its numbers
    crossed : as in `quadratic`, of D
    """
    assert X.constant is not None
    idle = Affine(X.constant, None, None)
    constant, linear, *_ = quadratic(re_conj_product, X, idle, crossed=False)
    weight = X.constant.abs2()
    D2 = quadratic(re_conj_product, at.D, at.D, crossed=crossed)
    return (constant, linear, None, None), mapped(D2, lambda x: weight * x)


def mapped(coefficients: Coefficients, f: Callable[[Number], Number]) -> Coefficients:
    """Return coefficients, each of those that are there mapped.

    Parameters
    ----------
    coefficients : of a quadratic
    f : of one of them; called in the order constant, linear, square, cross
    """
    constant, linear, square, cross = coefficients
    return (
        f(constant),
        None if linear is None else (f(linear[0]), f(linear[1])),
        None if square is None else (f(square[0]), f(square[1])),
        None if cross is None else f(cross),
    )


def listed(term: Term) -> list[Number]:
    """Return the coefficients of a term that are there."""
    found: list[Number] = []
    for part in term:
        mapped(part, found.append)
    return found


def replaced(term: Term, coefficients: Iterable[Number]) -> Term:
    """Return a term with other coefficients in the place of those that are there.

    Parameters
    ----------
    term : whose coefficients that are not there are not there either
    coefficients : in the order of `listed`
    """
    found = iter(coefficients)
    root, D2 = (mapped(part, lambda _: next(found)) for part in term)
    return root, D2


def concatenated(terms: Sequence[Term]) -> Term:
    """Return the same term of several devices, one after another."""
    if len(terms) == 1:
        return terms[0]
    rows = zip(*map(listed, terms), strict=True)
    joined = (Enclosure(np.concatenate([x.mid for x in row]), np.concatenate([x.rad for x in row])) for row in rows)
    return replaced(terms[0], joined)
