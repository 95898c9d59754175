"""Frames a second beside mink, in a two-stage loop of the kind that GMR runs: same model, targets and weights.

    python tests/motion/beside_mink.py targets.npz                 # ours; writes the targets
    PYTHON_WITH_MINK tests/motion/beside_mink.py targets.npz G1.urdf   # mink 1.3 with daqp

GMR (github.com/YanjieZe/GMR, MIT) solves every frame in two stages, each with its own weights, until the error falls
by less than 1e-3 or ten steps are done. Here the first stage has the feet and the pelvis, the second everything. Joints
are kept within their limits by both; neither looks for collisions. Processor time, the least of five turns.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from time import process_time

import numpy as np

TURNS = 5


def ours(path: Path) -> None:
    """Write the targets, and say how long our frames take."""

    import wbc
    from wbc.motion import Table, made
    from wbc.motion.retargeting import Retargeting
    from wbc.motion.targets import targets as of_robot

    robot = wbc.load("g1", base="floating")
    table, q = Table.of(robot), np.zeros(0)
    columns: dict[str, list[np.ndarray]] = {"places": [], "turned": []}
    seconds, frames, steps, errors = [np.inf] * 3, 0, 0, []
    names = ("dance", "walk", "squat")
    for k, name in enumerate(names):
        motion = made(name)
        targets, _ = of_robot(motion, robot, table)
        parts = [part for part, one in table.followers.items() if one.position or one.orientation]
        columns["places"].append(np.stack([targets.positions[part] for part in parts], axis=1))
        still = np.tile(np.eye(3), (motion.frames, 1, 1))
        columns["turned"].append(np.stack([targets.rotations.get(part, still) for part in parts], axis=1))
        for _ in range(TURNS):
            stack = Retargeting(robot, table, targets, acceleration=np.inf, collisions=False)
            start = process_time()
            q = stack.frames(lambda done: None)
            seconds[k] = min(seconds[k], process_time() - start)
        frames, steps = frames + motion.frames, steps + stack.steps
        errors.append(_errors(robot, table, parts, targets, q))
    followers = [table.followers[part] for part in parts]
    np.savez(
        path, places=np.vstack(columns["places"]), turned=np.vstack(columns["turned"]), first=robot.q0,
        starts=np.cumsum([0, *map(len, columns["places"])]), frames=[one.frame for one in followers],
        weights=[[one.position, one.orientation] for one in followers], parts=parts,
        joints=robot.joint_names,
    )  # fmt: skip
    _say("wbc", frames, sum(seconds), steps, np.concatenate(errors))


def _errors(robot, table, parts, targets, q) -> np.ndarray:
    state, rows = robot.state(), []
    for k in range(len(q)):
        state.update(0.0, q[k], np.zeros(robot.nv))
        places = [state.frame(table.followers[part].frame).position for part in parts]
        rows.append([np.linalg.norm(p - targets.positions[part][k]) for p, part in zip(places, parts, strict=True)])
    weights = np.array([table.followers[part].position for part in parts])
    return np.sqrt((np.square(rows) * weights).sum(axis=1) / weights.sum())


def theirs(path: Path) -> None:
    """How long mink's frames take."""
    import mink
    import mujoco

    data = np.load(path)
    text = re.sub(r"<(visual|collision)\b.*?</\1>", "", Path(sys.argv[2]).read_text(), flags=re.DOTALL)
    at = text.index(">", text.index("<robot")) + 1
    text = (
        text[:at]
        + '<mujoco><compiler fusestatic="false" discardvisual="true" balanceinertia="true"/></mujoco>'
        + text[at:]
    )
    spec = mujoco.MjSpec.from_string(text)
    spec.worldbody.first_body().add_freejoint()
    model = spec.compile()
    q0 = np.zeros(model.nq)
    q0[:3], q0[3:7] = data["first"][:3], data["first"][[6, 3, 4, 5]]
    for name, value in zip(data["joints"], data["first"][7:], strict=True):
        q0[model.joint(str(name)).qposadr[0]] = value
    limits = [mink.ConfigurationLimit(model, gain=1.0)]
    tasks, first = [], []
    for frame, part, (position, orientation) in zip(data["frames"], data["parts"], data["weights"], strict=True):
        costs = {"position_cost": position**0.5, "orientation_cost": orientation**0.5}
        task = mink.FrameTask(str(frame), "body", lm_damping=1.0, **costs)
        tasks.append(task)
        if "foot" in str(part) or part == "pelvis":
            first.append(task)
    posture = mink.PostureTask(model, cost=1e-2)
    posture.set_target(q0)
    weights = data["weights"][:, 0]
    best, least = np.inf, np.zeros(0)
    steps = 0
    for _ in range(TURNS):
        errors, spent, steps = [], 0.0, 0
        for start, stop in zip(data["starts"], data["starts"][1:], strict=False):
            configuration = mink.Configuration(model)
            configuration.update(q0)
            for k in range(start, stop):
                begun = process_time()
                for task, place, turn in zip(tasks, data["places"][k], data["turned"][k], strict=True):
                    pose = np.eye(4)
                    pose[:3, :3], pose[:3, 3] = turn, place
                    task.set_target(mink.SE3.from_matrix(pose))
                for stage in (first, tasks):
                    used = [*stage, posture]
                    last = _total(stage, configuration)
                    for _ in range(10 if k > start else 200):
                        velocity = mink.solve_ik(configuration, used, 0.02, "daqp", 0.5 * 1e-3, limits=limits)
                        configuration.integrate_inplace(velocity, 0.02)
                        steps += 1
                        now = _total(stage, configuration)
                        if last - now < 1e-3:
                            break
                        last = now
                spent += process_time() - begun
                places = [configuration.get_transform_frame_to_world(t.frame_name, "body").translation() for t in tasks]
                far = np.linalg.norm(np.array(places) - data["places"][k], axis=1)
                errors.append(np.sqrt((np.square(far) * weights).sum() / weights.sum()))
        best, least = min(best, spent), np.array(errors)
    _say("mink", len(least), best, steps, least)


def _total(tasks, configuration) -> float:
    return float(np.linalg.norm(np.concatenate([task.compute_error(configuration) for task in tasks])))


def _say(name: str, frames: int, seconds: float, steps: int, errors: np.ndarray) -> None:
    print(
        f"{name}: {frames / seconds:.0f} frames/s, {steps / frames:.2f} steps a frame, "
        f"weighted error median {1e3 * np.median(errors):.2f} mm, p95 {1e3 * np.percentile(errors, 95):.2f} mm"
    )


if __name__ == "__main__":
    target = Path(sys.argv[1])
    theirs(target) if len(sys.argv) > 2 else ours(target)
