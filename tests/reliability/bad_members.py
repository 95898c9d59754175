"""Bad arguments of tasks, limits, contacts, stacks, controllers and methods: refused by name, index and value."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pinocchio

import tasks as T
import wbc
from tests.reliability.forked import Case

NAN, INF = np.nan, np.inf
LEVEL, TORQUE = wbc.VelocityLevel(), wbc.InverseDynamics()
HERE = [0.4, 0.2, 0.5]
MIRROR, EYE, ZEROS = np.diag([1.0, 1.0, -1.0]), np.eye(3), np.zeros(3)
#: What it is called, what makes it, and words of the refusal.
Rows = Iterator[tuple[str, Callable[[], object], tuple[str, ...]]]


@cache
def arm() -> Any:
    return wbc.load("arm")


def control(*tasks: Any, subject_to: Any = (), level: Any = LEVEL, robot: Any = None, **settings: Any) -> Any:
    """A controller of the arm."""
    return wbc.Controller(robot or arm(), wbc.Stack(tasks, subject_to=subject_to), level=level, **settings)


def limited(limit: Any, **limits: Any) -> Any:
    """A controller of the arm with this limit; ``limits`` are of the arm's fourth joint."""
    robot = wbc.load("arm")
    own = {name: np.where(np.arange(7) == 3, value, getattr(robot.limits, name)) for name, value in limits.items()}
    robot.limits = replace(robot.limits, **own)
    return control(subject_to=[limit], level=TORQUE, robot=robot)


def reach(**settings: Any) -> T.Position:
    return T.Position("tool", **{"target": HERE} | settings)


def assigned(name: str, value: Any) -> None:
    setattr(reach(), name, value)


def cases() -> Iterator[Case]:
    """Bad inputs of this kind."""
    for name, call, says in (*_targets(), *_settings(), *_limits(), *_stacks()):
        yield Case(name, lambda solver, call=call: call(), says)
    for name, tasks, limits in _accepted():
        yield Case(name, lambda solver, tasks=tasks, limits=limits: ticked(tasks, limits))


def _targets() -> Rows:
    """Of frames, of joints, and the names of frames."""
    for value in (NAN, INF, -INF):
        said = str(value)
        yield f"target {value}", lambda x=value: reach(target=[0.4, x, 0.5]), ("Position[tool].target[1]", said)
        yield f"target {value} assigned", lambda x=value: assigned("target", [x, 0.0, 0.0]), ("target[0]", said)
    for name in ("tol", "", "TOOL"):
        yield (f"frame {name!r}", lambda name=name: control(T.Position(name, target=HERE)),
               ("there is no frame", repr(name)))  # fmt: skip
    yield from (
        ("target short", lambda: reach(target=HERE[:2]), ("Position[tool].target", "(3,)", "(2,)")),
        ("target a word", lambda: reach(target="there"), ("Position[tool].target", "there")),
        ("target None", lambda: reach(target=None), ("Position[tool].target", "None")),
        ("target of a function is nan", lambda: reach(target=lambda t: [NAN, 0.0, 0.0]), ("target", "nan")),
        ("target of a function is short", lambda: reach(target=lambda t: [0.0]), ("target", "(3,)", "(1,)")),
        ("target of a function, rate short", lambda: reach(target=lambda t: (ZEROS, np.zeros(2), ZEROS)),
         ("target", "(3,)", "(2,)")),
        ("target 1e300", lambda: reach(target=[0.0, 0.0, 1e300]), ("target[2]", "1e+300")),
        ("rotation mirrored", lambda: T.Orientation("tool", target=MIRROR),
         ("Orientation[tool].target", "determinant")),
        ("rotation doubled", lambda: T.Orientation("tool", target=2.0 * EYE), ("not a rotation", "3")),
        ("rotation nan", lambda: T.Orientation("tool", target=NAN * EYE), ("target[(0, 0)]", "nan")),
        ("rotation of quaternion", lambda: T.Orientation("tool", target=[0.0, 0.0, 0.0, 1.0]), ("(3, 3)", "(4,)")),
        ("pose with another last row", lambda: T.Frame("tool", target=np.eye(4) + np.eye(4, k=-3)), ("last row",)),
        ("pose nan", lambda: T.Frame("tool", target=pinocchio.SE3(EYE, np.array([0.0, NAN, 0.0]))), ("target", "nan")),
        ("posture short", lambda: control(T.Posture(np.zeros(6))), ("target", "(7,)", "(6,)")),
        ("posture nan", lambda: control(T.Posture(np.full(7, NAN))), ("target[0]", "nan")),
        ("frame None", lambda: control(T.Position(None, target=HERE)), ("None",)),  # type: ignore[arg-type]
        ("frame a number", lambda: control(T.Position(3, target=HERE)), ("3",)),  # type: ignore[arg-type]
    )  # fmt: skip


