"""Member: what a stack is made of, and the copy of it that a plan works with.

A member (task, constraint, contact) holds *settings*. One object may stand in many stacks, controllers and threads. A
plan therefore never writes into it: it makes its own copy, :meth:`Binding.own`, and calls ``prepare`` on that copy.
What is assigned to the member later is assigned to every copy at the start of that copy's next tick.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from copy import copy
from enum import Enum
from inspect import get_annotations
from operator import attrgetter
from threading import RLock
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeVar, cast, final
from weakref import WeakSet

import numpy as np

from wbc import checks
from wbc.arguments import TellsArguments
from wbc.errors import InvalidInput, MemberFailed, NotCompiled, UnknownAttribute, UnknownName, UnknownPart, WbcError
from wbc.models.model import RobotModel
from wbc.stack.target import Target


class UnknownSetting(UnknownPart, UnknownAttribute):  # type: ignore[misc]  # as UnknownAttribute
    """The object has no attribute of this name that could be assigned."""

    kind = "setting"


#: Held while a member is copied, or its copies are listed: another thread may be making a controller with it.
_LOCK = RLock()
#: Attributes that only say where to go: no weight or gain depends on them.
_FOLLOWED = frozenset({"target", "wrench", "torque", "_reference", "_given"})
#: The unit of what moves or holds a joint, or a row, of this unit.
EFFORTS = {"m": "N", "rad": "N m"}
#: Decided by the class or ``__init__``, or written by ``prepare``: then of every copy its own.
_STRUCTURE = frozenset({"dim", "units", "labels", "convert", "codes"})


class _Role(Enum):
    BUILDING = "its __init__ runs"
    SETTINGS = "built: what users hold"
    OPEN = "a plan's copy that the plan writes into"
    CLOSED = "a plan's copy, to be read"


class _Built(TellsArguments):
    """Tells an object that its ``__init__`` has ended."""

    if not TYPE_CHECKING:  # else constructors would lose their types

        def __call__(cls, *args: Any, **kwargs: Any) -> Any:
            made = super().__call__(*args, **kwargs)
            made.__dict__["_settings"] = frozenset(name for name in made.__dict__ if name[0] != "_")
            made.__dict__["_role"] = _Role.SETTINGS
            return made


def setting(name: str, about: str, read: Callable[[Any, str, Any], Any]) -> Any:
    """A setting that may be assigned between ticks: it is, and ``_name`` holds, ``read(member, name, value)``."""

    def assign(member: Member, value: Any) -> None:
        setattr(member, f"_{name}", read(member, name, value))

    return property(attrgetter(f"_{name}"), assign, doc=about)


class Member(metaclass=_Built):
    """Settings with a name.

    An attribute that does not exist cannot be assigned once ``__init__`` has ended, so that a slip is told.

    Raises:
        UnknownSetting: an assignment to an attribute that does not exist, with the names that are near it.
        InvalidInput: an assignment that a plan with this member cannot take, for example of another size, or of a
            setting in ``read_once``.

    Example:
        >>> from wbc.tasks import Damping
        >>> task = Damping()
        >>> task.weigth = 3.0
        Traceback (most recent call last):
        ...
        wbc.stack.member.UnknownSetting: Damping: there is no setting 'weigth'; did you mean 'weight'?
    """

    dim: int
    units: str | tuple[str, ...]
    #: What rows are called in reports.
    labels: Sequence[str] = ()
    #: What the member acts on, for its default name.
    subject: str = ""
    # A default at class level, so that a subclass which forgets super().__init__ still works.
    _name: str | None = None
    _role: ClassVar[_Role] = _Role.BUILDING
    #: Attributes that are settings beside the properties.
    _settings: ClassVar[frozenset[str]] = frozenset()
    #: Settings that are read when the member is made or compiled, and never again: they cannot be assigned. Those of
    #: the classes above belong to it.
    read_once: ClassVar[frozenset[str]] = frozenset({"frame", "subject"})
    #: The component that changes the member in each tick: a stack with the member must have it, too.
    set_by: object = None
    #: What makes a setting of what is given, in the constructor and where it is assigned: a function of the setting's
    #: full name and the value, such as :func:`wbc.checks.number`.
    checked: ClassVar[Mapping[str, Callable[[str, Any], Any]]] = {}

    def __init_subclass__(cls, **arguments: Any) -> None:
        super().__init_subclass__(**arguments)
        cls.read_once = frozenset().union(*(base.__dict__.get("read_once", ()) for base in cls.__mro__))
        cls.checked = {
            name: check
            for base in reversed(cls.__mro__) for name, check in base.__dict__.get("checked", {}).items()
        }  # fmt: skip

    @property
    def name(self) -> str:
        """Given, or the class and what it acts on."""
        if self._name is not None and checks.text("name", self._name):
            return self._name
        subject = checks.text(f"the subject of {type(self).__name__}", self.subject)
        return f"{type(self).__name__}[{subject}]" if subject else type(self).__name__

    def unit(self, row: int) -> str:
        """Unit of one row."""
        return self.units if isinstance(self.units, str) else self.units[row]

    def label(self, row: int) -> str:
        """What one row is called in reports."""
        return self.labels[row] if self.labels else ""

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        """Instances that make sense on ``model``, for the contract tests; to be written where arguments are needed."""
        del model
        return [cls()]

    def __repr__(self) -> str:
        return self.name

    @property
    def _is_copy(self) -> bool:
        """Whether a plan holds it: what is assigned to the user's one comes here one by one, and was checked there."""
        return self._role is _Role.OPEN or self._role is _Role.CLOSED

    def prepare(self, model: RobotModel) -> None:
        """Called once on each plan's own copy: check arguments against the model, fix sizes.

        What depends on the model is written here and nowhere else, so that one member serves plans of several robots.
        """

    if not TYPE_CHECKING:  # else any attribute could be read and assigned

        def __getattr__(self, name: str) -> Any:
            """Only called for what is not there."""
            if name in ("dim", "units"):
                raise NotCompiled(
                    f"{self.name} has no {name} yet: its rows are known once a stack with it is compiled; "
                    "controller.plan.stack has the compiled members"
                )
            return object.__getattribute__(self, name)  # raises what it raised

        def __setattr__(self, name: str, value: Any) -> None:
            role = self._role
            if role is _Role.BUILDING and name in self.checked:
                object.__setattr__(self, name, self.checked[name](f"{self.name}.{name}", value))
            elif name[0] == "_" or role is _Role.BUILDING or role is _Role.OPEN:
                object.__setattr__(self, name, value)
            elif role is _Role.CLOSED:
                if _is_setting(type(self), name):
                    raise InvalidInput(
                        f"{self.name}.{name}: a plan's members are to be read; a component returns "
                        f"wbc.Overrides(tasks={{{self.name!r}: {{{name!r}: ...}}}})"
                    )
                object.__setattr__(self, name, value)
            else:
                self._assign(name, value)

    def _assign(self, name: str, value: Any) -> None:
        if isinstance(value, np.ndarray):  # copies read it at their next tick: what is written into it until then
            value = value.copy()  # must not reach them
        if name not in self.__dict__ and not hasattr(type(self), name) and name not in _annotated(type(self)):
            known = {n for n in (*dir(type(self)), *self.__dict__) if not n.startswith("_")}
            settings = [n for n in known if n in self.__dict__ or _is_setting(type(self), n)]
            raise UnknownSetting(name, settings, owner=self.name)
        check = self.checked.get(name)
        if check is not None:
            value = check(f"{self.name}.{name}", value)
        # A number and None, or an array and the name of a frame, are other rows.
        is_other_rows = check is not None and (isinstance(value, str) or type(value) is not type(getattr(self, name)))
        # Structure that the class or ``__init__`` decides; any other is what ``prepare`` writes.
        is_fixed = name in _STRUCTURE and bool(name in self._settings or getattr(type(self), name, None))
        if name in self.read_once or is_other_rows or is_fixed:
            raise InvalidInput(
                f"{self.name}.{name} is read once and cannot be assigned; make another {type(self).__name__}, and give "
                "controller.replace a stack with it"
            )
        if name in _STRUCTURE or not (name in self._settings or hasattr(type(self), name)):
            object.__setattr__(self, name, value)  # what ``prepare`` writes, called on the member itself
            return
        with _LOCK:
            ties = tuple(self.__dict__.get("_ties", ()))
        for tie in ties:
            trial = copy(tie.own)
            trial.__dict__["_role"] = _Role.OPEN
            setattr(trial, name, value)
        object.__setattr__(self, name, value)
        with _LOCK:  # those that were copied before the assignment are there by now
            for tie in self.__dict__.get("_ties", ()):
                tie.assigned.pop(name, None)  # what was assigned last comes last
                tie.assigned[name] = value
                tie.binding.is_behind = True

    def __getstate__(self) -> dict[str, Any]:
        """The settings, without what ties them to plans: a copy, or a pickle, is another object."""
        state = self.__dict__.copy()
        state.pop("_ties", None)
        return state


