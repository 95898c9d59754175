"""MuJoCo's own reading of a file, against a robot that was loaded from it."""

from __future__ import annotations

from typing import Any

import numpy as np


def compare(robot: Any, physics: Any, seed: int, tolerance: float = 1e-12) -> None:
    """M, bias and frames at a random state, in the robot's gravity; ``physics`` may hold more than the robot."""
    import mujoco

    random = np.random.default_rng(seed)
    q, v = robot.random_configuration(random), random.standard_normal(robot.nv)
    state, nb = robot.state(), robot.nb
    state.update(0.0, q, v)
    physics.opt.gravity[:], physics.opt.density, physics.opt.viscosity = robot.gravity, 0.0, 0.0
    physics.opt.disableflags = 0
    data = mujoco.MjData(physics)
    joints = [_joint(physics, name) for name in robot.joint_names]
    X, drift = np.zeros((physics.nv, robot.nv)), np.zeros(physics.nv)
    X[physics.jnt_dofadr[joints], range(nb, robot.nv)] = 1.0
    data.qpos[physics.jnt_qposadr[joints]] = q[robot.nq - robot.nj :]
    if nb:
        free = physics.body(robot.urdf.links[0].name).jntadr[0]
        at, dof = physics.jnt_qposadr[free], physics.jnt_dofadr[free]
        data.qpos[at : at + 3], data.qpos[at + 3 : at + 7] = q[:3], q[[6, 3, 4, 5]]
        R = np.zeros(9)
        mujoco.mju_quat2Mat(R, data.qpos[at + 3 : at + 7].copy())
        R = R.reshape(3, 3)
        X[dof : dof + 3, :3], X[dof + 3 : dof + 6, 3:6] = R, np.eye(3)
        drift[dof : dof + 3] = R @ np.cross(v[3:6], v[:3])
    data.qvel[:] = X @ v
    mujoco.mj_forward(physics, data)
    M = np.zeros((physics.nv, physics.nv))
    mujoco.mj_fullM(physics, data, M)
    theirs = X.T @ M @ X
    np.testing.assert_allclose(state.M, theirs, atol=tolerance * np.abs(theirs).max())
    bias = X.T @ (data.qfrc_bias + M @ drift)
    np.testing.assert_allclose(state.h, bias, atol=tolerance * (1 + np.abs(bias).max()))
    bodies = {physics.body(i).name for i in range(physics.nbody)}
    for kind, places, axes in (("body", data.xpos, data.xmat), ("site", data.site_xpos, data.site_xmat)):
        for i in range(getattr(physics, f"n{kind}")):
            name = getattr(physics, kind)(i).name
            if name and name in robot.frame_names and name != "world" and (kind == "body" or name not in bodies):
                frame = state.frame(name)
                np.testing.assert_allclose(frame.position, places[i], atol=tolerance)
                np.testing.assert_allclose(frame.rotation, axes[i].reshape(3, 3), atol=tolerance)


def corners(physics: Any) -> list[list[float]]:
    """The vertices of the only mesh in the axes of its body, sorted; MuJoCo has them in single precision."""
    import mujoco

    geom, R = int(np.flatnonzero(physics.geom_type == mujoco.mjtGeom.mjGEOM_MESH)[0]), np.zeros(9)
    mujoco.mju_quat2Mat(R, physics.geom_quat[geom])
    found: list[list[float]] = (physics.mesh_vert @ R.reshape(3, 3).T + physics.geom_pos[geom]).tolist()
    return sorted(found)


def _joint(physics: Any, name: str) -> int:
    """A joint without a name is called by its number."""
    import mujoco

    found = mujoco.mj_name2id(physics, mujoco.mjtObj.mjOBJ_JOINT, name)
    return found if found >= 0 else int(name.removeprefix("joint_"))