def _settings() -> Rows:
    """Gains and weights of tasks, sizes and friction of contacts."""
    for what in ("kp", "kd", "rate", "weight"):
        yield f"{what} assigned nan", lambda what=what: assigned(what, NAN), (what, "nan")
        yield f"{what} of two rows", lambda what=what: reach(**{what: [1.0, 2.0]}), (what, "(3,)", "(2,)")
        yield f"{what} negative in a row", lambda what=what: reach(**{what: [1.0, -2.0, 1.0]}), (f"{what}[1]",)
    yield "weight 1e300", lambda: reach(weight=1e300), ("weight", "1e+300")
    for size in ((0.0, 0.1), (-0.1, 0.1), (NAN, 0.1), (0.1,)):
        yield (f"a sole of {size}", lambda size=size: T.Sole("sole", half_size=size, friction=0.5),
               ("Sole[sole].half_size",))  # fmt: skip
    yield ("another model of friction", lambda: T.Point("foot", friction=0.5, friction_model="middle"),
           ("friction_model", "middle", "'outer'"))  # fmt: skip
    yield "braking 0", lambda: T.JointPositionLimits(braking=0.0), ("braking", "0")


def _limits() -> Rows:
    """Of the arm's joints, given and the model's own."""
    joint = arm().joint_names[3]
    for what, limit in (
        ("v_max", T.JointVelocityLimits), ("tau_max", T.TorqueLimits), ("a_max", T.JointAccelerationLimits),
    ):  # fmt: skip
        made: Any = limit
        for value in (0.0, -1.0, NAN):
            yield f"{what} = {value}", lambda made=made, x=value: limited(made(x)), (what,)
            yield (f"{what} of a joint = {value}", lambda made=made, x=value: limited(made({joint: x})),
                   (what, joint))  # fmt: skip
            if what != "a_max":
                yield (f"the model's {what} is {value}", lambda made=made, own={what: value}: limited(made(), **own),
                       (what, joint, f"{value:g}", "to overrule"))  # fmt: skip
        yield f"{what} of five joints", lambda made=made: limited(made(np.ones(5))), (what, "(7,)", "(5,)")
        yield (f"{what} of no joint", lambda made=made: limited(made({"elbo": 1.0})),
               ("there is no joint 'elbo'",))  # fmt: skip
        yield f"{what} a word", lambda made=made: limited(made("slow")), (what,)
    between = T.JointPositionLimits
    high, low = between(lower=0.5, upper=1.0, name="a"), between(lower=-1.0, upper=0.0, name="b")
    yield from (
        ("positions crossed", lambda: limited(between(lower=1.0, upper=-1.0)), ("[1, -1]", arm().joint_names[0])),
        ("positions nan", lambda: limited(between(lower=NAN, upper=1.0)), ("lower",)),
        ("the model's positions crossed", lambda: limited(between(), q_min=9.0), (joint, "9")),
        ("the model's position nan", lambda: limited(between(), q_max=NAN), (joint, "nan")),
        ("position limits that leave nothing", lambda: control(subject_to=[high, low]),
         ("left no position", "lower 0.5, upper 0")),
        ("torque limits at the velocity level", lambda: control(subject_to=[T.TorqueLimits()]),
         ("TorqueLimits", "torque", "velocity level")),
    )  # fmt: skip


