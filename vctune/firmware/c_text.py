"""Write equations as C, with the same operations in the same order."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import inf

import numpy as np

from vctune.document.text.errors import printable
from vctune.simulation.firmware.expression import Operation, Symbol, Term
from vctune.simulation.firmware.stepped import Precision

BINDING = {"+": 1, "-": 1, "*": 2, "/": 2, "negative": 3}  # Precedence of each operator
HOLDING = BINDING | {"choice": 0}  # Precedence of an operation that is an operand of another operation


def literal(number: float, precision: Precision) -> str:
    """Return the shortest C constant that a compiler reads as exactly the given number."""
    if number in (inf, -inf):
        return "VCTUNE_NONE" if number > 0 else "-VCTUNE_NONE"
    text = repr(number) if precision == "double" else str(np.float32(number))
    if not set(text) & set(".en"):
        text += ".0"
    return text if precision == "double" else f"{text}f"


def code(term: Term, names: Mapping[Symbol, str], precision: Precision) -> str:
    """Return a term as C."""

    def called(operator: str, operands: list[str]) -> str:
        if operator == "choice":
            above, limit, yes, no = operands
            return f"({above} > {limit}) ? {yes} : {no}"
        return f"vctune_{operator}({', '.join(operands)})"

    return _written(term, names.__getitem__, lambda number: literal(number, precision), called)


def plain(term: Term) -> str:
    """Return a term as text that most languages can read: names, `before.NAME`, numbers, + - * /, minimum, maximum,
    choice."""

    def name(symbol: Symbol) -> str:
        return f"before.{symbol.name}" if symbol.before else symbol.name

    return _written(term, name, repr, lambda operator, operands: f"{operator}({', '.join(operands)})")


def _written(
    term: Term,
    name: Callable[[Symbol], str],
    number: Callable[[float], str],
    called: Callable[[str, list[str]], str],
) -> str:
    """Return a term as text. An operand gets parentheses if it binds less tightly than its operator."""
    if isinstance(term, Symbol):
        return name(term)
    if not isinstance(term, Operation):
        assert isinstance(term, float | int), "a symbol, an operation or a number"
        return number(float(term))
    operands = [_written(operand, name, number, called) for operand in term.operands]
    if term.operator not in BINDING:
        return called(term.operator, operands)
    precedence = BINDING[term.operator]
    if term.operator == "negative":
        return f"-{_bracketed(operands[0], term.operands[0], precedence)}"
    # + side: a right operand of the same precedence needs parentheses, because operators associate to the left
    left, right = (_bracketed(operands[side], term.operands[side], precedence + side) for side in (0, 1))
    return f"{left} {term.operator} {right}"


def comment(text: str, width: int = 110) -> list[str]:
    """Return a text as lines for a comment in C, in ASCII. The text cannot begin or end a comment."""
    lines, line = [], ""
    plain_text = printable(text).encode("ascii", "replace").decode()
    for word in plain_text.replace("/", " / ").split() if "*" in text else plain_text.split():
        if line and len(line) + 1 + len(word) > width:
            lines.append(line)
            line = ""
        line = f"{line} {word}" if line else word
    return [*lines, line] if line else lines


def _bracketed(text: str, term: Term, binding: int) -> str:
    """Return an operand, in parentheses if it binds less tightly than the operator around it. 9 stands for operands
    that never need parentheses."""
    precedence = HOLDING.get(term.operator, 9) if isinstance(term, Operation) else 9
    return f"({text})" if precedence < binding else text
