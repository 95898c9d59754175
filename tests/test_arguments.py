"""What is called with wrong arguments, or derived from with wrong methods, says which ones there are."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from inspect import Parameter
from typing import Any

import numpy as np
import pytest

import wbc
import wbc.tasks
from wbc.arguments import UnknownArgument, UnknownMethod, WrongArguments, WrongMethod
from wbc.errors import InvalidInput, MemberFailed, UnknownArray, UnknownFrame, WbcError
from wbc.methods import Method
from wbc.models.feet import Foot, Guessed
from wbc.robots import Loop
from wbc.sim.mujoco_ import MujocoPlant, PhysicsSettings
from wbc.sim.plant import ForwardDynamicsPlant, IntegratorPlant
from wbc.sim.scenario import Check
from wbc.sim.simulate import simulate
from wbc.sim.trial import Setup
from wbc.tasks import Position, Posture
from wbc.testing import check_task

ARM = wbc.load("arm")
LEVEL = wbc.VelocityLevel()
#: What the library makes and users read, and tuples, which have fields and no constructor of ours.
MADE = {"Certificate", "Command", "Motor", "Row", "Solution", "Status"}


def called() -> Iterator[Any]:
    """What users call by a name of ``wbc`` or ``wbc.tasks``, and around simulations."""
    yield from (getattr(wbc, name) for name in wbc._HOME if name not in MADE)
    yield from (value for name, value in vars(wbc.tasks).items() if name[0] != "_" and _is_called(value))
    yield from (value for value in vars(wbc.methods).values() if inspect.isclass(value) and issubclass(value, Method))
    yield from (
        simulate,
        MujocoPlant,
        IntegratorPlant,
        ForwardDynamicsPlant,
        PhysicsSettings,
        Check,
        Setup,
        Foot,
        Loop,
        check_task,
    )


def _is_called(value: Any) -> bool:
    is_error = inspect.isclass(value) and issubclass(value, BaseException)
    is_own = getattr(value, "__module__", "").startswith("wbc.tasks")
    return (inspect.isclass(value) or inspect.isfunction(value)) and not is_error and is_own


@pytest.mark.parametrize("what", dict.fromkeys(called()), ids=lambda what: what.__name__)
def test_unknown_and_missing_arguments_are_named_with_those_that_there_are(what: Any) -> None:
    arguments = inspect.signature(what).parameters
    needed = [
        name
        for name, one in arguments.items()
        if one.default is Parameter.empty and one.kind not in (Parameter.VAR_KEYWORD, Parameter.VAR_POSITIONAL)
    ]
    if all(one.kind is not Parameter.VAR_KEYWORD for one in arguments.values()):
        with pytest.raises(UnknownArgument, match="there is no argument 'nothing_like_it'") as refused:
            what(nothing_like_it=1)
        assert set(refused.value.available) == set(arguments) and isinstance(refused.value, TypeError)
    if needed and not inspect.isabstract(what):
        with pytest.raises(WrongArguments) as refused_none:
            what()
        sentence = str(refused_none.value)
        assert all(f"{name}=" in sentence for name in needed) and isinstance(refused_none.value, TypeError)
        assert "\n" not in sentence


def test_a_missing_argument_is_explained_where_it_is_documented() -> None:
    with pytest.raises(WrongArguments, match=r"Controller needs level= \(VelocityLevel\(\), AccelerationLevel\(\) or"):
        wbc.Controller(ARM, wbc.Stack([Posture(ARM.q0)]))  # type: ignore[call-arg]
    controller = wbc.Controller(ARM, wbc.Stack([Posture(ARM.q0)]), level=LEVEL)
    with pytest.raises(UnknownArgument, match=r"Controller\.replace: there is no argument 'time'"):
        controller.replace(wbc.Stack([Posture(ARM.q0)]), time=0.1)  # type: ignore[call-arg]
    with pytest.raises(WrongArguments, match=r"Controller\.explain takes nothing by position and save= by name, not 1"):
        controller.explain("file.npz")  # type: ignore[misc]


class Handing(wbc.Task):
    """Hands on what it does not know."""

    dim, units = 1, "m"

    def __init__(self, frame: str, **settings: Any) -> None:
        super().__init__(**settings)

    def fill(self, state: Any, out: Any) -> None: ...


def test_what_is_handed_on_is_known_and_capital_letters_do_not_matter() -> None:
    with pytest.raises(UnknownArgument, match=r"Handing: there is no argument 'Kp'; did you mean 'kp'\?"):
        Handing("tool", Kp=3.0)
    stack = wbc.Stack([Position("TOOL", target=[0.0, 0.0, 0.0])])
    with pytest.raises(UnknownFrame, match="did you mean 'tool'") as refused:
        wbc.Controller(ARM, stack, level=LEVEL)
    assert "in Position[TOOL].prepare" in refused.value.__notes__


@pytest.mark.parametrize(
    ("base", "body", "said"),
    [
        (wbc.Task, {"fill": lambda self, state: None}, r"K\.fill takes \(self, state\); it is called with"),
        (wbc.Task, {"fill": lambda self, q, v, out: None}, r"it is called with \(self, state, out\)"),
        (wbc.Contact, {"fill": lambda self, state, out: None}, r"called with \(self, state, anchor, out\)"),
        (wbc.Component, {"before": lambda self, state: None}, r"called with \(self, state, last, plan\)"),
        (wbc.Component, {"signals": lambda self, state: None}, r"called with \(self\)"),
    ],
)
def test_a_method_with_other_arguments_is_refused_where_it_is_defined(base: Any, body: Any, said: str) -> None:
    with pytest.raises(WrongMethod, match=said):
        type(base)("K", (base,), body)


def test_a_method_may_take_more_than_it_is_given() -> None:
    body = {"before": lambda self, *given: None, "reset": lambda self, state, hard=False: None, "own": lambda self: 0}
    type(wbc.Component)("K", (wbc.Component,), body)  # nothing is said: warnings are errors


@pytest.mark.parametrize(
    ("base", "slip", "meant"),
    [(wbc.Component, "befor", "before"), (wbc.Component, "signal", "signals"), (wbc.Task, "fil", "fill")],
)
def test_a_misspelt_method_is_told_where_it_is_defined(base: Any, slip: str, meant: str) -> None:
    with pytest.warns(UnknownMethod, match=rf"K\.{slip}: did you mean {meant}\(self") as said:
        type(base)("K", (base,), {slip: lambda self: None})
    assert len(said) == 1


def test_a_missing_method_is_named_with_its_arguments() -> None:
    class Without(wbc.Task):
        """Nothing."""

    with pytest.raises(WrongMethod, match=r"Without needs a method fill\(self, state, out\)"):
        Without()  # type: ignore[abstract]


def made(**body: Any) -> Any:
    """A task of these."""
    return type(wbc.Task)("Mine", (wbc.Task,), body)()


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ({}, r"Mine\.dim is None; set it, and units, in __init__"),
        ({"dim": "3", "units": "m"}, r"Mine\.dim is '3'"),
        ({"dim": 3.0, "units": "m"}, r"Mine\.dim is 3\.0"),
        ({"dim": 3}, r"Mine\.units is None; set it in __init__: a text, or 3"),
        ({"dim": 3, "units": ("m", "m")}, r"Mine\.units is \('m', 'm'\)"),
    ],
)
def test_a_task_without_rows_or_units_is_refused_by_name(rows: Any, said: str) -> None:
    task = made(fill=lambda self, state, out: None, **rows)
    for use in (lambda: wbc.Controller(ARM, wbc.Stack([task]), level=LEVEL), lambda: check_task(task, ARM)):
        with pytest.raises(WbcError, match=said):
            use()


def test_what_a_method_raises_is_told_by_its_name_and_line() -> None:
    def fill(self: Any, state: Any, out: Any) -> None:
        out.J[:] = np.zeros((6, ARM.nv))

    task, line = made(fill=fill, dim=3, units="m"), fill.__code__.co_firstlineno + 1
    for use in (lambda: wbc.Controller(ARM, wbc.Stack([task]), level=LEVEL), lambda: check_task(task)):
        with pytest.raises(
            MemberFailed, match=rf"Mine\.fill raised ValueError: .* \(test_arguments\.py, line {line}\)"
        ):
            use()


def test_a_users_own_module_called_tasks_is_a_users() -> None:
    """Warnings and failures stand at its line."""
    text = """
