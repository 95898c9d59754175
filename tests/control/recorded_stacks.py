"""Stacks like the five workloads on our own robots, and what a controller answers along a motion of each.

``python -m tests.control.recorded_stacks FILE`` records: states, commands, statuses and active rows of every case.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

import tasks as T
import wbc
from wbc.models.model import RobotModel

FILE = Path(__file__).parent / "recorded_ticks.npz"
TICKS, EVERY, DT = 300, 10, 2e-3
HIERARCHIES: Mapping[str, Any] = {"weighted": wbc.Weighted(), "strict": wbc.Strict(), "scaled": wbc.Scaled()}
#: Without the damping of what cannot be reached, which remembers the tick before.
VELOCITIES, DYNAMICS = wbc.VelocityLevel(lm_damping=0.0), wbc.InverseDynamics(lm_damping=0.0)


def arm_kinematics() -> tuple[RobotModel, wbc.Stack, Any]:
    """W1: the tool on a path that its speed limits cannot follow everywhere."""
    robot = wbc.load("arm")
    place = robot.state().frame("tool").position.copy()
    sway = T.Sinusoid(place, amplitude=[0.15, 0.4, 0.1], frequency=2.0)
    tasks = [[T.Position("tool", target=sway, rate=200.0)], [T.Posture(robot.q0, rate=50.0, weight=1e-3)]]
    return robot, wbc.Stack(tasks, subject_to=[T.JointPositionLimits(), T.JointVelocityLimits()]), VELOCITIES


def humanoid_kinematics() -> tuple[RobotModel, wbc.Stack, Any]:
    """W2: feet that stay, centre of mass and a hand that move."""
    robot = wbc.load("humanoid")
    state = robot.state()
    feet = [T.Frame(foot, target=_pose(state, foot), rate=200.0, weight=100.0) for foot in ("left_sole", "right_sole")]
    sway = T.Sinusoid(state.com, amplitude=[0.01, 0.03, 0.0], frequency=0.5)
    hand = T.Sinusoid(state.frame("left_hand").position.copy(), amplitude=[0.4, 0.0, 0.4], frequency=6.0)
    tasks: list[list[Any]] = [
        feet, [T.CenterOfMass(target=sway, rate=100.0), T.Position("left_hand", target=hand, rate=100.0)],
        [T.Posture(robot.q0, rate=20.0, weight=1e-3)],
    ]  # fmt: skip
    return robot, wbc.Stack(tasks, subject_to=[T.JointPositionLimits(), T.JointVelocityLimits()]), VELOCITIES


def arm_dynamics() -> tuple[RobotModel, wbc.Stack, Any]:
    """W3: the tool is pulled harder than the motors can."""
    robot = wbc.load("arm")
    place = robot.state().frame("tool").position.copy()
    sway = T.Sinusoid(place, amplitude=[0.15, 0.3, 0.1], frequency=1.5)
    tasks = [[T.Position("tool", target=sway, kp=400.0)], [T.Posture(robot.q0, kp=10.0, weight=1e-3)]]
    return (
        robot,
        wbc.Stack(tasks, subject_to=[T.TorqueLimits(0.25 * robot.limits.tau_max), T.JointVelocityLimits()]),
        DYNAMICS,
    )


def quadruped_dynamics() -> tuple[RobotModel, wbc.Stack, Any]:
    """W4: more sideways acceleration than friction gives."""
    robot = wbc.load("quadruped")
    state = robot.state()
    sway = T.Sinusoid(state.com, amplitude=[0.02, 0.03, 0.02], frequency=2.0)
    upright = T.Orientation("trunk", target=np.eye(3), kp=100.0)
    tasks: list[list[Any]] = [
        [T.CenterOfMass(target=sway, kp=100.0), upright], [T.Posture(robot.q0, kp=10.0, weight=1e-3)]
    ]  # fmt: skip
    contacts = [
        T.Point(foot, friction=0.3, friction_model="outer", kp=100.0, kd=20.0, force_weight=1e-6)
        for foot in ("front_left_foot", "front_right_foot", "rear_left_foot", "rear_right_foot")
    ]
    return robot, wbc.Stack(tasks, subject_to=[T.TorqueLimits(), T.JointVelocityLimits()], contacts=contacts), DYNAMICS


def humanoid_dynamics() -> tuple[RobotModel, wbc.Stack, Any]:
    """W5: weight goes from one sole to the other."""
    robot = wbc.load("humanoid")
    sway = T.Sinusoid(robot.state().com, amplitude=[0.01, 0.06, 0.02], frequency=0.8)
    upright = T.Orientation("torso", target=np.eye(3), kp=100.0, weight=0.1)
    tasks: list[list[Any]] = [
        [T.CenterOfMass(target=sway, kp=100.0), upright], [T.Posture(robot.q0, kp=10.0, weight=1e-3)]
    ]  # fmt: skip
    contacts = [
        T.Sole(foot, half_size=(0.1, 0.05), friction=0.3, friction_model="outer", kp=100.0, kd=20.0, force_weight=1e-6)
        for foot in ("left_sole", "right_sole")
    ]
    return robot, wbc.Stack(tasks, subject_to=[T.TorqueLimits(), T.JointVelocityLimits()], contacts=contacts), DYNAMICS


def _pose(state: Any, frame: str) -> Any:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = state.frame(frame).rotation, state.frame(frame).position
    return pose


CASES: Mapping[str, Callable[[], tuple[RobotModel, wbc.Stack, Any]]] = {
    made.__name__: made
    for made in (arm_kinematics, humanoid_kinematics, arm_dynamics, quadruped_dynamics, humanoid_dynamics)
}


def controller(case: str, hierarchy: str) -> wbc.Controller:
    """The controller of a case."""
    robot, stack, level = CASES[case]()
    return wbc.Controller(robot, stack, level=level, hierarchy=HIERARCHIES[hierarchy], dt=DT)


def answer(control: wbc.Controller, command: wbc.control.command.Command) -> Any:
    """What is decided: velocities, or accelerations and torques."""
    return command.v if control.level.order == 1 else np.concatenate([command.a, command.tau])


def active(control: wbc.Controller) -> Any:
    """Which unknowns and range rows are at a bound, 1 or −1."""
    p = control.plan.problem
    bounded = slice(0, p.item(p.range.stop))
    value, low, high = p.value[bounded], p.lower[bounded], p.upper[bounded]
    near = 1e-7 * (1.0 + np.abs(value))
    return ((value >= high - near).astype(np.int8) - (value <= low + near)).astype(np.int8)


def record(file: Path) -> None:
    """Follow each case for its ticks, and write every tenth down."""
    found: dict[str, Any] = {}
    for case in CASES:
        for hierarchy in HIERARCHIES:
            control = controller(case, hierarchy)
            q, v = control.model.q0.copy(), np.zeros(control.model.nv)
            rows: dict[str, list[Any]] = {"q": [], "v": [], "answer": [], "ok": [], "active": []}
            for k in range(TICKS):
                command = control.tick(k * DT, q, v)
                if k % EVERY == 0:
                    values = (q, v, answer(control, command), command.status.ok, active(control))
                    for row, value in zip(rows.values(), values, strict=True):
                        row.append(np.array(value))
                q, v = command.q, command.v
            found |= {f"{case}/{hierarchy}/{name}": np.array(values) for name, values in rows.items()}
            print(
                case,
                hierarchy,
                np.mean(rows["ok"]),
                max(int(np.abs(each).sum()) for each in rows["active"]),
                file=sys.stderr,
            )
    np.savez_compressed(file, **found)


if __name__ == "__main__":
    record(Path(sys.argv[1]) if len(sys.argv) > 1 else FILE)
