"""Slips that a programmer makes, found in a syntax tree: signs, comparisons, constants, dropped statements, order.

Docstrings, type annotations, messages and what is only printed are left alone.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from hashlib import sha256

_SWAPPED: dict[type[ast.AST], tuple[type[ast.AST], ...]] = {
    ast.Add: (ast.Sub,), ast.Sub: (ast.Add,), ast.Mult: (ast.Div,), ast.Div: (ast.Mult,), ast.FloorDiv: (ast.Mult,),
    ast.MatMult: (), ast.Lt: (ast.LtE, ast.GtE), ast.LtE: (ast.Lt, ast.Gt), ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt), ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,), ast.Is: (ast.IsNot,), ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,), ast.NotIn: (ast.In,), ast.And: (ast.Or,), ast.Or: (ast.And,),
    ast.BitAnd: (ast.BitOr,), ast.BitOr: (ast.BitAnd,),
}  # fmt: skip
_NAMES = {"min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum", "any": "all", "all": "any",
          "argmin": "argmax", "argmax": "argmin", "zeros": "ones", "sin": "cos", "cos": "sin"}  # fmt: skip
# A swap of their arguments changes nothing, or cannot be run at all.
_COMMUTE = {"min", "max", "minimum", "maximum", "fmin", "fmax", "add", "multiply", "logical_and", "logical_or",
            "hypot", "array_equal", "isclose", "allclose", "ddot", "isinstance", "issubclass", "getattr", "hasattr",
            "zip"}  # fmt: skip
_PRINTED = {"__repr__", "__str__", "__rich__", "_repr_html_"}
_MESSAGES = {"warn", "debug", "info", "warning", "print", "cast", "TypeVar"}
_DROPPED = (ast.AugAssign, ast.Raise, ast.Delete, ast.Continue, ast.Break)


@dataclass(frozen=True)
class Slip:
    """One slip: the bytes from ``start`` to ``end`` of ``file`` become ``text``."""

    file: str
    function: str  # the qualified name of what it stands in; "" in the module
    line: int
    start: int
    end: int
    old: str
    text: str
    place: str  # tells it from the others of its function

    def applied(self, source: bytes) -> bytes:
        """The source with the slip."""
        return source[: self.start] + self.text.encode() + source[self.end :]

    def rank(self, seed: int) -> bytes:
        """Slips are drawn in the order of their ranks."""
        return sha256(f"{seed} {self.file} {self.place}".encode()).digest()

    def __str__(self) -> str:
        old, new = (" ".join(text.split()) for text in (self.old, self.text))
        return f"{self.file}:{self.line} {self.function}: {old} -> {new}"


def _constant(value: object) -> list[str]:
    if isinstance(value, bool):
        return [str(not value)]
    if isinstance(value, int):
        return [str(value + 1), str(value - 1) if value else "-1"]
    if isinstance(value, float):
        return [repr(value * 1e3), repr(value / 1e3)] if value else ["1.0"]
    return []


def _changed(node: ast.AST) -> Iterator[str]:
    """The texts that a slip may put in the place of this node."""
    match node:
        case ast.Constant(value=value):
            yield from _constant(value)
        case ast.UnaryOp(op=ast.USub() | ast.Not(), operand=operand):
            yield f"({ast.unparse(operand)})"
        case ast.BinOp(left=left, op=op, right=right) if not _text(left) and not _text(right):
            for other in _SWAPPED.get(type(op), ()):
                yield f"({ast.unparse(ast.BinOp(left, other(), right))})"
        case ast.BoolOp(op=op, values=values):
            yield f"({ast.unparse(ast.BoolOp(_SWAPPED[type(op)][0](), values))})"
        case ast.Compare(left=left, ops=ops, comparators=comparators):
            for i, op in enumerate(ops):
                both = (left, *comparators)
                exact = any(isinstance(side, ast.Constant) and isinstance(side.value, float) for side in both)
                for other in _SWAPPED[type(op)]:
                    if exact and {type(op), other} in ({ast.Lt, ast.LtE}, {ast.Gt, ast.GtE}):
                        continue  # it differs at one number only
                    new = [*ops[:i], other(), *ops[i + 1 :]]
                    yield f"({ast.unparse(ast.Compare(left, new, comparators))})"
        case ast.Call(func=func, args=[first, second, *rest], keywords=keywords) if not any(
            isinstance(argument, ast.Starred) for argument in (first, second)
        ):
            if ast.unparse(func).rsplit(".", 1)[-1] not in _COMMUTE:
                yield ast.unparse(ast.Call(func, [second, first, *rest], keywords))
        case ast.Name(id=name) | ast.Attribute(attr=name) if name in _NAMES:
            text = ast.unparse(node)
            yield text[: len(text) - len(name)] + _NAMES[name]
        case ast.Assign(targets=[ast.Subscript() | ast.Attribute(), *_]):
            yield "pass"
        case ast.Expr(value=ast.Call() | ast.Yield()):
            yield "pass"
        case ast.AugAssign(op=op, target=target, value=value):
            yield "pass"
            for other in _SWAPPED.get(type(op), ()):
                yield ast.unparse(ast.AugAssign(target, other(), value))
        case ast.stmt() if isinstance(node, _DROPPED):
            yield "pass"
        case _:
            return


def _text(node: ast.AST) -> bool:
    return isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Constant) and isinstance(node.value, str))


def _left_alone(node: ast.AST) -> bool:
    """Whether nothing in this node is changed: it is a type, a message or text."""
    match node:
        case ast.FunctionDef(name=name) | ast.ClassDef(name=name) if name in _PRINTED:
            return True
        case ast.FunctionDef(decorator_list=decorators) if any(ast.unparse(d).endswith("overload") for d in decorators):
            return True
        case ast.If(test=test) if "TYPE_CHECKING" in ast.unparse(test):
            return True
        case ast.Assign(targets=[ast.Name(id=name)]) if name.startswith("__"):
            return True
        case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name)) if name in _MESSAGES:
            return True
        case ast.Expr(value=ast.Constant()) | ast.JoinedStr() | ast.Import() | ast.ImportFrom() | ast.Assert():
            return True
        case _:
            return False


def _parts(node: ast.AST) -> Iterator[ast.AST]:
    """The children of a node in which slips are looked for."""
    skipped = {"annotation", "returns", "decorator_list", "type_params", "bases"}
    if isinstance(node, ast.Raise):
        return  # its message
    for name, value in ast.iter_fields(node):
        if name in skipped or (name == "func" and isinstance(value, ast.Name) and value.id not in _NAMES):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                yield child


def slips(file: str, source: str) -> list[Slip]:
    """All slips of one file."""
    raw = source.encode()
    starts = [0]
    for line in raw.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    found: list[Slip] = []
    counts: dict[str, int] = {}

    def look(node: ast.AST, names: tuple[str, ...]) -> None:
        if _left_alone(node):
            return
        if isinstance(node, ast.expr | ast.stmt):
            where = ".".join(names)
            start = starts[node.lineno - 1] + node.col_offset
            end = starts[(node.end_lineno or node.lineno) - 1] + (node.end_col_offset or 0)
            for text in _changed(node):
                old = raw[start:end].decode()
                if text in (old, f"({old})"):
                    continue
                place = f"{where}: {old} -> {text}"
                counts[place] = counts.get(place, 0) + 1
                found.append(Slip(file, where, node.lineno, start, end, old, text, f"{place} {counts[place]}"))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            names = (*names, node.name)
        for child in _parts(node):
            look(child, names)

    look(ast.parse(source), ())
    return found
