"""Every exception this library raises on purpose, under one base class.

Errors are raised while something is *built* (a QP, a model, a stack, a controller); a tick
answers with a :class:`~wbc.types.Status` instead. Each message says what was wrong, where,
and what is possible.

Example:
    >>> from wbc.errors import UnknownFrame
    >>> print(UnknownFrame("left_foot", ["left_sole", "right_sole", "torso"]))
    there is no frame 'left_foot'; did you mean 'left_sole'?
"""

from __future__ import annotations

import difflib
import sys
import warnings
from collections.abc import Iterable
from copyreg import __newobj__ as newobj  # type: ignore[attr-defined]  # private by its name, documented for pickles
from pathlib import Path
from typing import Any

#: The folders of this library.
_LIBRARY = (Path(__file__).parent, Path(__file__).parent.parent / "tasks")


def _is_ours(path: Path) -> bool:
    """Whether a source file is of this library; a user may have modules of the same names."""
    return any(path.is_relative_to(folder) for folder in _LIBRARY)


def warn(sentence: str, kind: type[Warning] = UserWarning) -> None:
    """Warn at the line of the user's code that called this library, however deep in the library that is noticed."""
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and _is_ours(Path(frame.f_code.co_filename)):
        frame, level = frame.f_back, level + 1
    warnings.warn(sentence, kind, stacklevel=level)


class WbcError(Exception):
    """Base class: catch this to catch everything the library refuses."""

    def __reduce__(self) -> tuple[Any, ...]:
        """The same error with the same sentence, in another process too: what it was made of is not asked again."""
        return newobj, (type(self), *self.args), self.__dict__


class InvalidInput(WbcError, ValueError):
    """An argument has a wrong shape, value or sign; the message names it."""


class MemberFailed(InvalidInput):
    """A task, constraint, contact or component that raised, or gave what makes no sense; the message names it.

    A tick does not raise it: it answers with a bounded fallback command, and ``controller.why`` is this message.
    """

    def __init__(self, where: str, cause: BaseException) -> None:
        super().__init__(f"{where} raised {type(cause).__name__}: {_text_of(cause)}{_place_of(cause)}")


class InvalidProblem(InvalidInput):
    """A quadratic program that no solver may see: NaN, crossed bounds, asymmetric cost, wrong shapes."""


class Infeasible(InvalidInput):
    """Rows that contradict each other in every state; ``conflict`` says which, ``qp`` is the problem they make."""

    def __init__(self, sentence: str, *, conflict: object, qp: object) -> None:
        self.conflict, self.qp = conflict, qp
        super().__init__(sentence)


class NotSupported(WbcError):
    """A combination that has no meaning, such as torque limits at the velocity level."""


class NoClosedForm(NotSupported):
    """The method has no closed form with these options; use ``solve``."""


class SolverMissing(WbcError):
    """A known solver whose package is not installed."""

    def __init__(self, name: str, package: str) -> None:
        self.name = name
        self.package = package
        super().__init__(f"solver {name!r} is not installed; pip install {package}")


class SolverFailed(WbcError):
    """A solver ended without an answer and without knowing that there is none."""

    def __init__(self, name: str, status: object) -> None:
        self.name = name
        self.status = status
        super().__init__(f"solver {name!r} gave no answer: {status}; try another")


class ModelError(WbcError):
    """A robot description that cannot be read, or that is not a robot."""


class PathRefused(ModelError):
    """A file outside the folders a model may read."""


class SimulationError(WbcError):
    """The physics and the model disagree, or the physics diverged."""


class UnknownName(WbcError, LookupError):
    """A name that does not exist, with the names that are near it."""

    kind = "name"

    def __init__(self, name: object, available: Iterable[str], hint: str = "") -> None:
        self.name = name
        self.available = sorted(set(available))
        self.near = near_names(name, self.available)
        super().__init__(self._sentence() + (f" ({hint})" if hint else ""))

    def _sentence(self) -> str:
        if self.near:
            return f"there is no {self.kind} {self.name!r}; did you mean {_either(self.near)}?"
        shown = ", ".join(self.available[:12]) + (", …" if len(self.available) > 12 else "")
        return f"there is no {self.kind} {self.name!r}; there are: {shown or 'none'}"


class UnknownAttribute(UnknownName, AttributeError):  # type: ignore[misc]  # both have a name: the one asked for
    """No such attribute; nothing was assigned."""

    kind = "attribute"

    def __reduce__(self) -> tuple[Any, ...]:
        make, given, about = super().__reduce__()
        return make, given, about | {"name": self.name}  # which stands where AttributeError has it


class UnknownPart(UnknownName):
    """A name that ``owner`` does not have."""

    def __init__(self, name: str, available: Iterable[str], owner: str) -> None:
        self.owner = owner
        super().__init__(name, available)

    def _sentence(self) -> str:
        return f"{self.owner}: {super()._sentence()}"


class UnknownArray(UnknownPart, UnknownAttribute):  # type: ignore[misc]  # as UnknownAttribute
    """The rows that a member fills have no array of this name."""

    kind = "array"


class NotCompiled(WbcError, AttributeError):
    """What follows from the robot, asked of a member that no plan has been made with."""


class UnknownFrame(UnknownName):
    """No such frame in the model."""

    kind = "frame"


class UnknownJoint(UnknownName):
    """No such joint in the model."""

    kind = "joint"


class UnknownContact(UnknownName):
    """No such contact in the stack."""

    kind = "contact"


class UnknownSlot(UnknownName):
    """No such slot on the device."""

    kind = "slot"


class UnknownMapping(UnknownName):
    """No mapping from a person to the robot comes with the library."""

    kind = "mapping for"


class UnknownConfiguration(UnknownName):
    """No such named configuration of the robot."""

    kind = "configuration"


class UnknownRobot(UnknownName):
    """No such robot, and no such file."""

    kind = "robot"


class UnknownSolver(UnknownName):
    """No such QP solver; ``told`` says which are installed, and how others are."""

    kind = "solver"

    def __init__(self, name: object, available: Iterable[str], told: str = "") -> None:
        self._told = told
        super().__init__(name, available)

    def _sentence(self) -> str:
        if self.near or not self._told:
            return super()._sentence()
        return f"there is no solver {self.name!r}; {self._told}"


class UnknownScenario(UnknownName):
    """No such scenario."""

    kind = "scenario"


def _text_of(cause: BaseException) -> str:
    try:
        return str(cause)
    except Exception as worse:
        return f"(its text raised {type(worse).__name__})"


def _place_of(cause: BaseException) -> str:
    """The last line of code outside this library and of installed packages that was running, if any was."""
    place, at = "", cause.__traceback__
    while at is not None:
        path = Path(at.tb_frame.f_code.co_filename)
        if "site-packages" not in path.parts and not _is_ours(path):
            place = f" ({path.name}, line {at.tb_lineno})"
        at = at.tb_next
    return place


def near_names(name: object, names: Iterable[str]) -> list[str]:
    """At most three of ``names`` that look like ``name``, best first; capital letters do not count."""
    known = {one.casefold(): one for one in names}
    return [known[near] for near in difflib.get_close_matches(str(name).casefold(), known, n=3, cutoff=0.55)]


def _either(names: list[str]) -> str:
    quoted = [repr(n) for n in names]
    return quoted[0] if len(quoted) == 1 else ", ".join(quoted[:-1]) + " or " + quoted[-1]
