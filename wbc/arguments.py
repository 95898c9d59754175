"""Arguments: a class that is called with others than it has says which ones it has."""

from __future__ import annotations

from abc import ABCMeta
from collections.abc import Mapping
from inspect import Parameter, Signature, signature
from typing import TYPE_CHECKING, Any

from wbc.errors import InvalidInput, UnknownPart


class UnknownArgument(UnknownPart, TypeError):
    """The constructor has no argument of this name."""

    kind = "argument"

    def _sentence(self) -> str:
        said = super()._sentence()
        return f"{said} It takes {', '.join(self.available)}" if self.near and len(self.available) > 1 else said


class WrongArguments(InvalidInput, TypeError):
    """More arguments by position than the constructor takes."""


class TellsArguments(ABCMeta):
    """The class of classes that say which arguments they have, where they are called with others.

    Example:
        >>> import wbc
        >>> wbc.Strict(levels=2)
        Traceback (most recent call last):
        ...
        wbc.arguments.UnknownArgument: Strict: there is no argument 'levels'; there are: budget
    """

    if not TYPE_CHECKING:  # else constructors would lose their types

        def __call__(cls, *args: Any, **kwargs: Any) -> Any:
            try:
                return super().__call__(*args, **kwargs)
            except TypeError:
                _refuse(cls.__name__, signature(cls), args, kwargs)
                raise

        @property
        def __signature__(cls) -> Signature:
            """Of the constructor: ``help`` and editors would show that of ``__call__``."""
            read = signature(cls.__init__)
            return read.replace(parameters=list(read.parameters.values())[1:], return_annotation=Signature.empty)


def _refuse(owner: str, known: Signature, args: tuple[Any, ...], kwargs: Mapping[str, Any]) -> None:
    """Say which arguments a constructor has, where one is called with others."""
    kinds = {name: parameter.kind for name, parameter in known.parameters.items()}
    for name in () if Parameter.VAR_KEYWORD in kinds.values() else kwargs:
        if name not in kinds:
            raise UnknownArgument(name, kinds, owner) from None
    first = [name for name, kind in kinds.items() if kind in (kind.POSITIONAL_ONLY, kind.POSITIONAL_OR_KEYWORD)]
    others = [f"{name}=" for name, kind in kinds.items() if kind is kind.KEYWORD_ONLY]
    if Parameter.VAR_POSITIONAL not in kinds.values() and len(args) > len(first):
        raise WrongArguments(
            f"{owner} takes {', '.join(first) or 'nothing'} by position and {', '.join(others) or 'nothing'} by name, "
            f"not {len(args)} arguments by position"
        ) from None
