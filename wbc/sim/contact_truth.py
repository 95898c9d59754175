"""What only physics knows of the contacts: net wrench, true slip, penetration."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, final

import numpy as np

from wbc.sim.engine import mujoco
from wbc.sim.footprint import Footprint
from wbc.types import Mat, Vec

#: A foot slips only while it carries more than this share of the robot's weight.
LOADED = 0.01

_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])


@final
class ContactTruth:
    """Sums up the contact forces of each foot over the substeps of one step.

    wrench       (6,) mean over the step on the robot, force [N] before moment [N m] about the contact point, in the
                 axes of the surface: z the floor's normal, which friction is about, however the foot leans; x as the
                 sole's. A ball's are fixed in the world, and its point is the lowest
    measured     (6,) the same wrench as a sensor in the link would have it: about the link's origin, world axes, as
                 they were at the step's start
    slip         (2,) [m] world x and y, accumulated: the tangential velocity of the robot's material at each contact
                 point, weighted by the normal forces there, integrated while the foot is loaded. A ball that rolls
                 does not slip
    penetration  [m] deepest over the step

    The net wrench is what a friction cone is about: the corners of one sole share it in a way that statics leaves
    open.
    """

    def __init__(self, physics: Any, feet: Sequence[Footprint], weight: float) -> None:
        mj = mujoco()
        self._feet = feet
        self._bodies = np.array([mj.mj_name2id(physics, mj.mjtObj.mjOBJ_BODY, foot.link) for foot in feet], dtype=int)
        self._roots = physics.body_rootid[self._bodies]
        self._owner = np.full(physics.ngeom, -1)
        for i, foot in enumerate(feet):
            for k in range(max(len(foot.balls), 1)):
                self._owner[mj.mj_name2id(physics, mj.mjtObj.mjOBJ_GEOM, f"{foot.name}/{k}")] = i
        self._threshold = LOADED * weight
        self.wrench = np.zeros((len(feet), 6))
        self.measured = np.zeros((len(feet), 6))
        self.slip = np.zeros((len(feet), 2))
        self.penetration = np.zeros(len(feet))

    def restart(self) -> None:
        """Forget the past: nothing has slipped yet."""
        for values in (self.wrench, self.measured, self.slip, self.penetration):
            values[:] = 0.0

    def begin_step(self) -> None:
        """A new step: means and maxima start again, slip goes on."""
        self.wrench[:] = 0.0
        self.measured[:] = 0.0
        self.penetration[:] = 0.0

    def add(self, data: Any, duration: float, share: float) -> None:
        """One substep of ``duration`` [s], ``share`` of the step; ``data`` holds its forces and where they acted."""
        contacts = data.contact
        touching = contacts.efc_address >= 0
        if not touching.any():
            return
        geometries = contacts.geom[touching]
        first, second = self._owner[geometries[:, 0]], self._owner[geometries[:, 1]]
        owner, sign = np.maximum(first, second), np.where(second >= 0, 1.0, -1.0)
        # Rows of a contact's frame: normal from the first to the second geometry, two tangents. With an elliptic
        # cone the constraint forces are the components along them.
        frames = contacts.frame[touching].reshape(-1, 3, 3)
        components = data.efc_force[contacts.efc_address[touching][:, None] + np.arange(3)]
        forces = sign[:, None] * np.einsum("kij,ki->kj", frames, components)
        points, normal_forces = contacts.pos[touching], components[:, 0]
        velocities = self._material_velocities(data, owner, points)
        for i in np.unique(owner):
            mine = owner == i
            self.wrench[i] += share * self._net_wrench(data, i, forces[mine], points[mine])
            arms = points[mine] - data.xpos[self._bodies[i]]
            self.measured[i, :3] += share * forces[mine].sum(axis=0)
            self.measured[i, 3:] += share * _cross(arms, forces[mine]).sum(axis=0)
            self.penetration[i] = max(self.penetration[i], -float(contacts.dist[touching][mine].min()))
            load = float(normal_forces[mine].sum())
            if load > self._threshold:
                self.slip[i] += duration * (normal_forces[mine] @ velocities[mine, :2]) / load

    def _material_velocities(self, data: Any, owner: Any, points: Mat) -> Mat:
        """World velocities (k, 3) of the links' material at the contact points."""
        spatial = data.cvel[self._bodies[owner]]  # angular and linear, at the centre of mass of the whole robot
        arms = points - data.subtree_com[self._roots[owner]]
        velocities: Mat = spatial[:, 3:] + _cross(spatial[:, :3], arms)
        return velocities

    def _net_wrench(self, data: Any, i: int, forces: Mat, points: Mat) -> Vec:
        foot, body = self._feet[i], self._bodies[i]
        rotation, position = data.xmat[body].reshape(3, 3), data.xpos[body]
        if foot.half_size is None:
            axes, (centre, radius) = foot.rotation, foot.balls[0]
            point = position + rotation @ centre - radius * axes[:, 2]
        else:
            axes = _on_floor((rotation @ foot.rotation)[:, 0])
            point = position + rotation @ foot.origin
        force, moment = forces.sum(axis=0), _cross(points - point, forces).sum(axis=0)
        return np.concatenate([axes.T @ force, axes.T @ moment])


def _cross(a: Mat, b: Mat) -> Mat:
    """a × b row by row; numpy.cross takes longer than a step of physics."""
    result: Mat = a[:, _NEXT] * b[:, _LAST] - a[:, _LAST] * b[:, _NEXT]
    return result


def _on_floor(along: Vec) -> Mat:
    """Axes (3, 3) with z up and x as ``along`` (3,), seen from above."""
    x, y = along[:2] / np.hypot(along[0], along[1])
    return np.array([[x, -y, 0.0], [y, x, 0.0], [0.0, 0.0, 1.0]])
