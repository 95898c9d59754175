"""What was assigned or overridden between ticks: a plan that has read it is as one that is made with it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from tasks import (
    CenterOfMass,
    ContactForce,
    JointVelocityLimits,
    Orientation,
    Point,
    Position,
    Posture,
    Sinusoid,
    TorqueLimits,
)
from tests.stack.conftest import Saying
from wbc.types import Vec

QUADRUPED = wbc.load("quadruped")
FEET = [name for name in QUADRUPED.frame_names if name.endswith("_foot")]
CENTRE = QUADRUPED.state().com
HIP = QUADRUPED.state().frame(FEET[0]).position
FORCE = np.array([0.0, 0.0, 60.0])


def late(t: float) -> Any:
    """A target that exists at first, and not when it is asked for."""
    if t > 0.0:
        raise RuntimeError("the plan is late")
    return CENTRE


def members() -> dict[str, Any]:
    held = Position(FEET[0], target=HIP, kp=30.0, name="held")
    watched = Orientation("trunk", target=np.eye(3), name="watched")
    return {
        "centre": CenterOfMass(target=CENTRE, weight=2.0),
        "posture": Posture(QUADRUPED.q0, weight=0.1),
        "other": Posture(QUADRUPED.q0, weight=1e-3, name="other"),
        "force": ContactForce(FEET[1], target=FORCE, weight=1e-3),
        "speeds": JointVelocityLimits().softly(weight=5.0),
        "held": held, "exactly": held.exactly(), "watched": watched, "within": watched.within(0.5, rate=8.0),
        **{foot: Point(foot, friction=0.6, f_max=300.0) for foot in FEET[1:]},
    }  # fmt: skip


def stack_of(made: dict[str, Any], components: list[Any]) -> wbc.Stack:
    tasks = [made[name] for name in ("centre", "posture", "other", "force", "speeds")]
    limits = [made["exactly"], made["within"], TorqueLimits(), JointVelocityLimits()]
    return wbc.Stack(tasks, contacts=[made[foot] for foot in FEET[1:]], subject_to=limits, components=components)


NUMBERS, BY_JOINT = [0.0, 0.25, 3.0, 40.0], [{".*": 2.0}, np.linspace(0.0, 9.0, QUADRUPED.nj)]
PLACES = [CENTRE, CENTRE + 0.1, Sinusoid(CENTRE, amplitude=0.1, frequency=1.0), lambda t: CENTRE + t]
#: Names of members, a setting that they have, and values for it.
SETTINGS: list[tuple[list[str], str, list[Any]]] = [
    (["centre", "posture", "held", *FEET[1:]], "kp", NUMBERS),
    (["centre", "posture", "held", "watched", *FEET[1:]], "kd", NUMBERS),
    (["centre", "posture", "other", "force", "speeds"], "weight", NUMBERS),
    (["posture", "other"], "weight", BY_JOINT),
    (["posture", "other"], "kp", BY_JOINT),
    (["centre", "posture", "force"], "active", [True, False]),
    (["centre"], "target", PLACES),
    (["held"], "target", [HIP, HIP + 0.02]),
    (["force"], "target", [FORCE, FORCE / 2]),
    (FEET[1:], "f_max", [None, 50.0, 200.0]),
    (["within"], "rate", [2.0, 8.0]),
]
choices = st.one_of(
    st.tuples(st.sampled_from(names), st.just(what), st.sampled_from(values)) for names, what, values in SETTINGS
)
#: Parts of overrides, which are the same objects in several ticks, and not only equal ones.
PARTS: dict[str, list[Any]] = {
    "tasks": [
        {"Posture": {"weight": 7.0}}, {"CenterOfMass": {"kp": 9.0, "target": CENTRE - 0.1}}, {"other": {"kd": 1.0}}
    ],
    "torque": [(-30.0, 30.0), wbc.Overrides(torque=(-20.0, 25.0)).torque],
    "velocity": [(-2.0, 2.0), (0.5, 1.0), wbc.Overrides(velocity=(-3.0, 1.0)).velocity],
    "motors": [wbc.Overrides(motors={1: wbc.Motor(share), 4: wbc.Motor(0.5, 1.0)}).motors for share in (0.0, 0.7)],
    "lifted": [{"torque": [0, 1]}, wbc.Overrides(lifted={"velocity": [2], "torque": [4]}).lifted],
    "normal_limits": [{FEET[1]: 40.0}, wbc.Overrides(normal_limits={FEET[2]: 60.0}).normal_limits],
    "bias": [np.linspace(-1.0, 1.0, QUADRUPED.nv)],
}  # fmt: skip
overridden = st.fixed_dictionaries({}, optional={what: st.sampled_from(said) for what, said in PARTS.items()})
steps = st.lists(st.tuples(st.lists(choices, max_size=5), overridden), min_size=1, max_size=5)


@given(steps)
def test_what_is_assigned_and_overridden_is_what_a_new_controller_is_made_with(taken: Any) -> None:
    made, saying = members(), Saying()
    level = wbc.InverseDynamics(lm_damping=0.0)
    controller = wbc.Controller(QUADRUPED, stack_of(made, [saying]), level=level)
    assigned: list[tuple[str, str, Any]] = []
    q, v = QUADRUPED.q0, np.full(QUADRUPED.nv, 0.1)
    for k, (now, said) in enumerate(taken):
        for name, what, value in now:
            setattr(made[name], what, value)
        assigned += now
        saying.now = wbc.Overrides(**said) if said else None
        controller.tick(1e-3 * k, q, v)
        fresh, also = members(), Saying(saying.now)
        for name, what, value in assigned:
            setattr(fresh[name], what, value)
        other = wbc.Controller(QUADRUPED, stack_of(fresh, [also]), level=level)
        other.tick(1e-3 * k, q, v)
        assert controller.has_problem == other.has_problem == (said.get("velocity") != (0.5, 1.0))  # it allows no rest
        if not other.has_problem:
            continue
        for what in ("H", "g", "A", "b", "C", "cl", "cu", "lb", "ub"):
            mine, expected = (getattr(one.plan.qp, what) for one in (controller, other))
            np.testing.assert_allclose(mine, expected, rtol=1e-9, atol=1e-9, err_msg=what)
        motors, sent = other.plan.actuators, np.linspace(1.0, 9.0, QUADRUPED.nj)
        np.testing.assert_array_equal(controller.plan.actuators.command(sent), motors.command(sent))


def test_a_target_that_raises_when_it_is_asked_for_fails_every_tick_until_there_is_another() -> None:
    made = members()
    controller = wbc.Controller(QUADRUPED, stack_of(made, []), level=wbc.InverseDynamics())
    q, v = QUADRUPED.q0, np.zeros(QUADRUPED.nv)
    assert controller.tick(0.0, q, v).status.ok
    made["centre"].target = late
    for k in (1, 2, 3):
        assert not controller.tick(1e-3 * k, q, v).status.ok
        assert "the plan is late" in controller.why
    made["posture"].weight = 0.2
    assert not controller.tick(4e-3, q, v).status.ok
    made["centre"].target = CENTRE
    assert controller.tick(5e-3, q, v).status.ok


# ---- a target that raises once, where it is read for the first time: the tick fails, and nothing assigned is lost
ARM = wbc.load("arm")
HERE, THERE = np.array([0.4, 0.2, 0.5]), np.array([0.5, 0.1, 0.5])
STATE = ARM.q0, np.full(ARM.nv, 0.1)


class Flaky:
    """A stream whose reads of these numbers find nothing."""

    def __init__(self, missing: set[int]) -> None:
        self.missing, self.reads = missing, 0

    def __call__(self, t: float) -> Vec:
        self.reads += 1
        if self.reads in self.missing:
            raise RuntimeError("no sample")
        return THERE


def made(target: Any, weight: float, said: wbc.Overrides | None) -> tuple[wbc.Controller, Position, Posture, Saying]:
    position, posture, saying = Position("tool", target=target), Posture(ARM.q0, weight=weight), Saying(said)
    stack = wbc.Stack([position, posture], components=[saying])
    level = wbc.AccelerationLevel(lm_damping=0.0)
    return wbc.Controller(ARM, stack, level=level), position, posture, saying


@pytest.mark.parametrize("by", ["assignment", "override"])
@given(missing=st.sets(st.integers(1, 10)))
def test_every_tick_fails_or_is_as_with_what_was_assigned(by: str, missing: set[int]) -> None:
    controller, position, posture, saying = made(HERE, 1e-2, None)
    assert controller.tick(0.0, *STATE).status.ok
    flaky = Flaky(missing)
    if by == "override":
        saying.now = wbc.Overrides(tasks={position.name: {"target": flaky}})
    else:
        try:
            position.target = flaky
        except wbc.errors.WbcError:
            return  # it was refused
    posture.weight = 5.0
    said = wbc.Overrides(tasks={position.name: {"target": THERE}}) if by == "override" else None
    expected = made(THERE, 5.0, said)[0].tick(0.0, *STATE)
    for k in range(1, 13):
        command = controller.tick(1e-3 * k, *STATE)
        if command.status.ok:
            np.testing.assert_allclose(command.a, expected.a, rtol=1e-9, atol=1e-9)
        else:
            assert "no sample" in controller.why
    assert command.status.ok
