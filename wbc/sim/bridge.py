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

    ``physics`` may hold more than the robot, such as things that lie about; :meth:`write` leaves their state as it is.

    Raises:
        SimulationError: joints of the model that ``physics`` does not have; a base that is free in one of them alone.

    Example:
        >>> import mujoco, wbc
        >>> from wbc.sim.bridge import Bridge
        >>> hinge = "<joint name='{}' axis='0 0 1'/><geom size='0.1'/>"
        >>> arms = "".join(f"<body name='{side}'>{hinge.format(side)}</body>" for side in ("right", "left"))
        >>> scene = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{arms}</worldbody></mujoco>")
        >>> data, robot = mujoco.MjData(scene), wbc.load(scene)
        >>> data.qpos[:] = 0.1, 0.2
        >>> robot.joint_names, Bridge(robot, scene).read(data)[0]
        (('left', 'right'), array([0.2, 0.1]))
    """

    def __init__(self, model: RobotModel, physics: Any) -> None:
        mj = mujoco()
        self._mj = mj
        self._nb, self._physics_nv = model.nb, physics.nv
        ids = [mj.mj_name2id(physics, mj.mjtObj.mjOBJ_JOINT, name) for name in model.joint_names]
        if missing := [repr(name) for name, joint in zip(model.joint_names, ids, strict=True) if joint < 0]:
            raise SimulationError(
                f"physics has no joint {', '.join(missing)} of {model.name}: they are not the same robot, or its MJCF "
                "does not name its joints"
            )
        free = np.flatnonzero(physics.jnt_type == mj.mjtJoint.mjJNT_FREE)
        roots = physics.body_rootid[physics.jnt_bodyid]
        free = free[np.isin(roots[free], roots[ids])]
        if len(free) != bool(model.nb):
            raise SimulationError(
                f"the base of {model.name} is {'free' if model.nb else 'not free'}, and in physics it is "
                f"{'free' if len(free) else 'not'}; load the robot with another base"
            )
        base_q, base_v = physics.jnt_qposadr[free], physics.jnt_dofadr[free]
        #: Where the entries of q and v stand in ``qpos`` and ``qvel``.
        self._q = np.concatenate([*(base_q + i for i in (0, 1, 2, 4, 5, 6, 3)), physics.jnt_qposadr[ids]])
        self._v = np.concatenate([*(base_v + i for i in range(6)), physics.jnt_dofadr[ids]])
        self._actuators = np.array([mj.mj_name2id(physics, mj.mjtObj.mjOBJ_ACTUATOR, n) for n in model.joint_names])
        self._rotation = np.zeros(9)

    def write(self, data: Any, q: Vec, v: Vec) -> None:
        """Put q (nq,), v (nv,) into ``data``."""
        data.qpos[self._q] = q
        data.qvel[self._v] = v
        if self._nb:
            data.qvel[self._v[:3]] = self._base_rotation(data) @ v[:3]

    def read(self, data: Any) -> tuple[Vec, Vec]:
        """q (nq,), v (nv,) of ``data``, in new arrays."""
        q, v = data.qpos[self._q], data.qvel[self._v]
        if self._nb:
            q[3:7] /= np.linalg.norm(q[3:7])
            v[:3] = self._base_rotation(data).T @ v[:3]
        return q, v

    def write_torques(self, data: Any, tau: Vec) -> None:
        """Command (nj,) to the actuators, called as their joints: torques, which they clip to their limits, or what
        drives make of them.

        Raises:
            SimulationError: a joint without an actuator of its name.
        """
        if (self._actuators < 0).any():
            raise SimulationError(
                "not every joint has an actuator of its name; write torques to qfrc_applied[velocity_index(joint)], or "
                "to ctrl as these actuators take them"
            )
        data.ctrl[self._actuators] = tau

    def read_torques(self, data: Any) -> Vec:
        """Torques (nj,) that the actuators gave last."""
        torques: Vec = data.qfrc_actuator[self._v[self._nb :]]
        return torques

    def velocity_index(self, joint: int) -> int:
        """Where the velocity of a joint of the model stands in ``data.qvel``."""
        return int(self._v[self._nb + joint])

    def velocity_map(self, data: Any) -> Mat:
        """X (physics.nv, nv): q̇_mj = X v."""
        X = np.zeros((self._physics_nv, len(self._v)))
        X[self._v, np.arange(len(self._v))] = 1.0
        if self._nb:
            X[self._v[:3], :3] = self._base_rotation(data)
        return X

    def velocity_drift(self, data: Any, v: Vec) -> Vec:
        """Ẋ v (physics.nv,): q̈_mj = X a + Ẋ v."""
        drift = np.zeros(self._physics_nv)
        if self._nb:
            drift[self._v[:3]] = self._base_rotation(data) @ np.cross(v[3:6], v[:3])
        return drift

    def _base_rotation(self, data: Any) -> Mat:
        self._mj.mju_quat2Mat(self._rotation, data.qpos[self._q[[6, 3, 4, 5]]])
        return self._rotation.reshape(3, 3)
