"""Settings and results are values: pickled or copied, they are equal objects that work, apart from the first."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

import tasks as T
import wbc
from tests.stack.conftest import moving, standing
from tests.tasks.test_contract import MEMBERS
from wbc.control.recorder import Run
from wbc.errors import SolverFailed, SolverMissing, UnknownName, WbcError
from wbc.qp import solvers
from wbc.testing import robots

ARM, QUADRUPED = robots()[:2]
WAYS: dict[str, Callable[[Any], Any]] = {
    "pickle": lambda value: pickle.loads(pickle.dumps(value)),
    "deepcopy": copy.deepcopy,
    "copy": copy.copy,
}
pytestmark = pytest.mark.parametrize("way", WAYS)


def test_every_member_of_the_library(way: str) -> None:
    for member in (sample for kind in MEMBERS for robot in robots() for sample in kind.samples(robot)):
        same = WAYS[way](member)
        assert same is not member and type(same) is type(member) and repr(same) == repr(member)
        for wrapped in ("exactly", "scaled", "softly", "with_reaction"):
            if hasattr(member, wrapped):
                assert repr(WAYS[way](getattr(member, wrapped)())) == repr(getattr(member, wrapped)())


def ticked(robot: Any, stack: wbc.Stack, seed: int = 3) -> wbc.Command:
    q, v = moving(robot, seed)
    return wbc.Controller(robot, stack, level=wbc.InverseDynamics()).tick(0.0, q, v)


def test_a_stack_decides_the_same_and_is_apart(way: str) -> None:
    stack = standing(QUADRUPED)
    same = WAYS[way](stack)
    np.testing.assert_array_equal(ticked(QUADRUPED, same).tau, ticked(QUADRUPED, stack).tau)
    if way != "copy":
        same.tasks[0].weight = 5.0
        assert stack.tasks[0].weight == 1.0


def test_a_member_that_has_been_in_a_controller_is_its_settings(way: str) -> None:
    task = T.Posture(ARM.q0)
    first = wbc.Controller(ARM, wbc.Stack([task]), level=wbc.AccelerationLevel())
    first.tick(0.0, ARM.q0, np.zeros(7))
    same = WAYS[way](task)
    second = wbc.Controller(ARM, wbc.Stack([same]), level=wbc.AccelerationLevel())
    same.kp = 400.0
    q = ARM.q0 + 0.1
    np.testing.assert_allclose(second.tick(0.0, q, np.zeros(7)).a, 4.0 * first.tick(1e-3, q, np.zeros(7)).a, rtol=1e-6)


def test_a_command_is_its_values(way: str) -> None:
    for stack, robot in ((standing(QUADRUPED), QUADRUPED), (wbc.Stack([T.Posture(ARM.q0)]), ARM)):
        levels = [wbc.InverseDynamics(), wbc.AccelerationLevel(), wbc.VelocityLevel()]
        for level in levels if robot is ARM else levels[:1]:
            command = wbc.Controller(robot, stack, level=level).tick(0.0, *moving(robot, 1))
            same = WAYS[way](command)
            for what in ("tau", "a", "v", "q"):
                np.testing.assert_array_equal(getattr(same, what), getattr(command, what))
            assert (same.status, same.fallback_level, same.certificate) == (
                command.status,
                command.fallback_level,
                command.certificate,
            )
            assert list(same.f) == list(command.f) and repr(same) == repr(command)
            for name, wrench in command.f.items():
                np.testing.assert_array_equal(same.f[name], wrench)
            with pytest.raises(WbcError, match=r"has no solution; read command\.solution before"):
                _ = same.solution
            x = command.solution.x
            np.testing.assert_array_equal(WAYS[way](command).solution.x, x)


def test_solvers_levels_hierarchies_and_settings(way: str) -> None:
    values: list[Any] = [wbc.Weighted(), wbc.Strict(), wbc.Scaled(), wbc.Recovery(hold_ticks=3), wbc.Watchdog(late=2.0)]
    values += [wbc.VelocityLevel(), wbc.AccelerationLevel(regularisation=1e-6), wbc.InverseDynamics()]
    values += [solvers.by_name(name) for name in wbc.solvers()]
    for value in values:
        assert WAYS[way](value) == value
    qp = wbc.QP(np.eye(2), [1.0, -1.0], lb=[0.0, 0.0])
    for name in wbc.solvers():
        same = WAYS[way](solvers.by_name(name))
        np.testing.assert_array_equal(wbc.solve(qp, same).x, wbc.solve(qp, name).x)


def test_components_before_and_after_ticks(way: str) -> None:
    observer = T.MomentumObserver(gain=50.0, threshold=2.0)
    reaction = T.FaultReaction(observer)
    adaptive = T.SlotineLi(ARM.q0, kp=50.0, kd=20.0, gain=0.1)
    stack = wbc.Stack(
        [adaptive.torque, T.Posture(ARM.q0, weight=1e-3), reaction.limits], subject_to=[T.TorqueLimits()],
        components=[observer, reaction, adaptive, T.MeasuredWrench("tool")],
    )  # fmt: skip
    for component in stack.components:
        assert repr(WAYS[way](component)) == repr(component)
    before = ticked(ARM, stack)
    for component in stack.components:
        same = WAYS[way](component)
        assert same.signals().keys() == component.signals().keys()
    if way != "copy":
        np.testing.assert_array_equal(ticked(ARM, WAYS[way](stack)).tau, before.tau)
    schedule = T.ContactSchedule([(0.0, ["a", "b"]), (1.0, ["a"])], period=2.0)
    assert WAYS[way](schedule).holds("b") == schedule.holds("b")


def test_a_controller_is_made_anew_from_its_settings(way: str) -> None:
    stack = wbc.Stack(
        [T.Position("tool", target=[0.4, 0.2, 0.5]), T.Damping(weight=1e-2)], subject_to=[T.JointLimits()]
    )
    controller = wbc.Controller(ARM, stack, level=wbc.AccelerationLevel(), hierarchy=wbc.Strict(), dt=2e-3)
    q, v = moving(ARM, 2)
    controller.tick(0.0, q, v)
    same = WAYS[way](controller)
    assert same.dt == 2e-3 and same.ticks == 0
    np.testing.assert_allclose(same.tick(0.0, q, v).a, controller.tick(0.0, q, v).a, atol=1e-9)


def test_a_copy_of_a_controller_leaves_the_memory_of_components_alone(way: str) -> None:
    observer = T.MomentumObserver(gain=100.0, threshold=1.0)
    stack = wbc.Stack([T.Posture(ARM.q0)], subject_to=[T.TorqueLimits()], components=[observer])
    controller = wbc.Controller(ARM, stack, level=wbc.InverseDynamics())
    for k in range(3):
        controller.tick(1e-3 * k, ARM.q0, np.full(ARM.nv, 0.1 * k))
    known = observer.signals()["residual"].copy()
    same = WAYS[way](controller)
    assert same.components[0] is not observer and same.stack.tasks[0] is not stack.tasks[0]
    assert known.any() and np.array_equal(observer.signals()["residual"], known)
    assert same.tick(0.0, ARM.q0, np.zeros(ARM.nv)).status.ok and np.array_equal(observer.signals()["residual"], known)


def errors() -> Iterator[Exception]:
    """What the library raises, of every kind whose sentence is made of something else."""
    controller = wbc.Controller(ARM, wbc.Stack([T.Posture(ARM.q0)]), level=wbc.AccelerationLevel())
    command = controller.tick(0.0, ARM.q0, np.zeros(ARM.nv))
    both = [T.JointVelocity(np.full(ARM.nj, v)).exactly() for v in (0.1, 0.2)]
    wrongs: list[Callable[[], Any]] = [
        lambda: ARM.state().frame("tol"),
        lambda: ARM.joint("shoulder"),
        lambda: wbc.load("humanoi"),
        lambda: wbc.load("arm", q0=np.zeros(3)),
        lambda: wbc.solve(wbc.QP(np.eye(2), [1.0, -1.0]), "pdax"),
        lambda: wbc.Stack(taks=[]),  # type: ignore[call-arg]
        lambda: setattr(T.Damping(), "weigth", 1.0),
        lambda: T.Damping().dim,
        lambda: command.f["sole"],
        lambda: Run({"t": [0.0]})["q"],
        lambda: setattr(controller, "dt", 1.0),
        lambda: wbc.Controller(ARM, wbc.Stack([T.Position("tool", lambda t: t.x)]), level=wbc.VelocityLevel()),
        lambda: wbc.Controller(ARM, wbc.Stack([], subject_to=both), level=wbc.VelocityLevel()),
    ]
    for wrong in wrongs:
        with pytest.raises(WbcError) as raised:
            wrong()
        yield raised.value
    yield SolverMissing("piqp", "piqp")
    yield SolverFailed("osqp", "slow")


def test_an_error_is_the_same_error(way: str) -> None:
    kinds = set()
    for error in errors():
        same = WAYS[way](error)
        kinds.add(type(same))
        assert type(same) is type(error) and str(same) == str(error) and vars(same).keys() == vars(error).keys()
        if isinstance(error, UnknownName):
            assert (same.name, same.near) == (error.name, error.near)
    assert len(kinds) > 10


def test_a_lambda_is_refused_as_python_refuses_it(way: str) -> None:
    task = T.CenterOfMass(target=lambda t: [0.0, 0.0, t])
    if way == "pickle":
        with pytest.raises((pickle.PicklingError, AttributeError), match="lambda"):
            WAYS[way](task)
    else:
        assert WAYS[way](task).reference(0.5).value.tolist() == [0.0, 0.0, 0.5]
