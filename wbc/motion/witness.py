"""Witness: judges a robot's motion frame by frame, by its joints, its contacts, and the forces that it needs.

    v_k = (q_{k+1} ⊖ q_{k−1}) / 2T      a_k = (q_{k+1} ⊖ q_k − q_k ⊖ q_{k−1}) / T²

A *jump* is one step of a joint that neither the step before nor the one after resembles. A foot *slips* that holds and
is off its place, the median of its places while it holds. Forces are looked for in frames without a fault of motion
(:mod:`wbc.motion.forces`).
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any, final

import numpy as np
import pinocchio

from wbc import checks
from wbc.models.pinocchio_ import PinocchioModel
from wbc.motion.body import Flags, spans
from wbc.motion.forces import lacking, without_contact
from wbc.motion.verdict import KINDS, Fault, Verdict
from wbc.stack.contact import Contact
from wbc.tasks import CollisionAvoidance
from wbc.types import Mat, Vec

#: What is no fault yet: a step of one frame beyond its neighbours [rad], slip, depth, and height of what holds [m],
#: speed [rad/s] and position [rad] beyond a limit.
_JUMP, _SLIP, _DEPTH, _GAP, _SPEED, _POSITION = np.deg2rad(4.0), 5e-3, 3e-3, 10e-3, 1e-3, 1e-3
#: Steps around a jump are smaller than this share of it.
_ALONE = 0.4


@final
class Witness:
    """Judges motions of a robot with the ``contacts`` {part: contact} that may hold, and the friction they have.

    ``collisions``: whether shapes of the robot inside one another are looked for.
    """

    def __init__(self, robot: PinocchioModel, contacts: Mapping[str, Contact], *, collisions: bool = True) -> None:
        self._robot, self._contacts, self._state = robot, dict(contacts), robot.state()
        self._apart = CollisionAvoidance(margin=0.0, reach=0.02) if collisions and robot.collisions else None

    def judge(
        self, q: Mat, rate: float, holds: Mapping[str, Flags], progress: Any = lambda done: None
    ) -> list[Verdict]:
        """A verdict for each frame of configurations q (N, nq) at ``rate`` [1/s], with what holds when.

        Raises:
            InvalidInput: q of another size, or not finite.
        """
        q = checks.array("q", q, (None, self._robot.nq))
        found: list[list[Fault]] = [[] for _ in q]
        v, a, steps = velocities(self._robot, q, rate)
        self._joints(found, q, steps[:, 6:], rate)
        for part, corners in self._places(q).items():
            _contact(found, self._contacts[part].frame, corners, holds[part])
        for k, faults in enumerate(found):
            self._state.update(0.0, q[k], v[k])
            faults += self._collision()
            if not faults:
                held = [contact for part, contact in self._contacts.items() if holds[part][k]]
                forces = lacking(self._robot, self._state, a[k], held)[0] if held else None
                faults += without_contact(self._robot, self._state, a[k]) if forces is None else forces
            progress((k + 1) / len(found))
        return [Verdict(tuple(sorted(faults, key=lambda fault: KINDS.index(fault.kind)))) for faults in found]

    def _joints(self, found: list[list[Fault]], q: Mat, steps: Mat, rate: float) -> None:
        limits, names, joints = self._robot.limits, self._robot.joint_names, q[:, 7:]
        beyond = np.maximum(limits.q_min - joints, joints - limits.q_max)
        for k, j in np.argwhere(beyond > _POSITION):
            found[k].append(Fault("position", names[j], float(beyond[k, j])))
        alone = _alone(np.abs(steps))
        for k, j in np.argwhere(alone > _JUMP):
            found[k + 1].append(Fault("jump", names[j], float(np.rad2deg(alone[k, j]))))
        fast = np.where(alone > _JUMP, 0.0, np.abs(steps) * rate - limits.v_max)
        for k, j in np.argwhere(fast > _SPEED):
            found[k + 1].append(Fault("speed", names[j], float(fast[k, j])))

    def _places(self, q: Mat) -> dict[str, Vec]:
        """Corners (N, k, 3) of every contact."""
        poses = placed(self._robot, q, {part: contact.frame for part, contact in self._contacts.items()})
        corners = {part: _corners(contact) for part, contact in self._contacts.items()}
        return {part: at[:, None] + corners[part] @ R.transpose(0, 2, 1) for part, (at, R) in poses.items()}

    def _collision(self) -> list[Fault]:
        nearest = self._apart.closest(self._state)[:1] if self._apart is not None else []
        return [
            Fault("collision", f"{one} and {other}", -1e3 * distance)
            for one, other, distance in nearest
            if distance < -_DEPTH
        ]


def placed(robot: PinocchioModel, q: Mat, frames: Mapping[str, str]) -> dict[str, tuple[Mat, Vec]]:
    """Positions (N, 3) [m] and rotations (N, 3, 3) of ``frames`` {name: frame} in configurations (N, nq), by name."""
    state, rest = robot.state(), np.zeros(robot.nv)
    found = {name: (np.empty((len(q), 3)), np.empty((len(q), 3, 3))) for name in frames}
    for k, row in enumerate(q):
        state.update(0.0, row, rest)
        for name, (positions, rotations) in found.items():
            frame = state.frame(frames[name])
            positions[k], rotations[k] = frame.position, frame.rotation
    return found


def velocities(robot: PinocchioModel, q: Mat, rate: float) -> tuple[Mat, Mat, Mat]:
    """Velocities and accelerations (N, nv) of configurations (N, nq), and the steps q_{k+1} ⊖ q_k (N − 1, nv)."""
    steps = np.array([pinocchio.difference(robot.pinocchio, one, other) for one, other in pairwise(q)])
    v = np.vstack([steps[:1], 0.5 * (steps[1:] + steps[:-1]), steps[-1:]]) * rate
    a = np.diff(steps, axis=0) * rate**2
    return v, np.vstack([a[:1], a, a[-1:]]), steps


def _contact(found: list[list[Fault]], frame: str, corners: Vec, held: Flags) -> None:
    """Depth always; slip and height while the contact holds."""
    low, high, middle = corners[:, :, 2].min(axis=1), corners[:, :, 2].max(axis=1), corners.mean(axis=1)[:, :2]
    for k in np.flatnonzero(-low > _DEPTH):
        found[k].append(Fault("penetration", frame, -1e3 * float(low[k])))
    for start, stop in spans(held):
        off = np.linalg.norm(middle[start:stop] - np.median(middle[start:stop], axis=0), axis=1)
        for k in np.flatnonzero(off > _SLIP):
            found[start + k].append(Fault("slip", frame, 1e3 * float(off[k])))
        for k in start + np.flatnonzero(high[start:stop] > _GAP):
            found[k].append(Fault("gap", frame, 1e3 * float(high[k])))


def _alone(size: Mat) -> Mat:
    """Steps (N, nj) beyond those around them, where they resemble none of them but one that leads back; else 0."""
    around = np.pad(size, ((2, 2), (0, 0)), mode="edge")
    near = np.sort([around[1:-3], around[3:-1]], axis=0)
    far = np.maximum(around[:-4], around[4:])
    once = near[1] < _ALONE * size
    back = (near[0] < _ALONE * size) & (far < _ALONE * size)
    return np.where(once | back, size - near[0], 0.0)


def _corners(contact: Contact) -> Mat:
    """Corners (k, 3) of a contact in its frame."""
    half = getattr(contact, "half_size", None)
    if half is None:
        return np.zeros((1, 3))
    signs = np.array([(1, 1, 0), (1, -1, 0), (-1, -1, 0), (-1, 1, 0)], dtype=np.float64)
    return np.asarray(getattr(contact, "origin", np.zeros(3)) + signs * np.append(half, 0.0))
