"""``wbc.reach`` beside a clipped damped-least-squares loop and beside Pink's loop, on poses that can be reached.

    pip install pin-pink==4.4.0
    python tests/control/beside_pink.py 1000     # poses of each hand; without Pink its column stays empty

The poses are those of random configurations within the limits that do not collide. All three have the same Pinocchio
model, the joints that carry the hand, the same first configuration and as many starts. Each ends where no component of
the error is above 1e-5 (m, rad), in world axes or the frame's. A pose counts as solved where position and rotation are
within √3 1e-5 of it, which both imply, and every joint is within its limits. Processor time.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable
from time import process_time
from typing import Any

import numpy as np
import pinocchio as pin

import wbc
from wbc.models.collision import Distances
from wbc.tasks import Frame

try:
    import pink
except ImportError:
    pink = None

STARTS, STEPS, NEAR, STEP = 30, 100, 1e-5, 0.5
#: Robot, hand, and the beginnings of the names of the joints that carry it.
HANDS = [
    ("ur5", "tool0", ("",)),
    ("panda", "panda_hand", ("",)),
    ("baxter", "left_gripper", ("left_",)),
    ("g1", "left_rubber_hand", ("left_shoulder", "left_elbow", "left_wrist")),
]


def error(model: Any, data: Any, frame: int, target: Any, q: Any) -> Any:
    """Position, then rotation, in the frame's axes (6,)."""
    pin.framesForwardKinematics(model, data, q)
    here = data.oMf[frame]
    turned = here.rotation.T
    return np.r_[turned @ (target.translation - here.translation), pin.log3(turned @ target.rotation)]


def with_restarts(model: Any, descend: Callable[[Any], Any], target: Any, frame: int, q: Any, seed: int) -> Any:
    """What ``descend`` finds from q, or from other configurations drawn within the limits."""
    rng, data = np.random.default_rng(seed), model.createData()
    for start in range(STARTS):
        q = rng.uniform(model.lowerPositionLimit, model.upperPositionLimit) if start else q
        q = descend(q)
        if np.abs(error(model, data, frame, target, q)).max() <= NEAR:
            break
    return q


def least_squares(model: Any, target: Any, frame: int) -> Callable[[Any], Any]:
    data, low, high = model.createData(), model.lowerPositionLimit, model.upperPositionLimit

    def descend(q: Any) -> Any:
        for _ in range(STEPS):
            e = error(model, data, frame, target, q)
            if np.abs(e).max() <= NEAR:
                break
            J = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL)
            step = J.T @ np.linalg.solve(J @ J.T + 1e-6 * np.eye(6), e)
            q = np.clip(q + step * min(1.0, STEP / np.abs(step).max()), low, high)
        return q

    return descend


def of_pink(model: Any, target: Any, name: str) -> Callable[[Any], Any]:
    task, data, dt = pink.FrameTask(name, position_cost=1.0, orientation_cost=1.0), model.createData(), 0.01
    task.set_target(target)

    def descend(q: Any) -> Any:
        q = np.clip(q, model.lowerPositionLimit, model.upperPositionLimit)
        configuration = pink.Configuration(model, data, q)
        limits = [pink.limits.ConfigurationLimit(model, config_limit_gain=1.0)]
        for _ in range(STEPS):
            if np.abs(task.compute_error(configuration)).max() <= NEAR:
                break
            try:
                velocity = pink.solve_ik(configuration, [task], dt, "daqp", limits=limits, safety_break=False)
            except pink.exceptions.NoSolutionFound:  # at a limit, by rounding
                break
            step = dt * velocity
            step *= min(1.0, STEP / max(np.abs(step).max(), 1e-12))
            configuration.integrate_inplace(step / dt, dt)
        return configuration.q

    return descend


def clear_poses(robot: Any, carried: list[str], model: Any, frame: int, count: int) -> list[Any]:
    """Poses of the hand in random configurations in which no two links are nearer than 1 mm."""
    distances = Distances(robot, reach=0.05, margin=1e-3)
    rng, state, data, found = np.random.default_rng(1), robot.state(), model.createData(), []
    at = [robot.joint(name) for name in carried]
    while len(found) < count:
        q = rng.uniform(model.lowerPositionLimit, model.upperPositionLimit)
        whole = np.array(robot.q0)
        whole[at] = q
        state.update(0.0, whole, np.zeros(robot.nv))
        distances.read(state)
        if distances.distance.min() > 1e-3:
            pin.framesForwardKinematics(model, data, q)
            found.append(data.oMf[frame].copy())
    return found


def compare(name: str, hand: str, carriers: tuple[str, ...], count: int) -> str:
    robot = wbc.load(name, base="fixed")
    carried = [joint for joint in robot.joint_names if joint.startswith(carriers)]
    first = np.array(robot.q0)[[robot.joint(joint) for joint in carried]]
    locked = [robot.pinocchio.getJointId(joint) for joint in robot.joint_names if joint not in carried]
    model = pin.buildReducedModel(robot.pinocchio, locked, np.array(robot.q0))
    frame = model.getFrameId(hand)
    arm = wbc.load(model, q0=first)
    searches = {
        "wbc.reach": lambda pose, seed: wbc.reach(arm, [Frame(hand, target=pose)], attempts=STARTS, seed=seed).q,
        "DLS": lambda pose, seed: with_restarts(model, least_squares(model, pose, frame), pose, frame, first, seed),
    }
    if pink is not None:
        searches["Pink"] = lambda pose, seed: with_restarts(model, of_pink(model, pose, hand), pose, frame, first, seed)
    data, cells = model.createData(), []
    low, high = model.lowerPositionLimit - 1e-6, model.upperPositionLimit + 1e-6
    poses = clear_poses(robot, carried, model, frame, count)
    for search in searches.values():
        search(poses[0], 0)  # the first call imports
        solved, seconds = 0, []
        for seed, pose in enumerate(poses):
            start = process_time()
            q = search(pose, seed)
            seconds.append(process_time() - start)
            met = np.linalg.norm(error(model, data, frame, pose, q).reshape(2, 3), axis=1).max() <= 3**0.5 * NEAR
            solved += bool(met and (low <= q).all() and (q <= high).all())
        half, most = 1e3 * np.percentile(seconds, [50.0, 99.0])
        cells.append(f"{100 * solved / count:.1f} %, {half:.1f} ms, {most:.0f} ms")
    return f"| {name}, {hand} | {model.nv} | " + " | ".join(cells) + " |"


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    for case in HANDS:
        print(compare(*case, int(sys.argv[1]) if len(sys.argv) > 1 else 1000), flush=True)
