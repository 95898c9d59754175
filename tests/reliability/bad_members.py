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
LEVEL = wbc.VelocityLevel()


@cache
def arm() -> Any:
    return wbc.load("arm")


def control(*tasks: Any, subject_to: Any = (), level: Any = LEVEL, robot: Any = None, **settings: Any) -> Any:
    """A controller of the arm."""
    return wbc.Controller(robot or arm(), wbc.Stack(tasks, subject_to=subject_to), level=level, **settings)


def with_limits(**limits: Any) -> Any:
    """The arm, one of its own limits changed."""
    robot = wbc.load("arm")
    robot.limits = replace(robot.limits, **limits)
    return robot


def of_model(**limits: Any) -> Any:
    return {name: np.where(np.arange(7) == 3, value, getattr(arm().limits, name)) for name, value in limits.items()}


def cases() -> Iterator[Case]:
    """Bad inputs of this kind."""
    for name, call, *says in (
        *_targets(), *_gains(), *_limits(), *_stacks(), *_contacts(), *_controllers(), *_accepted()
    ):  # fmt: skip
        yield Case(name, lambda solver, call=call: call(), *says)


def _targets() -> Iterator[tuple[str, Callable[[], object], tuple[str, ...]]]:
    here = [0.4, 0.2, 0.5]
    for value in (NAN, INF, -INF):
        yield (
            f"target {value}",
            lambda value=value: T.Position("tool", target=[0.4, value, 0.5]),
            ("Position[tool].target[1]", str(value)),
        )
        yield (
            f"target {value} assigned",
            lambda value=value: setattr(T.Position("tool", target=here), "target", [value, 0.0, 0.0]),
            ("target[0]", str(value)),
        )
    yield "target short", lambda: T.Position("tool", target=here[:2]), ("Position[tool].target", "(3,)", "(2,)")
    yield "target a word", lambda: T.Position("tool", target="there"), ("Position[tool].target", "there")
    yield "target None", lambda: T.Position("tool", target=None), ("Position[tool].target", "None")
    yield "target of a function is nan", lambda: T.Position("tool", target=lambda t: [NAN, 0.0, 0.0]), ("target", "nan")
    yield (
        "target of a function is short",
        lambda: T.Position("tool", target=lambda t: [0.0]),
        ("target", "(3,)", "(1,)"),
    )
    yield (
        "target of a function, rate short",
        lambda: T.Position("tool", target=lambda t: (np.zeros(3), np.zeros(2), np.zeros(3))),
        ("target", "(3,)", "(2,)"),
    )
    mirror = np.diag([1.0, 1.0, -1.0])
    yield "rotation mirrored", lambda: T.Orientation("tool", target=mirror), ("Orientation[tool].target", "determinant")
    yield "rotation doubled", lambda: T.Orientation("tool", target=2.0 * np.eye(3)), ("not a rotation", "3")
    yield "rotation nan", lambda: T.Orientation("tool", target=np.full((3, 3), NAN)), ("target[(0, 0)]", "nan")
    yield "rotation of quaternion", lambda: T.Orientation("tool", target=[0.0, 0.0, 0.0, 1.0]), ("(3, 3)", "(4,)")
    pose = np.eye(4)
    pose[3, 0] = 1.0
    yield "pose with another last row", lambda: T.Frame("tool", target=pose), ("last row",)
    yield (
        "pose nan",
        lambda: T.Frame("tool", target=pinocchio.SE3(np.eye(3), np.array([0.0, NAN, 0.0]))),
        ("target", "nan"),
    )
    yield "posture short", lambda: control(T.Posture(np.zeros(6))), ("target", "(7,)", "(6,)")
    yield "posture nan", lambda: control(T.Posture(np.full(7, NAN))), ("target[0]", "nan")
    for name in ("tol", "", "TOOL"):
        yield (
            f"frame {name!r}",
            lambda name=name: control(T.Position(name, target=here)),
            ("there is no frame", repr(name)),
        )
    yield "frame None", lambda: control(T.Position(None, target=here)), ("None",)  # type: ignore[arg-type]
    yield "frame a number", lambda: control(T.Position(3, target=here)), ("3",)  # type: ignore[arg-type]


def _gains() -> Iterator[tuple[str, Callable[[], object], tuple[str, ...]]]:
    here = [0.4, 0.2, 0.5]
    for what in ("kp", "kd", "rate", "weight"):
        yield (
            f"{what} assigned nan",
            lambda what=what: setattr(T.Position("tool", target=here), what, NAN),
            (what, "nan"),
        )
        yield (
            f"{what} of two rows",
            lambda what=what: T.Position("tool", target=here, **{what: [1.0, 2.0]}),
            (what, "(3,)", "(2,)"),
        )
        yield (
            f"{what} negative in a row",
            lambda what=what: T.Position("tool", target=here, **{what: [1.0, -2.0, 1.0]}),
            (f"{what}[1]",),
        )
    yield "weight 1e300", lambda: T.Position("tool", target=here, weight=1e300), ("weight", "1e+300")
    yield "target 1e300", lambda: T.Position("tool", target=[0.0, 0.0, 1e300]), ("target[2]", "1e+300")