def _stacks() -> Rows:
    """Stacks, and what a controller is made of beside them."""
    posture, other = T.Posture(np.zeros(7)), T.Posture(np.ones(7))
    fast, slow = T.JointVelocity(np.full(7, 9.0)).exactly(), T.JointVelocityLimits(1.0)
    hoof = T.Point("front_left_fot", friction=0.5)
    made: Any = wbc.Stack  # whose arguments are wrong on purpose
    run: Any = wbc.Controller
    yield from (
        ("a task that is no list", lambda: made(posture), ("tasks is Posture", "in a list")),
        ("an empty stack", lambda: run(arm(), made([]), level=LEVEL), ("the stack is empty", "tasks")),
        ("a task's class", lambda: made([T.Posture]), ("tasks[0]", "the class Posture")),
        ("a limit among the tasks", lambda: made([posture, slow]), ("tasks[1]", "subject_to")),
        ("a task among the constraints", lambda: made([], subject_to=[posture]), ("subject_to[0]", "exactly()")),
        ("a word among the tasks", lambda: made(["reach"]), ("tasks[0]", "reach")),
        ("levels and tasks mixed", lambda: made([[posture], reach()]), ("mixture",)),
        ("two of one name", lambda: made([posture, other]), ("'Posture'", "name=")),
        ("None among the constraints", lambda: made([], subject_to=None), ("subject_to",)),
        ("constraints that contradict each other in every state", lambda: control(subject_to=[fast, slow]),
         ("cannot hold together", "8 rad/s")),
        ("a contact at no frame", lambda: run(wbc.load("quadruped"), made([], contacts=[hoof]), level=TORQUE),
         ("front_left_fot", "did you mean")),
        ("force of no contact", lambda: control(T.ContactForce("tool", target=[0.0, 0.0, 1.0]), level=TORQUE),
         ("tool",)),
        ("a solver of no name", lambda: control(solver="dapq"), ("dapq", "'daqp'")),
        ("a level in words", lambda: control(level="velocity"), ("level", "velocity", "VelocityLevel()")),
        ("a robot in words", lambda: run("arm", made([]), level=LEVEL), ("robot", "arm", "wbc.load")),
        ("a list for a stack", lambda: run(arm(), [], level=LEVEL), ("stack", "wbc.Stack")),
        ("a robot of no name", lambda: wbc.load("humanoyd"), ("humanoyd", "'humanoid'")),
        ("a robot None", lambda: wbc.load(None), ("NoneType",)),  # type: ignore[arg-type]
    )  # fmt: skip


def ticked(tasks: list[Any], limits: list[Any]) -> Any:
    """A command that is certified and finite."""
    made = control(*tasks, subject_to=limits)
    command = made.tick(0.0, arm().q0, np.zeros(7))
    assert command.status.ok, made.explain()
    assert np.isfinite(command.v).all() and np.isfinite(command.q).all()
    return command


def _accepted() -> tuple[tuple[str, list[Any], list[Any]], ...]:
    """Odd, and right: what it is called, tasks and limits."""
    raised, limits = np.ones(7), [T.JointVelocityLimits()]
    up, down = (reach(target=[0.4, 0.2, z], weight=1e2, name=f"{z}") for z in (9.0, -9.0))
    return (
        ("no task at all", [], limits),
        ("positions with lower = upper", [T.Posture(raised)], [T.JointPositionLimits(lower=arm().q0, upper=arm().q0)]),
        ("no limit, said as inf", [T.Posture(raised)], [T.JointVelocityLimits(INF)]),
        ("a target a kilometre away", [reach(target=[1e3, 0.0, 0.0])], limits),
        ("a target 1e6 m away", [reach(target=[1e6, 0.0, 0.0])], limits),
        ("a gain of 1e6", [T.Posture(raised, kp=1e6)], limits),
        ("a weight of 1e12", [T.Posture(raised, weight=1e12)], limits),
        ("tasks against each other", [up, down], limits),
        ("the same constraint twice", [T.Posture(np.zeros(7))], [reach(name=one).exactly() for one in ("one", "two")]),
    )
