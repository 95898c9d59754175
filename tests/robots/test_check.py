"""The check names mistakes that are seeded, and finds nothing where there are none.

A sound robot is not blamed for inertia, damping and friction of its motors; mistakes never pass as proven.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pinocchio
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from tests.models.builders import inertial, joint, link, saved
from tests.robots.builders import GAINS, Spoiled, board_of, sliding
from tests.robots.examples import needs_examples
from wbc.errors import InvalidInput
from wbc.robots import JointMap, LeRobot, MotorBoard, Ros2Control, UnitreeGo2
from wbc.robots.check import AMPLITUDE, Checked, _Check, check
from wbc.robots.hands import BoardHands
from wbc.robots.motor_board import holding_gains
from wbc.robots.response import Candidates, Expected, Response, Weights
from wbc.types import Mat

mujoco = pytest.importorskip("mujoco")
pytestmark = pytest.mark.physics

from tests.robots.mistakes import CLEAN, MISTAKES, Seeded, checked, page, period  # noqa: E402 - needs the physics engine

ARM = wbc.load("arm")


def checked_without_torques(**conventions: Any) -> Checked:
    """A check of an arm that says positions in degrees alone."""
    device = LeRobot(ARM.joint_names)
    board = board_of(device, ARM)
    return check(board, ARM, joint_map=device.joint_map(ARM, **conventions), hands=BoardHands(board))


def spoilt(spoil: Callable[[list[Any]], Any], *, dt: float = 1e-3) -> tuple[Checked, Spoiled]:
    """A check of an arm behind a port that changes states, and the port."""
    port = Spoiled(board_of(Ros2Control(ARM.joint_names, gains=GAINS), ARM, dt=dt), spoil)
    return check(port, ARM), port


QUICK = {"crc 0", "w first", "accelerometer in g", "stale states", "states at 50 Hz", "no states", "sign of joint 4"}
QUICK |= {"states sent twice", "IMU mirrored", "accelerometer without gravity"}
QUICK |= {"joints 1 and 3", "offset of joint 4", "torques with the other sign", "clock in milliseconds"}


def _marked(mistake: Seeded) -> object:
    marks = [] if mistake.what in QUICK and mistake.robot != "g1" else [pytest.mark.deep]
    if mistake.robot == "g1":
        marks.append(needs_examples)
    return pytest.param(mistake, marks=marks, id=f"{mistake.robot}: {mistake.what}")


def test_the_page_lists_enough_mistakes_on_three_devices():
    assert len(MISTAKES) >= 40 and {mistake.robot for mistake in MISTAKES} == {"go2", "franka", "g1"}
    written = Path(__file__).parents[2] / "docs" / "robots" / "mistakes.md"
    assert written.read_text(encoding="utf-8") == page(), "write it anew: python3 -m tests.robots.mistakes"


@pytest.mark.parametrize("mistake", [_marked(mistake) for mistake in MISTAKES])
def test_a_mistake_is_named(mistake: Seeded):
    found = checked(mistake.robot, seed=100 + MISTAKES.index(mistake), mistake=mistake)
    assert [finding.kind for finding in found.findings] == [mistake.kind], found
    assert mistake.says in found.findings[0].sentence


@pytest.mark.deep
@pytest.mark.parametrize(
    ("kind", "seed"),
    [
        pytest.param(kind, seed, marks=[needs_examples] * (kind == "g1"))
        for kind, count in CLEAN.items() for seed in range(count)
    ],
)  # fmt: skip
def test_nothing_is_found_where_nothing_is_wrong(kind: str, seed: int):
    found = checked(kind, seed)
    assert found.ok, found
    assert found.figures["latency"] < 0.01


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "period"), [("franka", 1e-3), ("go2", 2e-3)])
@pytest.mark.parametrize("delay", [*(pytest.param(delay, marks=pytest.mark.deep) for delay in (0.0, 2e-3)), 5e-3])
def test_how_late_orders_act_is_known_to_a_period(kind: str, period: float, delay: float):
    found = checked(kind, 3, Seeded("", kind, "", "", board={"delay": delay}))
    assert found.ok, found
    assert abs(found.figures["latency"] - delay) <= period


@given(seed=st.integers(0, 2**32 - 1))
def test_the_weak_form_holds_for_any_motion_of_the_model(seed: int):
    # Random smooth motions, torques by inverse dynamics: T = G Q + M A to second order in the motion.
    rng, expected = np.random.default_rng(seed), Expected(ARM, np.eye(3))
    t, dt = np.linspace(0.0, 1.0, 2001), 5e-4
    size = 1e-4
    shapes = [(rng.normal(size=7), rng.uniform(1.0, 12.0), rng.uniform(0.0, 6.0)) for _ in range(3)]
    dq, dv, da = np.zeros((3, len(t), 7))
    for amplitude, omega, phase in shapes:
        dq += size * np.outer(np.sin(omega * t + phase), amplitude)
        dv += size * omega * np.outer(np.cos(omega * t + phase), amplitude)
        da -= size * omega**2 * np.outer(np.sin(omega * t + phase), amplitude)
    data = expected._model.createData()
    moments = zip(ARM.q0 + dq, dv, da, strict=True)
    tau = np.array([pinocchio.rnea(expected._model, data, *moment) for moment in moments])
    gravity, G, M = expected.at(ARM.q0)
    window = np.sin(np.pi * t) ** 2 * np.cos(9.0 * t) * dt
    second = np.zeros_like(window)
    second[1:-1] = np.diff(window, 2) / dt**2
    T, Q, A = window @ (tau - gravity), window @ dq, second @ dq
    np.testing.assert_allclose(T, G @ Q + M @ A, atol=1e-5 + 1e-2 * np.abs(T).max())


@given(seed=st.integers(0, 2**32 - 1))
def test_a_mistake_that_is_applied_to_what_it_does_gives_the_robot_back(seed: int):
    rng = np.random.default_rng(seed)
    expected = Expected(wbc.load("quadruped", base="fixed"), np.eye(3))
    candidates = Candidates(expected)
    every = [*candidates.exchanged(), *candidates.turned(), *candidates.units(), *candidates.limbs()]
    mistake = every[rng.integers(len(every))]
    Q, V, A, S, T = rng.normal(size=(5, 12, 48))
    true = Response(rng.normal(size=12), rng.normal(size=12), Q, V, A, S, T)
    order, scale, force = mistake.order, mistake.scale[:, None], mistake.force[:, None]
    read = Response(
        true.q[order] * mistake.scale + mistake.offset, true.tau[order] / mistake.force,
        Q[order] * scale, V[order] * scale, A[order] * scale, S[order] * np.sign(scale), T[order] / force,
    )  # fmt: skip
    back = mistake.applied(read)
    for name in ("q", "tau", "Q", "V", "A", "S", "T"):
        np.testing.assert_allclose(getattr(back, name), getattr(true, name), rtol=1e-9)


@given(seed=st.integers(0, 2**32 - 1))
def test_a_joint_that_is_read_beyond_its_limits_is_named(seed: int):
    rng = np.random.default_rng(seed)
    robot = wbc.load("quadruped", base="fixed")
    expected, least, most = Expected(robot, np.eye(3)), robot.limits.q_min, robot.limits.q_max
    q = rng.uniform(least, most)
    assert expected.outside(q + rng.uniform(-0.2, 0.2, 12)) == []
    joint, turns = rng.integers(12), rng.choice([-2, -1, 1, 2])
    turned, far = q.copy(), q.copy()
    turned[joint] += 2.0 * np.pi * turns
    far[joint] = most[joint] + rng.uniform(0.5, 2.0 * np.pi - (most - least)[joint] - 0.5)
    for read, why in ((turned, "off by whole turns"), (far, "its offset or its unit")):
        (found,) = expected.outside(read)
        assert found.joints == (robot.joint_names[joint],) and why in found.sentence


def test_a_joint_that_slides_is_told_in_metres(tmp_path: Path):
    """Degrees, radians and whole turns are mistakes of joints that turn; a slide is read in millimetres."""
    robot = sliding(tmp_path)
    expected, slide = Expected(robot, np.eye(3)), robot.joint_names.index("gripper")
    (outside,) = expected.outside(robot.q0 + 2.0 * np.pi * np.eye(4)[slide])
    rest = Response(robot.q0, np.zeros(4), *np.zeros((5, 4, 16)))
    read = replace(rest, q=robot.q0 + 0.5 * np.eye(4)[slide], tau=expected.at(robot.q0 + 0.5 * np.eye(4)[slide])[0] + 5)
    units = Candidates(expected).units()
    for mistake in [outside, *units, *Candidates(expected).shifted(read, expected)]:
        turning = [word for word in ("rad", "degrees", "turn") if word in mistake.sentence]
        moved = {robot.joint_names[k] for k in np.flatnonzero((mistake.scale != 1.0) | (mistake.offset != 0.0))}
        assert not turning or ("gripper" not in mistake.joints and "gripper" not in moved), mistake
    assert "is read at 6.28 m, beyond its limits -1 and 1 m" in outside.sentence
    millimetres = "gripper comes in millimetres and is taken for metres"
    assert [one.scale[slide] for one in units if one.sentence == millimetres] == [1000.0]
    who = {one.sentence.partition(" comes")[0] for one in units}
    assert {"every joint that turns", "every joint that slides"} <= who


def test_what_torques_do_not_show_is_said():
    expected = Expected(ARM, np.eye(3))
    amplitude = 0.06 * np.eye(7)
    Q = np.hstack([amplitude, np.zeros((7, 21))])
    rest = Response(ARM.q0, np.zeros(7), Q, 0.0 * Q, -((5.0 * np.pi) ** 2) * Q, 0.0 * Q, 0.0 * Q)
    gear, unit, offset = Candidates(expected).hidden(expected.ideal(rest), expected)
    assert "gear of" in gear and "wrist_roll" in gear and "elbow" not in gear
    assert "unit of" in unit and "wrist_roll" in unit and "elbow" not in unit
    assert "offset of" in offset and "shoulder_yaw" in offset and "wrist_roll" in offset and "elbow" not in offset


@pytest.mark.parametrize("fingers", [2, 6, 7, 20])
def test_limbs_that_are_alike_are_exchanged_each_with_each(fingers: int, tmp_path: Path):
    """A hand of many fingers has too many ways to exchange several pairs at once."""
    limbs = [link(f"f{k}", inertial()) + joint(f"j{k:02}", "palm", f"f{k}", axis="1 0 0") for k in range(fingers)]
    robot = wbc.load(saved(tmp_path, link("palm"), *limbs), base="fixed")
    found = Candidates(Expected(robot, np.eye(3))).limbs()
    orders = {tuple(one.order.tolist()) for one in found}
    assert len(orders) == len(found)
    assert all((np.array(order)[list(order)] == np.arange(fingers)).all() for order in orders), "in pairs"
    moved = [int((np.array(order) != np.arange(fingers)).sum()) for order in orders]
    assert moved.count(2) == fingers * (fingers - 1) // 2
    assert len(found) == (75 if fingers == 6 else moved.count(2))


@pytest.mark.parametrize(("share", "gear", "sign"), [(0.5, 1.0, 1), (0.3, 20.0, -1), (0.7, 0.1, 1)])
def test_no_joint_swings_further_than_its_range(share: float, gear: float, sign: int, tmp_path: Path):
    """A gripper that slides by centimetres, wherever it rests in the middle of them."""
    robot = sliding(tmp_path, reach=0.03)
    robot = robot.replace(q0=np.array([0.1, -0.2, 0.3, 0.03 * (share - 0.5)]))
    group = Ros2Control(robot.joint_names, gains=([60, 60, 60, 400 / gear**2], [3, 3, 3, 20 / gear**2]))
    joint_map = JointMap.of(robot, group.motors, gear={"gripper": gear}, sign={"gripper": sign})
    board = board_of(group, robot, joint_map=joint_map)
    checker = _Check(board, robot, device=group, joint_map=joint_map, hands=None, progress=lambda done: None)
    assert checker.listen() and checker.begin()
    asked: list[np.ndarray] = []
    send = checker._send
    checker._send = lambda position: asked.append(joint_map.position_from_device(position)) or send(position)
    assert checker.move() is not None
    assert np.ptp(asked, axis=0)[:3].min() > 0.1 and np.ptp(asked, axis=0)[3] > 0.005
    assert (np.abs(asked) <= robot.limits.q_max + 1e-9).all()


def test_gears_and_offsets_of_a_robot_without_torques_are_not_proven():
    found = checked_without_torques()
    assert found.ok and found.unproven == ["gears and offsets, as the robot reports no torques"]
    turned = checked_without_torques(offset={"elbow": 360.0})
    assert [one.kind for one in turned.findings] == ["offset"] and "elbow is read at" in turned.findings[0].sentence


@pytest.mark.parametrize("torn", [3, 900])
def test_a_torn_state_is_a_finding_whenever_it_comes(torn: int):
    """While motors move too: an error would leave the robot with its last order."""

    def spoil(came: list[Any]) -> Any:
        came[-1].name = came[-1].name[len(came) == torn :]
        return came[-1]

    checked, port = spoilt(spoil, dt=2e-3)
    (found,) = checked.findings
    assert found.kind == "frame" and found.sentence.startswith("states are not sound: the joint state has no ")
    assert len(port.came) > torn + 100


def test_the_joint_that_runs_away_is_named_and_not_the_one_that_is_moved():
    name = ARM.joint_names[3]

    def spoil(came: list[Any]) -> Any:
        came[-1].position[3] += 0.02 * max(0, len(came) - 900)  # while the first joint is moved
        return came[-1]

    (found,) = spoilt(spoil)[0].findings
    assert found.kind == "command" and found.joints == (name,)
    assert found.sentence.startswith(f"{name} runs away: ")


def test_a_floating_base_is_refused():
    robot = wbc.load("quadruped")
    with pytest.raises(InvalidInput, match="fixed base"):
        check(MotorBoard.__new__(MotorBoard), robot, device=UnitreeGo2())


# ---- motors with inertia, damping and friction
def motors(board: MotorBoard, seed: int) -> Mat:
    """Rotor inertia [kg m²], damping [N m s/rad] and dry friction [N m] (3, nj), over the decades that joints have.

    The same for all joints if the seed is even; else each joint its own, inertias in proportion to torque limits.
    Friction is at most half of what a motor gives at the amplitude of a check.
    """
    robot, rng = board.plant.model, np.random.default_rng([7, seed])
    least, most = np.array([[1e-3], [0.01], [0.01]]), np.array([[1.0], [10.0], [2.0]])
    drawn = np.ones((3, robot.nj)) * least * (most / least) ** rng.random((3, robot.nj if seed % 2 else 1))
    if seed % 2:
        drawn[0] *= robot.limits.tau_max / robot.limits.tau_max.max()
    drawn[2] = np.minimum(drawn[2], 0.5 * AMPLITUDE * np.asarray(board.device.gains[0])[: robot.nj])
    return drawn


def fitted(seed: int) -> Callable[[MotorBoard], None]:
    """Give a board such motors; its joints rest where a push from either side, and their friction, have left them."""

    def fit(board: MotorBoard) -> None:
        plant: Any = board.plant
        drawn, index = motors(board, seed), [plant._bridge.velocity_index(i) for i in range(plant.model.nj)]
        physics = plant.physics
        physics.dof_armature[index], physics.dof_damping[index], physics.dof_frictionloss[index] = drawn
        plant._damping = physics.dof_damping.copy()
        mujoco.mj_setConst(physics, mujoco.MjData(physics))
        board.hand[:] = np.random.default_rng(seed).choice([-1.5, 1.5], plant.model.nj) * drawn[2]
        board.sleep(0.5)
        board.hand[:] = 0.0
        board.sleep(0.5)

    return fit


@given(seed=st.integers(0, 2**32 - 1))
def test_inertia_damping_and_friction_of_motors_are_told_apart(seed: int):
    """Friction to a tenth, whatever the others are; the fit leaves no error."""
    rng, expected = np.random.default_rng(seed), Expected(ARM, np.eye(3))
    t, n = 1e-3 * np.arange(1200), ARM.nj
    weights, omega = Weights(len(t), 1e-3, 2.5), 5.0 * np.pi
    grows = np.minimum(1.0, 2.5 * t)
    q = 0.03 * grows * np.sin(omega * t)
    v, a = np.gradient(q, t), np.gradient(np.gradient(q, t), t)
    inertia, damping, friction = 10.0 ** rng.uniform([-3.0, -2.0, -1.0], [0.0, 1.0, 0.3])
    j = int(rng.integers(n))
    gravity, G, M = expected.at(ARM.q0)
    Q, V, A, S, T = np.zeros((5, n, 4 * n))
    columns = slice(j, None, n)
    Q[j, columns], V[j, columns], A[j, columns] = weights.phi @ q, -weights.first @ q, weights.second @ q
    S[j, columns] = weights.signs(q)
    T[:, columns] = (weights.phi @ (np.outer(q, G[:, j]) + np.outer(a, M[:, j]))).T
    T[j, columns] += weights.phi @ (inertia * a + damping * v + friction * np.sign(v))
    seen = Response(ARM.q0, gravity, Q, V, A, S, T)
    assert abs(expected._fitted(seen)[1][j] - friction) < 0.1 * friction
    assert expected.cost(seen) < 0.01


@pytest.mark.parametrize("kind", ["franka", "go2"])
def test_a_sound_robot_is_not_blamed_for_its_motors(kind: str):
    found = checked(kind, 0, fit=fitted(0))
    assert found.ok, found


@pytest.mark.deep
@pytest.mark.parametrize("kind", ["franka", pytest.param("panda", marks=needs_examples), "go2"])
def test_few_sound_robots_are_blamed_for_their_motors(kind: str):
    blamed = [seed for seed in range(1, 40) if not checked(kind, seed, fit=fitted(seed)).ok]
    assert len(blamed) <= 2, blamed


@pytest.mark.parametrize("seed", range(40))
def test_motors_of_the_seeded_robots_hold_still_by_themselves(seed: int):
    """At the period at which the board follows their law; where they swing, a sound robot is blamed."""
    robot, device = wbc.load("quadruped", base="fixed"), UnitreeGo2()
    board: Any = SimpleNamespace(plant=SimpleNamespace(model=robot), device=device)
    rotor, damping, _ = (part * np.ones(robot.nj) for part in motors(board, seed))
    state, dt = robot.state(), period(device)
    state.update(0.0, robot.q0, np.zeros(robot.nv))
    inverse = np.linalg.inv(state.M + np.diag(rotor + dt * damping))
    for kp, kd in (holding_gains(robot), device.gains):
        # v' = v − dt M⁻¹ ((kd + d) v + kp q), q' = q + dt v'
        slows, pulls = np.eye(12) - dt * inverse @ np.diag(kd + damping), -dt * inverse @ np.diag(kp)
        step = np.block([[np.eye(12) + dt * pulls, dt * slows], [pulls, slows]])
        assert np.abs(np.linalg.eigvals(step)).max() < 1.0


WRONG = {
    "franka": [("gear", joint, value) for joint in ("shoulder_yaw", "elbow", "wrist_pitch") for value in (0.5, 2.0)]
    + [("offset", joint, value) for joint in ("shoulder_pitch", "elbow", "wrist_pitch") for value in (-0.4, 0.4)]
    + [("sign", joint, -1) for joint in ("shoulder_yaw", "elbow", "wrist_roll")],
    "go2": [("gear", f"front_left_{joint}", value) for joint in ("hip_roll", "knee") for value in (0.5, 2.0)]
    + [("offset", f"rear_left_{joint}", value) for joint in ("hip_pitch", "knee") for value in (-0.4, 0.4)]
    + [("sign", f"rear_right_{joint}", -1) for joint in ("hip_roll", "hip_pitch", "knee")],
}


@pytest.mark.deep
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("kind", "what", "joint", "value"), [(kind, *wrong) for kind, every in WRONG.items() for wrong in every]
)
def test_a_mistake_is_found_or_said_to_be_unproven(kind: str, what: str, joint: str, value: float, seed: int):
    found = checked(kind, seed, Seeded("", kind, what, "", wrong={what: {joint: value}}), fit=fitted(seed))
    assert not found.ok or any(what in text and joint in text for text in found.unproven), found