def _limits() -> Iterator[tuple[str, Callable[[], object], tuple[str, ...]]]:
    level = wbc.InverseDynamics()
    makers = {
        "v_max": (T.JointVelocityLimits, "v_max"), "tau_max": (T.TorqueLimits, "tau_max"),
        "a_max": (T.JointAccelerationLimits, None),
    }  # fmt: skip
    joint = "elbow_pitch" if "elbow_pitch" in arm().joint_names else arm().joint_names[3]
    for what, (maker, own) in makers.items():
        for value in (0.0, -1.0, NAN):
            yield (
                f"{what} = {value}",
                lambda maker=maker, value=value: control(subject_to=[maker(value)], level=level),
                (f"{what}",),
            )
            yield (
                f"{what} of a joint = {value}",
                lambda maker=maker, value=value: control(subject_to=[maker({joint: value})], level=level),
                (what, joint),
            )
            if own:
                yield (
                    f"the model's {own} is {value}",
                    lambda maker=maker, own=own, value=value: control(
                        subject_to=[maker()], level=level, robot=with_limits(**of_model(**{own: value}))
                    ),
                    (own, arm().joint_names[3], f"{value:g}", "to overrule"),
                )
        yield (
            f"{what} of five joints",
            lambda maker=maker: control(subject_to=[maker(np.ones(5))], level=level),
            (what, "(7,)", "(5,)"),
        )
        yield (
            f"{what} of no joint",
            lambda maker=maker: control(subject_to=[maker({"elbo": 1.0})], level=level),
            ("there is no joint 'elbo'",),
        )
        yield f"{what} a word", lambda maker=maker: control(subject_to=[maker("slow")], level=level), (what,)
    yield (
        "positions crossed",
        lambda: control(subject_to=[T.JointPositionLimits(lower=1.0, upper=-1.0)]),
        ("[1, -1]", arm().joint_names[0]),
    )
    yield "positions nan", lambda: control(subject_to=[T.JointPositionLimits(lower=NAN, upper=1.0)]), ("lower",)
    yield (
        "the model's positions crossed",
        lambda: control(subject_to=[T.JointPositionLimits()], robot=with_limits(**of_model(q_min=9.0))),
        (arm().joint_names[3], "9"),
    )
    yield (
        "the model's position nan",
        lambda: control(subject_to=[T.JointPositionLimits()], robot=with_limits(**of_model(q_max=NAN))),
        (arm().joint_names[3], "nan"),
    )
    yield "braking 0", lambda: T.JointPositionLimits(braking=0.0), ("braking", "0")
    yield (
        "velocity limits that leave nothing",
        lambda: control(
            subject_to=[
                T.JointPositionLimits(lower=0.5, upper=1.0, name="a"),
                T.JointPositionLimits(lower=-1.0, upper=0.0, name="b"),
            ]
        ),
        ("left no position", "lower 0.5, upper 0"),
    )
    yield (
        "torque limits at the velocity level",
        lambda: control(subject_to=[T.TorqueLimits()]),
        ("TorqueLimits", "torque", "velocity level"),
    )


def _stacks() -> Iterator[tuple[str, Callable[[], object], tuple[str, ...]]]:
    here = [0.4, 0.2, 0.5]
    posture = T.Posture(np.zeros(7))
    yield "a task that is no list", lambda: wbc.Stack(posture), ("tasks is Posture", "in a list")  # type: ignore[arg-type]
    yield "an empty stack", lambda: wbc.Controller(arm(), wbc.Stack([]), level=LEVEL), ("the stack is empty", "tasks")
    yield "a task's class", lambda: wbc.Stack([T.Posture]), ("tasks[0]", "the class Posture")  # type: ignore[list-item]
    yield "a limit among the tasks", lambda: wbc.Stack([posture, T.JointVelocityLimits()]), ("tasks[1]", "subject_to")  # type: ignore[list-item]
    yield "a task among the constraints", lambda: wbc.Stack([], subject_to=[posture]), ("subject_to[0]", "exactly()")
    yield "a word among the tasks", lambda: wbc.Stack(["reach"]), ("tasks[0]", "reach")  # type: ignore[list-item]
    yield "levels and tasks mixed", lambda: wbc.Stack([[posture], T.Position("tool", target=here)]), ("mixture",)  # type: ignore[list-item]
    yield "two of one name", lambda: wbc.Stack([T.Posture(np.zeros(7)), T.Posture(np.ones(7))]), ("'Posture'", "name=")
    yield "None among the constraints", lambda: wbc.Stack([], subject_to=None), ("subject_to",)  # type: ignore[arg-type]
    fast = T.JointVelocity(np.full(7, 9.0)).exactly()
    yield (
        "constraints that contradict each other in every state",
        lambda: control(subject_to=[fast, T.JointVelocityLimits(1.0)]),
        ("cannot hold together", "8 rad/s"),
    )


