"""Witness: judges a robot's motion frame by frame, by its joints, its contacts, and the forces that it needs.

    v_k = (q_{k+1} ⊖ q_{k−1}) / 2T      a_k = (q_{k+1} ⊖ q_k − q_k ⊖ q_{k−1}) / T²

A *jump* is one step of a joint that neither the step before nor the one after resembles. A foot *slips* that holds and
is off its place, the median of its places while it holds. Forces are looked for in frames without a fault of motion
(:mod:`wbc.motion.forces`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, final

import numpy as np

from wbc import checks
from wbc.models.pinocchio_ import PinocchioModel
from wbc.motion.body import spans
from wbc.motion.clip import Flags
from wbc.motion.forces import lacking
from wbc.motion.kinematics import lowest, placed, velocities
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
        """A verdict for each frame of configurations q (N, nq) at ``rate`` [1/s]; ``holds`` {part: (N,)}.

        Raises:
            InvalidInput: q or a part's flags of another size, or not finite; no flags for a contact.
        """
        q = checks.array("q", q, (None, self._robot.nq))
        holds = {part: checks.array(f"holds[{part}]", holds.get(part), (len(q),)) > 0.5 for part in self._contacts}
        found: list[list[Fault]] = [[] for _ in q]
        v, a, steps = velocities(self._robot, q, rate)
        self._joints(found, q, np.abs(steps[:, 6:]), rate)
        frames = {part: contact.frame for part, contact in self._contacts.items()}
        for part, (positions, rotations) in placed(self._robot, q, frames).items():
            _contact(found, frames[part], lowest(self._robot, frames[part], positions, rotations), holds[part])
        for k, faults in enumerate(found):
            self._state.update(0.0, q[k], v[k])
            for one, other, distance in self._apart.closest(self._state)[:1] if self._apart is not None else ():
                if distance < -_DEPTH:
                    faults.append(Fault("collision", f"{one} and {other}", -1e3 * distance))
            if not faults:
                held = [contact for part, contact in self._contacts.items() if holds[part][k]]
                faults += lacking(self._robot, self._state, a[k], held)[0]
            progress((k + 1) / len(found))
        return [Verdict(tuple(sorted(faults, key=lambda fault: KINDS.index(fault.kind)))) for faults in found]

    def _joints(self, found: list[list[Fault]], q: Mat, steps: Mat, rate: float) -> None:
        limits, names, joints = self._robot.limits, self._robot.joint_names, q[:, 7:]
        alone, first = _alone(steps), np.zeros((1, len(names)))
        fast = np.where(alone > _JUMP, 0.0, steps * rate - limits.v_max)
        _tell(found, "position", names, np.maximum(limits.q_min - joints, joints - limits.q_max), _POSITION)
        _tell(found, "jump", names, np.rad2deg(np.vstack([first, alone])), np.rad2deg(_JUMP))
        _tell(found, "speed", names, np.vstack([first, fast]), _SPEED)


def _tell(found: list[list[Fault]], kind: str, parts: Sequence[str], amounts: Mat, most: float) -> None:
    """Amounts (N, parts) of a fault beyond what is none yet."""
    for k, j in np.argwhere(amounts > most):
        found[k].append(Fault(kind, parts[j], float(amounts[k, j])))


def _contact(found: list[list[Fault]], frame: str, points: Vec, held: Flags) -> None:
    """Depth always; slip and height while the contact holds."""
    low, high, middle = points[:, :, 2].min(axis=1), points[:, :, 2].max(axis=1), points.mean(axis=1)[:, :2]
    off = np.zeros(len(points))
    for start, stop in spans(held):
        off[start:stop] = np.linalg.norm(middle[start:stop] - np.median(middle[start:stop], axis=0), axis=1)
    of_kind = {"penetration": (-low, _DEPTH), "slip": (off, _SLIP), "gap": (np.where(held, high, 0.0), _GAP)}
    for kind, (amounts, most) in of_kind.items():
        _tell(found, kind, [frame], 1e3 * amounts[:, None], 1e3 * most)


def _alone(size: Mat) -> Mat:
    """Steps (N, nj) beyond those around them, where they resemble none of them but one that leads back; else 0."""
    around = np.pad(size, ((2, 2), (0, 0)), mode="edge")
    near = np.sort([around[1:-3], around[3:-1]], axis=0)
    far = np.maximum(around[:-4], around[4:])
    once = near[1] < _ALONE * size
    back = (near[0] < _ALONE * size) & (far < _ALONE * size)
    return np.where(once | back, size - near[0], 0.0)
