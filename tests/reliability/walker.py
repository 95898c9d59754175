"""Every call in the examples of the public docstrings, each argument replaced in turn by nonsense.

The example of a class or function is a sound use of it: its statements are run, and each call in them of something of
ours is made again for each argument and each value of :func:`nonsense`. What comes out may be an answer or an error of
the library; nothing else. Numbers without sense are answered only where ``taken.toml`` says so, and what refuses them
names the argument or shows the number.
"""

from __future__ import annotations

import ast
import doctest
import inspect
import io
import re
import tomllib
import warnings
from collections.abc import Iterator
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np

import wbc
import wbc.methods
import wbc.models
import wbc.robots
import wbc.tasks
import wbc.testing
from wbc.errors import WbcError

#: How a refusal shows a value of :func:`nonsense`.
SHOWN = {"nan": "nan", "inf": "inf", "negative": "-1", "zero": "0", "text": "nonsense"}
#: For each number, the arguments that take it: "callee.argument".
TAKEN: dict[str, list[str]] = tomllib.loads(Path(__file__).with_name("taken.toml").read_text(encoding="utf-8"))
#: What refuses these says why they do not fit the others, or where they lead.
ELSEWHERE = {
    "Ros2Port",
    "RobotKinematics.urdf_path",
    "JointLimits.tau_max",
    "JointLimits.no_load_speed",
    "Reading.time",
}


def nonsense() -> dict[str, Any]:
    """Values that are no argument of anything, or of very little."""
    return {
        "nan": np.nan, "inf": np.inf, "text": "nonsense", "complex": 1j, "date": np.datetime64("2026-01-01"),
        "None": None, "another shape": np.zeros((2, 3, 4)), "huge": 1e300, "an object": object(), "negative": -1,
        "a list of text": ["a", "b"], "NaN among numbers": np.array([0.0, np.nan, 0.0]), "beyond floats": 10**400,
        "a mapping": {"a": 1.0}, "zero": 0,
    }  # fmt: skip


def public() -> dict[str, Any]:
    """Classes and functions that a user may call, by the name they are imported by."""
    found: dict[str, Any] = {}
    for package in (wbc, wbc.methods, wbc.models, wbc.robots, wbc.tasks, wbc.testing):
        for name in sorted({*dir(package), *getattr(package, "__all__", ())}):
            value = getattr(package, name)
            if not name.startswith("_") and callable(value) and _is_ours(value):
                found.setdefault(f"{value.__module__}.{value.__qualname__}", value)
    return found


def _is_ours(value: Any) -> bool:
    return str(getattr(value, "__module__", "")).partition(".")[0] == "wbc"


def examples(thing: Any) -> Iterator[str]:
    """The sources of its docstring's examples, and of those of its own methods."""
    documented = [thing]
    if inspect.isclass(thing):
        documented += [value for name, value in vars(thing).items() if not name.startswith("_")]
    for one in documented:
        text = getattr(one, "__doc__", None)
        source = "".join(example.source for example in doctest.DocTestParser().get_examples(text or ""))
        if source:
            yield source


def faults(source: str) -> Iterator[tuple[str, str]]:
    """Calls of the example that raised what is no error of the library: (callee, argument, value), exception."""
    names: dict[str, Any] = {"__name__": "example"}
    for statement in ast.parse(source).body:
        for call in (node for node in ast.walk(statement) if isinstance(node, ast.Call)):
            yield from _of_call(call, dict(names))
        try:
            exec(compile(ast.Module([statement], []), "<example>", "exec"), names)
        except Exception:  # an example may show a refusal
            continue


def _of_call(call: ast.Call, names: dict[str, Any]) -> Iterator[tuple[str, str]]:
    try:
        function = _value(call.func, names)
        makes = inspect.isclass(getattr(function, "__self__", None))
        if not (_is_ours(function) and (makes or inspect.isclass(function) or inspect.isfunction(function))):
            return  # methods are called with models and states, by plans
        positional = [_value(argument, names) for argument in call.args]
        named = {word.arg: _value(word.value, names) for word in call.keywords if word.arg}
        function(*positional, **named)
    except (
        Exception
    ):  # inside a comprehension or a lambda there are names that are not there yet; an example may show a refusal
        return
    places: list[int | str] = [*range(len(positional)), *named, *_others(function, positional, named)]
    for place in places:
        for what, value in nonsense().items():
            arguments, words = list(positional), dict(named)
            if isinstance(place, int):
                arguments[place] = value
            else:
                words[place] = value
            name = f"{function.__qualname__}.{_name(function, place)}"
            try:
                function(*arguments, **words)
            except WbcError as refused:
                said = str(refused)
                if what in SHOWN and not _told(name, SHOWN[what], said):
                    yield f"{name}: {what}", f"not named in: {said[:100]}"
            except Exception as cause:
                yield f"{name}: {what}", f"{type(cause).__name__}: {str(cause)[:100]}"
            else:
                if name not in TAKEN.get(what, [name]):
                    yield f"{name}: {what}", "taken"


def _told(name: str, value: str, said: str) -> bool:
    words = (name.rpartition(".")[2], rf"(?<![\w.]){re.escape(value)}\b")
    return not ELSEWHERE.isdisjoint((name, name.partition(".")[0])) or any(re.search(word, said) for word in words)


def _name(function: Any, place: int | str) -> str:
    """The name of the argument at a place; "*" where it is one of any number."""
    if isinstance(place, str):
        return place
    parameters = list(inspect.signature(function).parameters.values())
    one = parameters[place] if place < len(parameters) else parameters[-1]
    return "*" if one.kind is inspect.Parameter.VAR_POSITIONAL else one.name


def _others(function: Any, positional: list[Any], named: dict[str, Any]) -> list[str]:
    """Arguments by name that the example leaves at their defaults."""
    try:
        signature = inspect.signature(function.__init__ if inspect.isclass(function) else function)
    except (TypeError, ValueError):
        return []
    parameters = [p for p in signature.parameters.values() if p.name != "self"]
    free = parameters[len(positional) :]
    by_name = (inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    return [p.name for p in free if p.kind in by_name and p.name not in named]


def _value(node: ast.expr, names: dict[str, Any]) -> Any:
    return eval(compile(ast.Expression(node), "<example>", "eval"), names)


def walk(thing: Any) -> list[tuple[str, str]]:
    """All faults of one public class or function."""
    with warnings.catch_warnings(), redirect_stdout(io.StringIO()):
        warnings.simplefilter("ignore")
        return [fault for source in examples(thing) for fault in faults(source)]