def _contacts() -> Iterator[tuple[str, Callable[[], object], tuple[str, ...]]]:
    for size in ((0.0, 0.1), (-0.1, 0.1), (NAN, 0.1), (0.1,)):
        yield (
            f"a sole of {size}",
            lambda size=size: T.Sole("sole", half_size=size, friction=0.5),
            ("Sole[sole].half_size",),
        )
    yield (
        "another model of friction",
        lambda: T.Point("foot", friction=0.5, friction_model="middle"),
        ("friction_model", "middle", "'outer'"),
    )
    yield (
        "a contact at no frame",
        lambda: wbc.Controller(
            wbc.load("quadruped"),
            wbc.Stack([], contacts=[T.Point("front_left_fot", friction=0.5)]),
            level=wbc.InverseDynamics(),
        ),
        ("front_left_fot", "did you mean"),
    )
    yield (
        "force of no contact",
        lambda: control(T.ContactForce("tool", target=[0.0, 0.0, 1.0]), level=wbc.InverseDynamics()),
        ("tool",),
    )


def _controllers() -> Iterator[tuple[str, Callable[[], object], tuple[str, ...]]]:
    for name, settings, says in (
        ("a solver of no name", {"solver": "dapq"}, ("dapq", "'daqp'")),
        ("a level in words", {"level": "velocity"}, ("level", "velocity", "VelocityLevel()")),
    ):
        yield name, lambda settings=settings: control(**settings), says
    yield "a robot in words", lambda: wbc.Controller("arm", wbc.Stack([]), level=LEVEL), ("robot", "arm", "wbc.load")  # type: ignore[arg-type]
    yield "a list for a stack", lambda: wbc.Controller(arm(), [], level=LEVEL), ("stack", "wbc.Stack")  # type: ignore[arg-type]
    yield "a robot of no name", lambda: wbc.load("humanoyd"), ("humanoyd", "'humanoid'")
    yield "a robot None", lambda: wbc.load(None), ("NoneType",)  # type: ignore[arg-type]


def _accepted() -> Iterator[tuple[str, Callable[[], object]]]:
    """Odd, and right: an answer that is certified and within the limits."""

    def ticks(*tasks: Any, subject_to: Any = (), level: Any = LEVEL) -> Any:
        control_ = control(*tasks, subject_to=subject_to, level=level)
        command = control_.tick(0.0, arm().q0, np.zeros(7))
        assert command.status.ok, control_.explain()
        decided = command.v if level.order == 1 else command.a
        assert np.isfinite(decided).all() and np.isfinite(command.q).all()
        return command

    yield "no task at all", lambda: ticks(subject_to=[T.JointVelocityLimits()])
    yield (
        "positions with lower = upper",
        lambda: ticks(T.Posture(np.ones(7)), subject_to=[T.JointPositionLimits(lower=arm().q0, upper=arm().q0)]),
    )
    yield "no limit, said as inf", lambda: ticks(T.Posture(np.ones(7)), subject_to=[T.JointVelocityLimits(INF)])
    yield (
        "a target a kilometre away",
        lambda: ticks(T.Position("tool", target=[1e3, 0.0, 0.0]), subject_to=[T.JointVelocityLimits()]),
    )
    yield (
        "a target 1e6 m away",
        lambda: ticks(T.Position("tool", target=[1e6, 0.0, 0.0]), subject_to=[T.JointVelocityLimits()]),
    )
    yield "a gain of 1e6", lambda: ticks(T.Posture(np.ones(7), kp=1e6), subject_to=[T.JointVelocityLimits()])
    yield "a weight of 1e12", lambda: ticks(T.Posture(np.ones(7), weight=1e12), subject_to=[T.JointVelocityLimits()])
    up, down = (T.Position("tool", target=[0.4, 0.2, z], weight=1e2, name=f"{z}") for z in (9.0, -9.0))
    yield "tasks against each other", lambda: ticks(up, down, subject_to=[T.JointVelocityLimits()])
    same = [T.Position("tool", target=[0.4, 0.2, 0.5], name=name).exactly() for name in ("one", "two")]
    yield "the same constraint twice", lambda: ticks(T.Posture(np.zeros(7)), subject_to=same)