def _is_setting(kind: type[Any], name: str) -> bool:
    found = getattr(kind, name, None)
    return isinstance(found, property) and found.fset is not None


def _annotated(kind: type[Any]) -> set[str]:
    return {name for base in kind.__mro__ for name in get_annotations(base)}


@final
class _Tie:
    """One member and the copy of it: what is assigned to the member, and what the copy was without components."""

    __slots__ = ("__weakref__", "assigned", "base", "binding", "changed", "holders", "member", "own")

    def __init__(self, member: Member, binding: Binding) -> None:
        self.member, self.binding, self.own = member, binding, copy(member)
        #: What the copy is still to be given.
        self.assigned: dict[str, Any] = {}
        self.base: dict[str, Any] | None = None
        #: The version of the binding in which the copy changed last, and the copies that hold it.
        self.changed = 0
        self.holders: list[_Tie] = []

    def restore(self) -> bool:
        """Take back what components changed; whether weights or gains may have been among it."""
        base, self.base = self.base or {}, None
        self.own.__dict__.update(base)
        return not base.keys() <= _FOLLOWED


#: Copies, and the attributes of each that change.
Tried = list[tuple[_Tie, dict[str, Any]]]


@final
class Binding:
    """The copies of a stack's members that the plans of one controller share.

    ``version`` rises whenever copies change; ``stamp`` is the version in which a weight or a gain may have.
    """

    def __init__(self) -> None:
        self._ties: dict[int, _Tie] = {}
        self._tie_of: dict[int, _Tie] = {}
        #: Rises whenever users assigned something to a member.
        self.assigned = 0
        #: Whether they did so since the last ``refresh``.
        self.is_behind = False
        self.stamp = self.version = 0
        self._settings: Mapping[str, Mapping[str, Any]] = {}

    def own(self, value: Any, holder: _Tie | None = None) -> Any:
        """The copy of a member, the same one each time; members that it holds are copied too. Else ``value``."""
        if type(value) in (list, tuple):
            return type(value)(self.own(one, holder) for one in value) if any(map(_holds, value)) else value
        if not isinstance(value, Member):
            return value
        tie = self._ties.get(id(value))
        if tie is None:
            with _LOCK:
                tie = self._ties[id(value)] = _Tie(value, self)
                value.__dict__.setdefault("_ties", WeakSet()).add(tie)
            self._tie_of[id(tie.own)] = tie
            settings = tie.own.__dict__
            for name, inner in settings.items():
                settings[name] = copy(inner) if isinstance(inner, Target) else self.own(inner, tie)
            settings["_role"] = _Role.OPEN
        if holder is not None:
            tie.holders.append(holder)
        return tie.own

    def has_changed(self, member: Member, since: int) -> bool:
        """Whether a copy, or one that it holds, may be another than in the version ``since``."""
        tie = self._tie_of.get(id(member))  # None for what a plan made by itself, of copies
        return tie is None or tie.changed > since

    def _change(self, tie: _Tie, weighs: bool) -> None:
        """The copy is another one in this version, and so is whatever holds it."""
        if weighs:
            self.stamp = self.version
        if tie.changed < self.version:
            tie.changed = self.version
            for holder in tie.holders:
                self._change(holder, weighs)

    def close(self) -> None:
        """Every copy has been prepared: from now on only :meth:`refresh` and :meth:`override` change them."""
        for tie in self._ties.values():
            tie.own.__dict__["_role"] = _Role.CLOSED

    def refuse_missing(self, components: Iterable[object]) -> None:
        """Refuse a member that a component changes in each tick, beside ``components`` without this one.

        Raises:
            InvalidInput: by the member's name.
        """
        there = set(map(id, components))
        for tie in self._ties.values():
            if tie.own.set_by is not None and id(tie.own.set_by) not in there:
                raise InvalidInput(
                    f"{tie.own.name} needs its {type(tie.own.set_by).__name__} in the stack's components, which sets "
                    "it in each tick"
                )

    def refresh(self) -> None:
        """Assign to the copies what was assigned to their members since; where one raises, in the next tick too."""
        if self.is_behind:
            self.is_behind = False  # first: another thread may assign meanwhile
            self.assigned += 1
            try:
                self._assign()
                self._put(self._settings, self.tried(self._settings))
            except Exception:
                self.is_behind = True
                raise

    def given(self, own: Any) -> Any:
        """A copy of one of the copies as users set it, without what is overridden."""
        same = copy(own)
        same.__dict__.update(self._tie_of[id(own)].base or {})
        return same

    def followed(self) -> Iterator[Target]:
        """What the copies follow, and what they would follow were it not overridden."""
        for tie in self._ties.values():
            for value in (*tie.own.__dict__.values(), *(tie.base or {}).values()):
                if isinstance(value, Target):
                    yield value

    def override(self, settings: Mapping[str, Mapping[str, Any]], tried: Tried) -> None:
        """In force are, of the members of these names, ``settings``, which were ``tried`` since the last ``refresh``;
        of all others what users assigned."""
        if settings or self._settings:
            self.version += 1
            self._put(settings, tried)

    def _assign(self) -> None:
        self.version += 1
        for tie in self._ties.values():
            if tie.assigned:
                self._change(tie, tie.restore())
                tie.own.__dict__["_role"] = _Role.OPEN
                try:
                    while tie.assigned:
                        with _LOCK:
                            name, value = next(iter(tie.assigned.items()))
                        self._change(tie, name not in _FOLLOWED)
                        with explained(f"{tie.own.name}.{name}"):
                            setattr(tie.own, name, value)
                        with _LOCK:
                            if tie.assigned.get(name) is value:  # else another thread has assigned again
                                del tie.assigned[name]
                finally:
                    tie.own.__dict__["_role"] = _Role.CLOSED

    def _put(self, settings: Mapping[str, Mapping[str, Any]], tried: Tried) -> None:
        for tie in self._ties.values():
            if tie.base is not None:
                self._change(tie, tie.restore())
        for tie, changed in tried:
            self._change(tie, not changed.keys() <= _FOLLOWED)
            tie.base = {name: tie.own.__dict__.get(name, getattr(type(tie.own), name, None)) for name in changed}
            tie.own.__dict__.update(changed)
        self._settings = settings

    def tried(self, settings: Mapping[str, Mapping[str, Any]]) -> Tried:
        """Of each member named, which attributes of its copy change to what; of one called as its task, that task.

        Raises:
            WbcError: no task of this name, or a value that it refuses.
        """
        found: Tried = []
        for name, values in settings.items():
            tie = next((tie for tie in self._ties.values() if tie.own.name == name), None)
            if tie is None:
                raise UnknownName(name, [tie.own.name for tie in self._ties.values()], "an override speaks of a task")
            if isinstance(task := getattr(tie.own, "task", None), Member) and task.name == name:
                tie = self._tie_of[id(task)]
            trial = copy(tie.own)
            trial.__dict__.update(tie.base or {})
            trial.__dict__["_role"] = _Role.OPEN
            before = dict(trial.__dict__)
            for what, value in values.items():
                if not _is_setting(type(trial), what) or what in trial.read_once:
                    known = [n for n in dir(type(trial)) if _is_setting(type(trial), n) and n not in trial.read_once]
                    raise UnknownSetting(what, known, owner=name)
                setattr(trial, what, value)
            nothing = object()
            found.append((tie, {n: x for n, x in trial.__dict__.items() if before.get(n, nothing) is not x}))
        return found


def _holds(value: Any) -> bool:
    return isinstance(value, Member | list | tuple)


M = TypeVar("M", bound=Member)


def bound(member: M, model: RobotModel) -> M:
    """A copy of ``member`` that is prepared for ``model``; the member itself stays as it is."""
    binding = Binding()
    own = binding.own(member)
    own.prepare(model)
    return cast(M, own)


@final
class explained:  # a context, whose making a tick with new weights pays for each member
    """A call of a member: what goes wrong there, or in its target, is said by its name.

    Raises:
        MemberFailed: it raised; what the library itself refuses is raised as it is.
    """

    __slots__ = ("_where",)

    def __init__(self, where: str) -> None:
        self._where = where

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: object, cause: BaseException | None, trace: object) -> None:
        if isinstance(cause, WbcError | Warning):
            cause.add_note(f"in {self._where}")
        elif isinstance(cause, Exception):
            raise MemberFailed(self._where, cause) from cause
