"""Contacts press against one another as hard as is asked, and nothing moves for it; a mirror changes nothing."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from tasks import CenterOfMass, InternalForce, Orientation, Posture, TorqueLimits, feet
from tests.stack.conftest import moving
from wbc.stack.task import LinearRows
from wbc.testing.strategies import states
from wbc.types import Vec

QUADRUPED, HUMANOID = wbc.load("quadruped"), wbc.load("humanoid")
POINTS = feet(QUADRUPED)


def tick(robot: Any, q: Vec, v: Vec, *tasks: Any, contacts: Any = None) -> Any:
    state = robot.state()
    upright = robot.frame_names[0]
    stack = wbc.Stack(
        [
            CenterOfMass(target=state.com), Orientation(upright, target=np.eye(3)), Posture(robot.q0, weight=1e-3),
            *tasks,
        ],
        contacts=contacts or feet(robot), subject_to=[TorqueLimits()],
    )  # fmt: skip
    return wbc.Controller(robot, stack, level=wbc.InverseDynamics()).tick(0.0, q, v)


def rows(task: InternalForce, state: Any, size: int) -> LinearRows:
    out = LinearRows()
    out.A, out.b = np.full((task.dim, size), np.nan), np.full(task.dim, np.nan)
    task.fill(state, out)
    return out


@given(states(QUADRUPED), st.lists(st.floats(-50, 50), min_size=3, max_size=3).map(np.array))
def test_a_force_that_is_the_same_everywhere_is_no_internal_force(state: Any, force: Vec) -> None:
    out = rows(InternalForce(POINTS), state, 12)
    np.testing.assert_allclose(out.A @ np.tile(force, 4), 0.0, atol=1e-9)


@given(states(QUADRUPED), st.floats(-50, 50), st.sampled_from(list(combinations(range(4), 2))))
def test_a_bar_between_two_contacts_is_felt_as_what_it_presses_with(state: Any, press: float, pair: Any) -> None:
    first, second = pair
    p, q = (POINTS[i].anchor(state).position for i in pair)
    way = (q - p) / np.linalg.norm(q - p)
    out = rows(InternalForce([POINTS[first], POINTS[second]]), state, 6)
    np.testing.assert_allclose(out.A @ np.concatenate([-press * way, press * way]), [press], atol=1e-9)


@given(st.integers(0, 5), st.floats(-6.0, 6.0))
def test_feet_press_as_hard_as_is_wished_and_nothing_moves_for_it(seed: int, press: float) -> None:
    q, v = moving(QUADRUPED, seed)
    task = InternalForce([POINTS[0], POINTS[3]], target=press, weight=1e3, name="squeeze")
    with_it, without = tick(QUADRUPED, q, v, task), tick(QUADRUPED, q, v)
    state = QUADRUPED.state()
    state.update(0.0, q, v)
    forces = np.concatenate([with_it.f[POINTS[0].name], with_it.f[POINTS[3].name]])
    got = (rows(task, state, 6).A @ forces).item()
    if with_it.solution.certificate.ok and not np.any(np.abs(with_it.solution.z) > 1e-6):  # no cone holds it back
        assert got == pytest.approx(press, abs=1e-2)
        np.testing.assert_allclose(with_it.a, without.a, atol=1e-3)


def test_the_squeeze_is_reached_where_friction_allows_it() -> None:
    rest = np.zeros(QUADRUPED.nv)
    task = InternalForce([POINTS[0], POINTS[3]], target=5.0, weight=1e3)
    command = tick(QUADRUPED, QUADRUPED.q0, rest, task)
    forces = np.concatenate([command.f[POINTS[0].name], command.f[POINTS[3].name]])
    assert (rows(task, QUADRUPED.state(), 6).A @ forces).item() == pytest.approx(5.0, abs=1e-2)


# ---- mirrors
def mirrored(v: Vec) -> Vec:
    """A velocity or torque vector of our humanoid seen in the mirror y -> −y: left is right.

    The axes of its limbs are mirror images already; yaw in the middle turns round.
    """
    names = HUMANOID.joint_names
    result = np.concatenate([v[:6] * [1, -1, 1, -1, 1, -1] if len(v) == HUMANOID.nv else v[:0], np.zeros(len(names))])
    joints, first = v[-len(names) :], len(result) - len(names)
    for i, name in enumerate(names):
        other = name.replace("left", "*").replace("right", "left").replace("*", "right")
        result[first + i] = joints[names.index(other)] * (-1.0 if other == name and "yaw" in name else 1.0)
    return result


WRENCH = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])


@given(st.integers(0, 2**32 - 1))
def test_what_is_done_in_the_mirror_is_the_mirror_of_what_is_done(seed: int) -> None:
    rng = np.random.default_rng(seed)
    step, v = 0.03 * rng.normal(size=(2, HUMANOID.nv))
    q, q_mirrored = (HUMANOID.integrate(HUMANOID.q0, x) for x in (step, mirrored(step)))
    one, other = tick(HUMANOID, q, v), tick(HUMANOID, q_mirrored, mirrored(v))
    assert one.status.ok and other.status.ok
    np.testing.assert_allclose(other.tau, mirrored(one.tau), atol=1e-5)
    np.testing.assert_allclose(other.f["left_sole"], WRENCH * one.f["right_sole"], atol=1e-4)


@given(st.integers(0, 2**32 - 1))
def test_a_symmetric_stance_gives_symmetric_forces(seed: int) -> None:
    rng = np.random.default_rng(seed)
    step, v = ((x + mirrored(x)) / 2 for x in 0.03 * rng.normal(size=(2, HUMANOID.nv)))
    command = tick(HUMANOID, HUMANOID.integrate(HUMANOID.q0, step), v)
    assert command.status.ok
    np.testing.assert_allclose(command.f["left_sole"], WRENCH * command.f["right_sole"], atol=1e-5)
    np.testing.assert_allclose(command.tau, mirrored(command.tau), atol=1e-6)


# ---- what makes no sense
