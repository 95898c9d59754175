"""Writing: the steps of a derivation as text for a terminal, and as a LaTeX document, with the printers of sympy."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import sympy as sp
from sympy.printing.latex import LatexPrinter
from sympy.printing.pretty.pretty_symbology import line_width
from sympy.printing.str import StrPrinter

from wbc.models.lagrange.steps import Formula, Step, unicode_name

#: A sum of more terms is not written out.
MAX_TERMS = 40

_INDENT = "    "
_TEX_WIDTH = 260  # characters of LaTeX that fit on a line of a page
_HIGH = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
#: The order of factors in a product: masses, lengths, offsets, inertias, gravity, then what moves.
_ORDER = ("m", "l", "d", "I", "g", "q", "c", "s", "qdot", "qddot")


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
def _written(value: Any) -> Any:
    """Cosines and sines of sums of positions as symbols: cos(q1 + q2) is c12. All symbols are named so that sympy,
    which goes by the name, puts them in order: behind one character for the place."""
    names: dict[Any, Any] = {}
    for function in value.atoms(sp.cos, sp.sin):
        terms = sp.Add.make_args(function.args[0])
        if all(isinstance(term, sp.Symbol) for term in terms):
            numbers = "".join(sorted(term.name[1:] for term in terms))
            names[function] = sp.Symbol(f"{'c' if function.func is sp.cos else 's'}{numbers}", real=True)
    value = value.xreplace(names)
    return value.xreplace({
        symbol: sp.Symbol(f"{_ORDER.index(symbol.name.rstrip('0123456789'))}{symbol.name}", real=True)
        for symbol in value.free_symbols
    })  # fmt: skip


class _InOrder:
    """A printer of sympy for what :func:`_written` returns: accelerations come first in a sum, then velocities."""

    def _as_ordered_terms(self, expression: Any, order: Any = None) -> list[Any]:
        def place(term: Any) -> int:
            return -max([*(int(symbol.name[0]) for symbol in term.free_symbols), _ORDER.index("s")])

        return sorted(super()._as_ordered_terms(expression, order=order), key=place)  # type: ignore[misc]


class _Plain(_InOrder, StrPrinter):  # type: ignore[misc]  # sympy carries no types
    def _print_Symbol(self, symbol: Any) -> str:
        return unicode_name(symbol.name[1:])


class _Tex(_InOrder, LatexPrinter):  # type: ignore[misc]
    def _print_Symbol(self, symbol: Any) -> str:
        return str(sp.latex(sp.Symbol(symbol.name[1:])))


def _line(value: Any) -> str:
    """An expression on one line, as one writes it by hand: −m₂ d₂ s₂ q̇₁²."""
    count = len(sp.Add.make_args(value))
    if count > MAX_TERMS:
        return f"a sum of {count} terms"
    powers = re.sub(r"\*\*(\d+)", lambda found: found[1].translate(_HIGH), _Plain().doprint(value))
    return powers.replace("*", " ").replace("-", "−")


# ---- text
def _formula(formula: Formula, width: int) -> list[str]:
    if formula.value is None:
        return [formula.left]
    value = _written(formula.value)
    if not isinstance(value, sp.MatrixBase):
        return _sum(formula.left, value, width)
    lines = value.applyfunc(lambda entry: entry if entry.is_Number else sp.Symbol(_line(entry)))
    equation = sp.Eq(sp.Symbol(formula.left), lines, evaluate=False)
    block: list[str] = sp.pretty(equation, use_unicode=True, wrap_line=False).splitlines()
    if max(map(line_width, block)) <= width:
        return block
    symmetric = "symmetric, " if value.T == value else ""
    entries = _entries(formula.left, value, lambda i, j: f"[{i}]" if value.cols == 1 else f"[{i},{j}]")
    first = f"{formula.left}, {symmetric}entries that are not zero:"
    return [first, *(line for name, entry in entries for line in _sum(name, entry, width))]


def _sum(left: str, value: Any, width: int) -> list[str]:
    """An equation, broken before a plus or a minus."""
    whole = re.sub(" (?![+−] )", "\xa0", f"{left} = {_line(value)}")
    lines = textwrap.wrap(whole, width, subsequent_indent=" " * (len(left) + 3), break_long_words=False)
    return [line.replace("\xa0", " ") for line in lines]


def _entries(left: str, value: Any, index: Callable[[int, int], str]) -> Iterator[tuple[str, Any]]:
    """What a matrix has that is not zero, each with its name; of a symmetric one the upper half."""
    symmetric, name = value.T == value, left.partition(" = ")[0]
    name = f"({name})" if " " in name or "_" in name else name  # such that an index can follow
    for i in range(value.rows):
        for j in range(i if symmetric else 0, value.cols):
            if value[i, j] != 0:
                yield name + index(i + 1, j + 1), value[i, j]


# ---- LaTeX
def _tex_formula(formula: Formula) -> list[str]:
    if formula.value is None:
        return [rf"\[ {formula.tex} \]"]
    value = _written(formula.value)
    if not isinstance(value, sp.MatrixBase):
        return _tex_sum(formula.tex, value)
    matrix = _Tex().doprint(value)
    if max(map(len, matrix.split(r"\\"))) <= _TEX_WIDTH:
        return [rf"\[ {formula.tex} = {matrix} \]"]
    entries = _entries(formula.tex, value, lambda i, j: f"_{{{i},{j}}}")
    return [line for name, entry in entries for line in _tex_sum(name, entry)]


def _tex_sum(name: str, value: Any) -> list[str]:
    """An equation, broken before a term where it gets long."""
    printer, lines = _Tex(), [""]
    terms = [printer.doprint(term) for term in printer._as_ordered_terms(value)]
    if len(terms) > MAX_TERMS:
        return [rf"\[ {name} = \text{{a sum of {len(terms)} terms}} \]"]
    if max(map(len, terms)) > _TEX_WIDTH and (expanded := sp.expand(value)) != value:
        return _tex_sum(name, expanded)
    for term in terms:
        if lines[-1] and len(lines[-1]) + len(term) > _TEX_WIDTH:
            lines.append("")
        lines[-1] += f" {term}" if term[0] == "-" or not lines[0] else f" + {term}"
    if len(lines) == 1:
        return [rf"\[ {name} ={lines[0]} \]"]
    rest = "".join(rf" \\ &\quad{line}" for line in lines[1:])
    return [r"\begin{align*}", rf"{name} &={lines[0]}{rest}", r"\end{align*}"]
