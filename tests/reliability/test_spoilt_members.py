"""Whatever users' code gives or raises in a tick: a finite command within the limits, and a status that says so."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import wbc
from tasks import JointAccelerationLimits, JointPositionLimits, JointVelocityLimits, Position, Posture, TorqueLimits
from tests.reliability.nonsense import EXCEPTIONS, functions, values
from tests.stack.conftest import moving, standing

ARM, QUADRUPED = wbc.load("arm"), wbc.load("quadruped")
V_MAX, A_MAX = 2.0, 20.0
LEVELS = [wbc.VelocityLevel(), wbc.AccelerationLevel(), wbc.InverseDynamics()]
HIERARCHIES = [wbc.Weighted(), wbc.Strict(), wbc.Scaled()]
each_way = [
    pytest.mark.parametrize("level", LEVELS, ids=repr),
    pytest.mark.parametrize("hierarchy", HIERARCHIES, ids=repr),
]
pytestmark = [*each_way, pytest.mark.filterwarnings("ignore")]


class Users(wbc.Component):
    """Calls what it is given."""

    def __init__(self) -> None:
        super().__init__(name="users")
        self.calls: dict[str, Callable[..., Any]] = {}

    def _call(self, what: str, *arguments: Any) -> Any:
        return self.calls[what](*arguments) if what in self.calls else None

    def reset(self, state: Any) -> None:
        self._call("reset", state)

    def before(self, state: Any, last: Any, plan: Any) -> Any:
        return self._call("before", state, last, plan)

    def after(self, state: Any, command: Any) -> None:
        self._call("after", state, command)


def arm(level: Any, hierarchy: Any, *, tasks: tuple[Any, ...] = (), constraints: tuple[Any, ...] = ()) -> Any:
    """A controller with limits on everything, and its component."""
    limits = [JointPositionLimits(), JointVelocityLimits(V_MAX), JointAccelerationLimits(A_MAX), *constraints]
    limits += [TorqueLimits()] if level.dynamics else []
    users = Users()
    reach = Position("tool", target=[0.4, 0.2, 0.5], kp=50.0)
    stack = wbc.Stack([[reach], [*tasks, Posture(ARM.q0, weight=1e-2)]], subject_to=limits, components=[users])
    return wbc.Controller(ARM, stack, level=level, hierarchy=hierarchy), users


def judged(controller: wbc.Controller, t: float, what: object) -> wbc.Command:
    """A command that motors may get; ``what`` was done to it."""
    q, v = moving(controller.model, 3)
    command = controller.tick(t, q, v)
    level, nb = controller.level, controller.model.nb
    decided = command.tau if level.dynamics else command.v if level.order == 1 else command.a
    assert np.isfinite(decided).all() and np.isfinite(command.q).all(), (what, controller.why)
    most: Any = controller.model.limits.tau_max if level.dynamics else V_MAX if level.order == 1 else A_MAX
    assert (np.abs(decided[0 if level.dynamics else nb :]) <= most + 1e-6).all(), (what, controller.why)
    return command


def overrides() -> Iterator[tuple[str, Callable[[], Any]]]:
    """Every field of the overrides, spoilt with every value; the field, and what makes them."""
    quantities = ("torque", "position", "velocity", "acceleration")
    for x in values():
        for name in quantities:
            for given in (x, (x, x), (x, 1.0), (-1.0, x), (5.0, -5.0)):
                yield name, lambda name=name, given=given: wbc.Overrides(**{name: given})
        for name in ("bias", "inertia", "lifted", "normal_limits", "normal_floors", "motors", "tasks"):
            yield name, lambda name=name, x=x: wbc.Overrides(**{name: x})
        for name in ("normal_limits", "normal_floors"):
            yield name, lambda name=name, x=x: wbc.Overrides(**{name: {"tool": x}})
        for joints in (x, [x], [0, x]):
            yield "lifted", lambda joints=joints: wbc.Overrides(lifted={"position": joints, "torque": joints})
        for motor in (x, (x, 0.0), (1.0, x), (x, x)):
            yield "motors", lambda motor=motor: wbc.Overrides(motors={0: motor})
        for what in ("weight", "kp", "kd", "rate", "active", "target", "name", "dim", "wieght"):
            for task in ("Posture", "Position[tool]", "nobody"):
                yield what, lambda what=what, task=task, x=x: wbc.Overrides(tasks={task: {what: x}})
        yield "value", lambda x=x: x


def test_overrides_that_make_no_sense(level: Any, hierarchy: Any) -> None:
    level = replace(level, lm_damping=0.0)  # which remembers what the tick before left of a task
    controller, users = arm(level, hierarchy)
    assert judged(controller, 0.0, "nothing").status.ok
    said, refused = 0, 0
    for k, (what, make) in enumerate(overrides(), start=1):
        users.calls["before"] = lambda state, last, plan, make=make: make()
        command = judged(controller, 1e-3 * k, what)
        said += 1
        if "users" in controller.why:
            refused += 1
            assert not command.status.ok
    assert said > 1500 and refused > 0.5 * said
    del users.calls["before"]
    for k in range(3):
        again = judged(controller, 100.0 + 1e-3 * k, "nothing again")
    assert again.status.ok and controller.why == ""
    fresh, _ = arm(level, hierarchy)
    judged(fresh, 0.0, "nothing")
    problem, same = controller.plan.problem, fresh.plan.problem
    for what in ("bounds", "metric", "centre", "weights", "scale"):  # nothing of it is left in the problem
        np.testing.assert_array_equal(getattr(problem, what), getattr(same, what))
    np.testing.assert_array_equal(problem.G[: problem.n_rows], same.G[: problem.n_rows])


@pytest.mark.parametrize("spoilt", [np.nan, np.inf, "crossed"])
@pytest.mark.parametrize("when", ["first", "later"])
def test_a_spoilt_bound_never_reaches_the_fallback(level: Any, hierarchy: Any, spoilt: Any, when: str) -> None:
    """Not even when there is nothing to hold, nor once holding has ended."""
    controller, users = arm(level, hierarchy)
    if when == "later":
        judged(controller, 0.0, "nothing")
    name = "torque" if level.dynamics else "velocity"
    bounds = (5.0, -5.0) if spoilt == "crossed" else (-1.0, np.where(np.arange(7) == 0, np.nan, 1.0))
    if spoilt is np.inf:
        bounds = (np.inf, -np.inf)
    users.calls["before"] = lambda *_: wbc.Overrides(**{name: bounds})
    levels = set()
    for k in range(1, 30):
        command = judged(controller, 1e-3 * k, spoilt)
        assert (not command.status.ok and controller.why.startswith("users: ")) or "users." in controller.why
        levels.add(command.fallback_level)
    assert "damped" in levels


def test_components_that_raise(level: Any, hierarchy: Any) -> None:
    for hook in ("before", "after", "reset"):
        controller, users = arm(level, hierarchy)
        for k, kind in enumerate(EXCEPTIONS):
            if hook == "reset":
                controller.reset()
            users.calls[hook] = next(f for i, f in enumerate(functions()) if i == k)
            command = judged(controller, 1e-3 * k, hook)
            assert not command.status.ok
            assert f"users.{hook} raised {kind.__name__}" in controller.why
    users.calls.clear()
    assert judged(controller, 1.0, "nothing").status.ok


@pytest.mark.parametrize("passes", [KeyboardInterrupt, SystemExit])
def test_a_user_may_still_stop_the_program(level: Any, hierarchy: Any, passes: type[BaseException]) -> None:
    controller, users = arm(level, hierarchy)

    def stop(*_: Any) -> None:
        raise passes

    users.calls["before"] = stop
    with pytest.raises(passes):
        controller.tick(0.0, ARM.q0, np.zeros(7))


def test_targets_that_misbehave_in_mid_run(level: Any, hierarchy: Any) -> None:
    controller, _ = arm(level, hierarchy)
    reach, posture = controller.stack.tasks
    named = 0
    for k, function in enumerate(functions()):
        for task, still in ((reach, np.array([0.4, 0.2, 0.5])), (posture, ARM.q0)):
            # At 0 s, where it is looked at when it is assigned, it makes sense.
            task.target = lambda t, function=function, still=still: function(t) if t > 0.0 else still
            command = judged(controller, 1.0 + 1e-3 * k, function)
            if task.name in controller.why:
                named += 1
                assert not command.status.ok
            task.target = still
    assert named > 100
    assert judged(controller, 9.0, "nothing").status.ok


class Wrecked:
    """What a user's members have in common: ones in every array, or in one of them nonsense from half a second on."""

    dim, units, broken = 1, "m", None
    arrays: tuple[str, ...] = ()

    def fill(self, state: Any, out: Any) -> None:
        for name in self.arrays:
            getattr(out, name)[:] = 1.0
        if self.broken is not None and state.t > 0.5:
            name, value = self.broken
            if isinstance(value, type):
                raise value("users' code")
            getattr(out, name)[:] = value