import numpy as np, wbc
class Mine(wbc.Task):
    dim, units = 1, "m"
    def fill(self, state, out):
        raise ValueError("oh")
def make(robot):
    wbc.load(robot, base="floating", feet=["tool"])
"""
    own: dict[str, Any] = {"__name__": "tasks"}
    exec(compile(text, "/home/me/tasks.py", "exec"), own)
    with pytest.raises(MemberFailed, match=r"\(tasks\.py, line 6\)"):
        wbc.Controller(ARM, wbc.Stack([own["Mine"]()]), level=LEVEL)
    with pytest.warns(Guessed) as said:
        own["make"](ARM.pinocchio)
    assert [(one.filename, one.lineno) for one in said] == [("/home/me/tasks.py", 8)]


def test_rows_that_there_are_not_are_named_with_those_that_there_are() -> None:
    def fill(self: Any, state: Any, out: Any) -> None:
        out.jacobian = np.zeros((3, ARM.nv))

    task = made(fill=fill, dim=3, units="m")
    for use in (lambda: wbc.Controller(ARM, wbc.Stack([task]), level=LEVEL), lambda: check_task(task)):
        with pytest.raises(
            UnknownArray, match=r"out: there is no array 'jacobian'; there are: J, acc_ref, .*drift, e,"
        ):
            use()
    with pytest.raises(InvalidInput, match=r"left NaN in out\.e\[0\]; write it, as by out\.e\[:\] = …"):
        wbc.Controller(ARM, wbc.Stack([made(fill=lambda self, state, out: (0.0, 1.0), dim=1, units="m")]), level=LEVEL)


def test_messages_show_what_was_given_on_one_line() -> None:
    stack = wbc.Stack([Posture(ARM.q0)])
    for swapped in (
        lambda: wbc.Controller(stack, ARM, level=LEVEL),  # type: ignore[arg-type]
        lambda: wbc.reach(ARM, stack),  # type: ignore[arg-type]
        lambda: wbc.solve(np.eye(9)),  # type: ignore[arg-type]
    ):
        with pytest.raises(WbcError) as refused:
            swapped()
        assert "\n" not in str(refused.value)


def test_what_wbc_does_not_have_may_be_in_the_library() -> None:
    with pytest.raises(AttributeError, match=r"no attribute 'Position'; tasks, limits, .* are in wbc\.tasks"):
        _ = wbc.Position  # type: ignore[attr-defined]
