"""Arguments and methods: what is called with others than it has, or defined with others, is told which it has."""

from __future__ import annotations

import re
from abc import ABCMeta
from collections.abc import Callable, Mapping
from difflib import get_close_matches
from functools import wraps
from inspect import Parameter, Signature, getdoc, isfunction, signature, unwrap
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from wbc.errors import InvalidInput, UnknownPart, warn

_P = ParamSpec("_P")
_T = TypeVar("_T")
#: From this similarity on, of 1, the name of a method looks like a slip of the pen.
_SLIP = 0.8


class UnknownArgument(UnknownPart, TypeError):
    """There is no argument of this name."""

    kind = "argument"

    def _sentence(self) -> str:
        said = super()._sentence()
        return f"{said} It takes {', '.join(self.available)}" if self.near and len(self.available) > 1 else said


class WrongArguments(InvalidInput, TypeError):
    """More arguments by position than are taken, or fewer than are needed."""


class WrongMethod(InvalidInput, TypeError):
    """A class that lacks a method which it needs, or whose method has other arguments than those it is called with."""


class UnknownMethod(UserWarning):
    """A method that nothing calls, named nearly as one that the library calls."""


def tells_arguments(function: Callable[_P, _T]) -> Callable[_P, _T]:
    """The function; where it is called with others than its arguments, it says which ones it has.

    Example:
        >>> import wbc
        >>> wbc.load("arm", bases="fixed")
        Traceback (most recent call last):
        ...
        wbc.arguments.UnknownArgument: load: there is no argument 'bases'; did you mean 'base'? It takes base, feet, packages, q0, robot, srdf
    """  # noqa: E501

    @wraps(function)
    def told(*args: _P.args, **kwargs: _P.kwargs) -> _T:
        try:
            return function(*args, **kwargs)
        except TypeError as error:
            known, of_object = signature(function), "self" in signature(function).parameters
            _refuse(function, [_without_self(function)] if of_object else [known], error, args[of_object:], kwargs)
            raise

    return told


class TellsArguments(ABCMeta):
    """The class of classes that say which arguments and methods they have, where they are called or derived from with
    others.

    Example:
        >>> import wbc
        >>> wbc.Strict(levels=2)
        Traceback (most recent call last):
        ...
        wbc.arguments.UnknownArgument: Strict: there is no argument 'levels'; there are: budget
    """

    def __init__(cls, name: str, bases: tuple[type, ...], names: dict[str, Any], **settings: Any) -> None:
        super().__init__(name, bases, names, **settings)
        above = {
            n: a for base in reversed(cls.__mro__[1:]) for n, a in vars(base).items() if n[0] != "_" and callable(a)
        }
        for method, own in names.items():
            if isfunction(own) and method[0] != "_":
                _check_method(cls, method, own, above)

    if not TYPE_CHECKING:  # else constructors would lose their types

        def __call__(cls, *args: Any, **kwargs: Any) -> Any:
            try:
                return super().__call__(*args, **kwargs)
            except TypeError as error:
                given = [_without_self(base.__init__) for base in cls.__mro__ if isfunction(vars(base).get("__init__"))]
                _refuse(cls, given or [Signature()], error, args, kwargs)
                for method in sorted(cls.__abstractmethods__):
                    raise WrongMethod(f"{cls.__name__} needs a method {method}{_shown(getattr(cls, method))}") from None
                raise

        @property
        def __signature__(cls) -> Signature:
            """Of the constructor: ``help`` and editors would show that of ``__call__``."""
            return _without_self(cls.__init__)


def _without_self(method: Callable[..., Any]) -> Signature:
    read = signature(method)
    return read.replace(parameters=list(read.parameters.values())[1:], return_annotation=Signature.empty)


def _shown(method: Callable[..., Any]) -> str:
    """The arguments of a method, without types."""
    return f"({', '.join(signature(method).parameters)})"


def _check_method(cls: type, name: str, own: Any, above: Mapping[str, Any]) -> None:
    """Refuse a method that cannot be called as the one ``above`` is; doubt one whose name is nearly another's.

    Raises:
        WrongMethod: it takes fewer arguments by position, or needs more.
    """
    if isfunction(above.get(name)):
        own, known = unwrap(own), unwrap(above[name])
        needed, most = own.__code__.co_argcount - len(own.__defaults__ or ()), own.__code__.co_argcount
        takes_any = own.__code__.co_flags & 0x04  # *args
        if known.__code__.co_argcount < needed or (known.__code__.co_argcount > most and not takes_any):
            raise WrongMethod(f"{cls.__name__}.{name} takes {_shown(own)}; it is called with {_shown(known)}")
    elif name not in above:
        others = [n for n, method in above.items() if isfunction(method) and n not in vars(cls)]
        for near in get_close_matches(name, others, n=1, cutoff=_SLIP):
            warn(f"{cls.__name__}.{name}: did you mean {near}{_shown(above[near])}?", UnknownMethod)


def _refuse(
    called: Any, known: list[Signature], error: TypeError, args: tuple[Any, ...], kwargs: Mapping[str, Any]
) -> None:
    """Say which arguments there are where something was called with others.

    ``known`` is the signature of what was called, and those of what its ``**kwargs`` are handed on to.
    """
    owner, own, names = called.__qualname__.rpartition("<locals>.")[2], known[0].parameters, dict[str, Parameter]()
    for handed, one in enumerate(known):
        names |= {name: p for name, p in one.parameters.items() if p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)}
        if all(p.kind is not p.VAR_KEYWORD for p in one.parameters.values()):
            for name in kwargs:
                if name not in names and (not handed or repr(name) in str(error)):
                    raise UnknownArgument(name, names, owner) from None
            break
    first = [name for name, p in own.items() if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    others = [name for name, p in own.items() if p.kind is p.KEYWORD_ONLY]
    takes = f"{', '.join(first) or 'nothing'} by position and {', '.join(f'{n}=' for n in others) or 'nothing'} by name"
    if len(args) > len(first) and all(p.kind is not p.VAR_POSITIONAL for p in own.values()):
        raise WrongArguments(f"{owner} takes {takes}, not {len(args)} arguments by position") from None
    missing = [n for n in [*first[len(args) :], *others] if own[n].default is Parameter.empty and n not in kwargs]
    if missing:
        text = re.sub(r":\w+:`~?([^`]+)`|``", r"\1", getdoc(called) or "")
        said = dict(re.findall(r"^ +(\w+): (.+)$", text, re.MULTILINE))
        needs = ", ".join(f"{n}= ({said[n].rstrip('.')})" if n in said else f"{n}=" for n in missing)
        raise WrongArguments(f"{owner} needs {needs}; it takes {takes}") from None