class Row(Wrecked, wbc.Task):
    arrays = ("e", "J", "drift", "rate_ref", "acc_ref")


class Prefer(Wrecked, wbc.LinearTask):
    on, arrays = "acceleration", ("A", "b")


class PreferTorque(Prefer):
    on = "torque"


class Fence(Wrecked, wbc.Barrier):
    arrays = ("h", "J", "drift", "rate")


class Between(Wrecked, wbc.LinearConstraint):
    on, arrays = "velocity", ("A", "hi", "lo")

    def fill(self, state: Any, out: Any) -> None:
        super().fill(state, out)
        out.lo[:] = np.minimum(out.lo, -out.lo)


@pytest.mark.parametrize("kind", [Row, Prefer, Fence, Between], ids=lambda kind: kind.__name__)
def test_members_that_misbehave_in_mid_run(level: Any, hierarchy: Any, kind: Any) -> None:
    if kind is Prefer and level.order == 1:
        pytest.skip("the velocity level carries no linear task")
    member = PreferTorque() if kind is Prefer and level.dynamics else kind()
    place: Any = {"tasks": (member,)} if kind in (Row, Prefer) else {"constraints": (member,)}
    controller, _ = arm(level, hierarchy, **place)
    judged(controller, 0.0, "nothing")
    k = 0
    for name in member.arrays:
        for value in (np.nan, np.inf, -np.inf, 1e300, ValueError, ZeroDivisionError):
            member.broken = name, value
            k += 1
            command = judged(controller, 1.0 + 1e-3 * k, (name, value))
            if isinstance(value, type):
                assert not command.status.ok
                assert f"{member.name}.fill raised {value.__name__}: users' code" in controller.why
            elif np.isnan(value) and (name in ("e", "J", "A", "b", "h", "hi", "lo") or level.order == 2):
                assert not command.status.ok and member.name in controller.why, (name, value, controller.why)
    member.broken = None
    for k in range(3):
        command = judged(controller, 2.0 + 1e-3 * k, "nothing")
    assert controller.why == "" or command.fallback_level == "relaxed"


