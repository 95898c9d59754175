"""The check names mistakes that are seeded, and finds nothing where there are none."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from tests.robots.examples import needs_examples
from tests.robots.test_joint_map import sliding
from wbc.errors import InvalidInput
from wbc.robots import JointMap, LeRobot, MotorBoard, Ros2Control, UnitreeGo2
from wbc.robots.check import Checked, _Check, check
from wbc.robots.hands import BoardHands
from wbc.robots.response import Candidates, Expected, Response
from wbc.sim.engine import PhysicsSettings

pytest.importorskip("mujoco")
pytestmark = pytest.mark.physics

from tests.robots.mistakes import CLEAN, MISTAKES, Seeded, checked, page  # noqa: E402 - needs the physics engine
from tests.robots.test_loop import Spoiled  # noqa: E402
from wbc.sim.mujoco_ import MujocoPlant  # noqa: E402

GAINS = [200, 200, 150, 150, 60, 60, 20], [10, 10, 8, 8, 2, 2, 0.5]


def checked_without_torques(**conventions: Any) -> Checked:
    """A check of an arm that says positions in degrees alone."""
    robot = wbc.load("arm")
    arm = LeRobot(robot.joint_names)
    board = MotorBoard(arm, MujocoPlant(robot, settings=PhysicsSettings(armature=0.01)))
    return check(board, robot, joint_map=arm.joint_map(robot, **conventions), hands=BoardHands(board))


QUICK = {"crc 0", "w first", "accelerometer in g", "stale states", "states at 50 Hz", "no states", "sign of joint 4"}
QUICK |= {"states sent twice", "IMU mirrored", "accelerometer without gravity", "a whole turn at joint 4"}
QUICK |= {"joints 1 and 3", "offset of joint 4", "torques with the other sign", "clock in milliseconds"}


def _marked(mistake: Seeded) -> object:
    marks = [] if mistake.what in QUICK and mistake.robot != "g1" else [pytest.mark.deep]
    if mistake.robot == "g1":
        marks.append(needs_examples)
    return pytest.param(mistake, marks=marks, id=f"{mistake.robot}: {mistake.what}")


def test_there_are_enough_mistakes_on_three_devices():
    assert len(MISTAKES) >= 40 and {mistake.robot for mistake in MISTAKES} == {"go2", "franka", "g1"}


def test_the_page_lists_the_mistakes():
    written = Path(__file__).parents[2] / "docs" / "robots" / "mistakes.md"
    assert written.read_text(encoding="utf-8") == page(), "write it anew: python3 -m tests.robots.mistakes"


@pytest.mark.parametrize("mistake", [_marked(mistake) for mistake in MISTAKES])
def test_a_mistake_is_named(mistake: Seeded):
    found = checked(mistake.robot, seed=100 + MISTAKES.index(mistake), mistake=mistake)
    assert [finding.kind for finding in found.findings] == [mistake.kind], found
    assert mistake.says in found.findings[0].sentence


@pytest.mark.parametrize(
    ("kind", "seed"),
    [
        pytest.param(
            kind, seed, marks=[needs_examples] * (kind == "g1") + [pytest.mark.deep] * (seed > 0 or kind != "franka")
        )
        for kind, count in CLEAN.items()
        for seed in range(count)
    ],
)
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
    import pinocchio

    rng = np.random.default_rng(seed)
    robot = wbc.load("arm")
    expected = Expected(robot, np.eye(3))
    t, dt = np.linspace(0.0, 1.0, 2001), 5e-4
    size = 1e-4
    shapes = [(rng.normal(size=7), rng.uniform(1.0, 12.0), rng.uniform(0.0, 6.0)) for _ in range(3)]
    dq, dv, da = np.zeros((3, len(t), 7))
    for amplitude, omega, phase in shapes:
        dq += size * np.outer(np.sin(omega * t + phase), amplitude)
        dv += size * omega * np.outer(np.cos(omega * t + phase), amplitude)
        da -= size * omega**2 * np.outer(np.sin(omega * t + phase), amplitude)
    data = expected._model.createData()
    tau = np.array(
        [pinocchio.rnea(expected._model, data, robot.q0 + q, v, a) for q, v, a in zip(dq, dv, da, strict=True)]
    )
    gravity, G, M = expected.at(robot.q0)
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


def test_what_torques_do_not_show_is_said():
    robot = wbc.load("arm")
    expected = Expected(robot, np.eye(3))
    amplitude = 0.06 * np.eye(7)
    Q = np.hstack([amplitude, np.zeros((7, 21))])
    rest = Response(robot.q0, np.zeros(7), Q, 0.0 * Q, -((5.0 * np.pi) ** 2) * Q, 0.0 * Q, 0.0 * Q)
    gear, unit, offset = Candidates(expected).hidden(expected.ideal(rest), expected)
    assert "gear of" in gear and "wrist_roll" in gear and "elbow" not in gear
    assert "unit of" in unit and "wrist_roll" in unit and "elbow" not in unit
    assert "offset of" in offset and "shoulder_yaw" in offset and "wrist_roll" in offset and "elbow" not in offset


@pytest.mark.parametrize("fingers", [2, 6, 7, 20])
def test_limbs_that_are_alike_are_exchanged_each_with_each(fingers: int, tmp_path: Path):
    """A hand of many fingers has too many ways to exchange several pairs at once."""
    mass = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    text = '<robot name="hand"><link name="palm"/>'
    for k in range(fingers):
        text += f'<link name="f{k}">{mass}</link><joint name="j{k:02}" type="revolute"><parent link="palm"/>'
        text += f'<child link="f{k}"/><axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="9" velocity="1"/></joint>'
    (tmp_path / "hand.urdf").write_text(text + "</robot>")
    found = Candidates(Expected(wbc.load(tmp_path / "hand.urdf", base="fixed"), np.eye(3))).limbs()
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
    board = MotorBoard(group, MujocoPlant(robot, settings=PhysicsSettings(armature=0.01)), joint_map=joint_map)
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
    robot = wbc.load("arm")
    group = Ros2Control(robot.joint_names, gains=GAINS)

    def spoil(k: int, frame: Any) -> Any:
        frame.name = frame.name[k == torn :]
        return frame

    port = Spoiled(MotorBoard(group, MujocoPlant(robot, dt=2e-3, settings=PhysicsSettings(armature=0.01))), spoil)
    (found,) = check(port, robot).findings
    assert found.kind == "frame" and found.sentence.startswith("states are not sound: the joint state has no ")
    assert port.k > torn + 100


def test_the_joint_that_runs_away_is_named_and_not_the_one_that_is_moved():
    robot = wbc.load("arm")
    group = Ros2Control(robot.joint_names, gains=GAINS)

    def spoil(k: int, frame: Any) -> Any:
        frame.position[3] += 0.02 * max(0, k - 900)  # while the first joint is moved
        return frame

    port = Spoiled(MotorBoard(group, MujocoPlant(robot, settings=PhysicsSettings(armature=0.01))), spoil)
    (found,) = check(port, robot).findings
    assert found.kind == "command" and found.joints == (robot.joint_names[3],)
    assert found.sentence.startswith(f"{robot.joint_names[3]} runs away: ")


def test_a_floating_base_is_refused():
    robot = wbc.load("quadruped")
    with pytest.raises(InvalidInput, match="fixed base"):
        check(MotorBoard.__new__(MotorBoard), robot, device=UnitreeGo2())
