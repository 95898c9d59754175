"""Bridge between two orders of the same state: the model's (see :mod:`wbc.types`) and MuJoCo's.

    base position       the same
    base orientation    x y z w                 w x y z
    base velocity       linear, base axes       linear, world axes
    angular velocity    base axes               base axes
    joints              in the model's order    in the order of the file: matched by name

so that q̇_mj = X v with X = diag(R, 1, permutation), and q̈_mj = X a + (R (ω × v_linear), 0).
"""

from __future__ import annotations

from typing import Any, final

import numpy as np

from wbc.errors import SimulationError
from wbc.models.model import RobotModel
from wbc.sim.engine import mujoco
from wbc.types import Mat, Vec


@final
class Bridge:
    """Reads and writes the state of ``physics`` (a ``mujoco.MjModel``) in the order of ``model``.

    Raises:
        SimulationError: the two have other joints.
    """

    def __init__(self, model: RobotModel, physics: Any) -> None:
        mj = mujoco()
        self._mj = mj
        self._nb, self._nq, self._nv = model.nb, model.nq, model.nv
        base_q = 7 if model.nb else 0
        if (physics.nq, physics.nv) != (model.nj + base_q, model.nj + model.nb) or model.nq != physics.nq:
            raise SimulationError(
                f"physics has {physics.nv} velocities, {model.name} has {model.nv}: they are not the same robot"
            )
        ids = [mj.mj_name2id(physics, mj.mjtObj.mjOBJ_JOINT, name) for name in model.joint_names]
        self._q = physics.jnt_qposadr[ids].copy()
        self._v = physics.jnt_dofadr[ids].copy()
        self._actuators = np.array([mj.mj_name2id(physics, mj.mjtObj.mjOBJ_ACTUATOR, n) for n in model.joint_names])
        self._base_q = base_q
        self._rotation = np.zeros(9)

    def write(self, data: Any, q: Vec, v: Vec) -> None:
        """Put q (nq,), v (nv,) into ``data``."""
        if self._nb:
            data.qpos[:3] = q[:3]
            data.qpos[3], data.qpos[4:7] = q[6], q[3:6]
            data.qvel[:3] = self._base_rotation(data) @ v[:3]
            data.qvel[3:6] = v[3:6]
        data.qpos[self._q] = q[self._base_q :]
        data.qvel[self._v] = v[self._nb :]

    def read(self, data: Any) -> tuple[Vec, Vec]:
        """q (nq,), v (nv,) of ``data``, in new arrays."""
        q, v = np.empty(self._nq), np.empty(self._nv)
        if self._nb:
            q[:3] = data.qpos[:3]
            q[3:6], q[6] = data.qpos[4:7], data.qpos[3]
            q[3:7] /= np.linalg.norm(q[3:7])
            v[:3] = self._base_rotation(data).T @ data.qvel[:3]
            v[3:6] = data.qvel[3:6]
        q[self._base_q :] = data.qpos[self._q]
        v[self._nb :] = data.qvel[self._v]
        return q, v

    def write_torques(self, data: Any, tau: Vec) -> None:
        """Command (nj,) to the actuators: torques, which they clip to their limits, or what drives make them of."""
        data.ctrl[self._actuators] = tau

    def read_torques(self, data: Any) -> Vec:
        """Torques (nj,) that the actuators gave last."""
        torques: Vec = data.qfrc_actuator[self._v].copy()
        return torques

    def velocity_index(self, joint: int) -> int:
        """Where the velocity of a joint of the model stands in ``data.qvel``."""
        return int(self._v[joint])

    def velocity_map(self, data: Any) -> Mat:
        """X (nv, nv): q̇_mj = X v."""
        X = np.zeros((self._nv, self._nv))
        X[self._v, np.arange(self._nb, self._nv)] = 1.0
        if self._nb:
            X[:3, :3] = self._base_rotation(data)
            X[3:6, 3:6] = np.eye(3)
        return X

    def velocity_drift(self, data: Any, v: Vec) -> Vec:
        """Ẋ v (nv,): q̈_mj = X a + Ẋ v."""
        drift = np.zeros(self._nv)
        if self._nb:
            drift[:3] = self._base_rotation(data) @ np.cross(v[3:6], v[:3])
        return drift

    def _base_rotation(self, data: Any) -> Mat:
        self._mj.mju_quat2Mat(self._rotation, data.qpos[3:7])
        return self._rotation.reshape(3, 3)
