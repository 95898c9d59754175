"""Writing: the steps of a derivation as text for a terminal, and as a LaTeX document."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator, Sequence
from typing import Any
from unicodedata import combining

import sympy as sp
from sympy.printing.pretty.pretty_symbology import pretty_symbol, pretty_use_unicode
from sympy.printing.str import StrPrinter

from wbc.models.lagrange.steps import Formula, Step

#: A sum of more terms is not written out.
MAX_TERMS = 40

_INDENT = "    "
_TEX_WIDTH = 260  # characters of LaTeX that fit on a line of a page
_HIGH = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
#: The order of factors in a product: masses, lengths, offsets, inertias, gravity, sums, then what moves.
_ORDER = re.compile(r"(m)|(l)|(d)|(I)|(g)|(\()|(q)|([cs])|(qdot)|(qddot)")


def text(steps: Sequence[Step], width: int) -> str:
    """Numbered titles, sentences, and formulas on lines of at most ``width`` columns where they can be broken."""
    lines: list[str] = []
    for number, step in enumerate(steps, start=1):
        lines += [f"{number}. {step.title}", *textwrap.wrap(step.sentence, width)]
        for formula in step.formulas:
            lines += (_INDENT + line for line in _formula(formula, max(width - len(_INDENT), 40)))
        lines.append("")
    return "\n".join(lines)


def latex(steps: Sequence[Step], chain: str) -> str:
    """A document that compiles as it is."""
    lines = [
        r"\documentclass{article}",
        r"\usepackage{amsmath}",
        r"\usepackage[margin=2cm]{geometry}",
        r"\allowdisplaybreaks",
        r"\setcounter{MaxMatrixCols}{30}",
        rf"\title{{Dynamics of the planar chain {chain}}}",
        r"\date{}",
        r"\begin{document}",
        r"\maketitle",
    ]
    for step in steps:
        lines += [rf"\section{{{step.title}}}", step.sentence.replace("_", r"\_").replace("^", r"\^{}")]
        lines += [line for formula in step.formulas for line in _tex_formula(formula)]
    return "\n".join([*lines, r"\end{document}", ""])


# ---- expressions
def abbreviated(expression: Any) -> Any:
    """Cosines and sines of sums of positions as symbols: cos(q1 + q2) is c12."""
    names = {}
    for function in expression.atoms(sp.cos, sp.sin):
        terms = sp.Add.make_args(function.args[0])
        if all(isinstance(term, sp.Symbol) for term in terms):
            numbers = "".join(sorted(term.name[1:] for term in terms))
            names[function] = sp.Symbol(f"{'c' if function.func is sp.cos else 's'}{numbers}", real=True)
    return expression.xreplace(names)


class _Line(StrPrinter):  # type: ignore[misc]  # sympy carries no types
    """An expression on one line, as one writes it by hand: −m₂ d₂ s₂ q̇₁²."""

    minus, half = "−", "½"

    def _power(self, base: str, exponent: int) -> str:
        return base + str(exponent).translate(_HIGH)

    def _quotient(self, numerator: Any, denominator: Any) -> str:
        below = self._print(denominator)
        return f"{self._factor(numerator)}/{below if denominator.is_Atom else f'({below})'}"

    def _print_Symbol(self, symbol: Any) -> str:
        before = pretty_use_unicode(True)  # sympy's own guess is made once, from what stdout was when it was imported
        try:
            return str(pretty_symbol(symbol.name))
        finally:
            pretty_use_unicode(before)

    def _print_Add(self, expression: Any, order: Any = None) -> str:
        line = ""
        for term in sorted(self._as_ordered_terms(expression, order=order), key=_derivative):
            part = self._print(term)
            sign, part = (self.minus, part[1:]) if part.startswith(self.minus) else ("+", part)
            line += f" {sign} {part}" if line else part if sign == "+" else sign + part
        return line

    def _print_Mul(self, expression: Any) -> str:
        if expression.could_extract_minus_sign():
            return self.minus + self._factor(-expression)
        numerator, denominator = sp.fraction(expression)
        if denominator == 2:
            return self.half if numerator == 1 else f"{self.half} {self._factor(numerator)}"
        if denominator != 1:
            return self._quotient(numerator, denominator)
        return " ".join(self._factor(factor) for factor in sorted(sp.Mul.make_args(expression), key=_place))

    def _factor(self, expression: Any) -> str:
        line = str(self._print(expression))
        return f"({line})" if expression.is_Add else line

    def _print_Pow(self, expression: Any, rational: bool = False) -> str:
        base, exponent = expression.as_base_exp()
        if exponent < 0:
            return self._quotient(sp.Integer(1), base**-exponent)
        return self._power(self._factor(base), int(exponent))

    def _print_Integer(self, number: Any) -> str:
        return str(number).replace("-", self.minus)

    def _print_Rational(self, number: Any) -> str:
        return self._print_Mul(number)


class _TexLine(_Line):
    """The same in LaTeX."""

    minus, half = "-", r"\tfrac12"

    def _power(self, base: str, exponent: int) -> str:
        return f"{base}^{{{exponent}}}"

    def _quotient(self, numerator: Any, denominator: Any) -> str:
        return rf"\frac{{{self._print(numerator)}}}{{{self._print(denominator)}}}"

    def _print_Symbol(self, symbol: Any) -> str:
        return str(sp.latex(symbol))


def _derivative(term: Any) -> int:
    """Accelerations come first in a sum, then velocities."""
    names = {symbol.name.rstrip("0123456789") for symbol in term.free_symbols}
    return 0 if "qddot" in names else 1 if "qdot" in names else 2


def _place(factor: Any) -> tuple[int, str]:
    """Where a factor stands in a product: numbers, parameters, sums, positions, velocities."""
    base = factor.as_base_exp()[0]
    if base.is_Number:
        return 0, ""
    found = _ORDER.fullmatch(base.name.rstrip("0123456789") if isinstance(base, sp.Symbol) else "(")
    return (found.lastindex or 0) if found else 0, str(base)


# ---- text
def _formula(formula: Formula, width: int) -> Iterator[str]:
    if formula.value is None:
        yield formula.left
        return
    value = abbreviated(formula.value)
    if not isinstance(value, sp.MatrixBase):
        yield from _sum(formula.left, value, width)
        return
    entries = [[_line(value[i, j]) for j in range(value.cols)] for i in range(value.rows)]
    block = _block(formula.left, entries)
    if max(map(_columns, block)) <= width:
        yield from block
    else:
        yield from _entry_by_entry(formula.left, value, width)


def _line(value: Any) -> str:
    count = len(sp.Add.make_args(value))
    return str(_Line().doprint(value)) if count <= MAX_TERMS else f"a sum of {count} terms"


def _sum(left: str, value: Any, width: int) -> list[str]:
    """An equation, broken before a plus or a minus."""
    parts = re.split(" (?=[+−] )", f"{left} = {_line(value)}")
    lines = [parts[0]]
    for part in parts[1:]:
        if _columns(lines[-1]) + 1 + _columns(part) <= width:
            lines[-1] += " " + part
        else:
            lines.append(" " * (_columns(left) + 3) + part)
    return lines


def _block(left: str, entries: list[list[str]]) -> list[str]:
    """A matrix with its brackets."""
    widths = [max(map(_columns, column)) for column in zip(*entries, strict=True)]
    last = len(entries) - 1
    lines = []
    for i, row in enumerate(entries):
        opening, closing = "[]" if last == 0 else "⎡⎤" if i == 0 else "⎣⎦" if i == last else "⎢⎥"
        content = "   ".join(_centred(entry, size) for entry, size in zip(row, widths, strict=True))
        name = f"{left} = " if i == last // 2 else " " * (_columns(left) + 3)
        lines.append(f"{name}{opening} {content} {closing}")
    return lines


def _centred(entry: str, columns: int) -> str:
    return entry.center(columns + len(entry) - _columns(entry))


def _columns(line: str) -> int:
    """How many columns a line takes: dots above letters take none."""
    return sum(not combining(character) for character in line)


def _entry_by_entry(left: str, value: Any, width: int) -> Iterator[str]:
    """A matrix that is too wide."""
    symmetric = "symmetric, " if value.T == value else ""
    yield f"{left}, {symmetric}entries that are not zero:"
    for i, j in _entries(value):
        index = f"[{i + 1}]" if value.cols == 1 else f"[{i + 1},{j + 1}]"
        yield from _sum(_in_brackets(left) + index, value[i, j], width)


def _entries(value: Any) -> Iterator[tuple[int, int]]:
    """Where a matrix is not zero; of a symmetric one the upper half."""
    symmetric = value.T == value
    for i in range(value.rows):
        yield from ((i, j) for j in range(i if symmetric else 0, value.cols) if value[i, j] != 0)


def _in_brackets(left: str) -> str:
    """The name of a matrix, such that an index can follow."""
    name = left.partition(" = ")[0]
    return f"({name})" if " " in name or "_" in name else name


# ---- LaTeX
def _tex_formula(formula: Formula) -> list[str]:
    if formula.value is None:
        return [rf"\[ {formula.tex} \]"]
    value = abbreviated(formula.value)
    if not isinstance(value, sp.MatrixBase):
        return _tex_sum(formula.tex, value)
    rows = [[_TexLine().doprint(value[i, j]) for j in range(value.cols)] for i in range(value.rows)]
    if max(sum(map(len, row)) for row in rows) <= _TEX_WIDTH:
        body = r" \\ ".join(" & ".join(row) for row in rows)
        return [rf"\[ {formula.tex} = \begin{{pmatrix}} {body} \end{{pmatrix}} \]"]
    name = _in_brackets(formula.tex)
    return [line for i, j in _entries(value) for line in _tex_sum(f"{name}_{{{i + 1},{j + 1}}}", value[i, j])]


def _tex_sum(name: str, value: Any) -> list[str]:
    """An equation, broken before a plus or a minus where it gets long; a fraction stays in one piece."""
    count = len(sp.Add.make_args(value))
    if count > MAX_TERMS:
        return [rf"\[ {name} = \text{{a sum of {count} terms}} \]"]
    lines, depth = [""], 0
    for part in re.split(" (?=[+-] )", _TexLine().doprint(value)):
        if lines[-1] and depth == 0 and len(lines[-1]) + len(part) > _TEX_WIDTH:
            lines.append("")
        lines[-1] += f" {part}"
        depth += part.count("{") - part.count("}")
    if len(lines) == 1:
        return [rf"\[ {name} ={lines[0]} \]"]
    rest = "".join(rf" \\ &\quad{line}" for line in lines[1:])
    return [r"\begin{align*}", rf"{name} &={lines[0]}{rest}", r"\end{align*}"]