class Stepping(wbc.Schedule):
    """A schedule of a user."""

    says: Any = None

    def contact_sets(self) -> Any:
        return [tuple(QUADRUPED.feet)]

    def contacts(self, state: Any, last: Any) -> Any:
        return tuple(QUADRUPED.feet) if self.says is None else self.says()


def test_schedules_that_misbehave_in_mid_run(level: Any, hierarchy: Any) -> None:
    schedule, whole = Stepping(), standing(QUADRUPED)
    limits = [JointVelocityLimits(V_MAX), JointAccelerationLimits(A_MAX), *([TorqueLimits()] if level.dynamics else [])]
    stack = wbc.Stack(whole.levels, subject_to=limits, contacts=whole.contacts, components=[schedule])
    controller = wbc.Controller(QUADRUPED, stack, level=level, hierarchy=hierarchy)
    judged(controller, 0.0, "nothing")
    for k, function in enumerate([*functions(), lambda: ["front_left_hoof"], lambda: [["a"]], lambda: [Hoof()]]):
        schedule.says = function
        command = judged(controller, 1e-3 * (k + 1), function)
        assert command.status.ok or controller.why, function
    schedule.says = lambda: ["front_left_hoof"]
    command = judged(controller, 2.0, "an unknown contact")
    assert not command.status.ok
    assert "Stepping.contacts raised UnknownContact: there is no contact 'front_left_hoof'" in controller.why


class Hoof:
    """Hashes like nothing else."""

    def __hash__(self) -> int:
        raise RuntimeError("no hash")
