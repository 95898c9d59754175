"""Which shapes of a robot can never come near each other, proven by branch and bound over the joints between them."""

from __future__ import annotations

from typing import Any, final

import numpy as np
import pinocchio as pin

from wbc.types import Vec

#: Joints between two shapes up to which it is tried, and how many configurations of one pair are looked at.
_MOST_JOINTS, _MOST_CELLS = 2, 300


def always_apart(
    model: Any, geometry: Any, q_min: Vec, q_max: Vec, margin: float, *, moving: frozenset[int] = frozenset()
) -> list[Any]:
    """Collision pairs that keep more than ``margin`` [m] wherever the joints between them are within [q_min, q_max].

    A distance changes by no more than each joint's lever times its angle. What holds in the middle of a cell of joint
    positions, less the cell's half widths times the levers, so holds in all of it; cells that say nothing are halved.
    A pair that is not settled soon, that more than two joints move or one that slides without end, or with a shape that
    is ``moving`` by itself is not in the list.
    """
    memory = model.createData(), geometry.createData()
    first_joint = model.nv - len(q_min)
    found = []
    for index, pair in enumerate(geometry.collisionPairs):
        if pair.first in moving or pair.second in moving:
            continue
        between = _Between(model, geometry, index, memory)
        joints = between.joints
        if not joints or len(joints) > _MOST_JOINTS or any(model.nvs[joint] != 1 for joint in joints):
            continue
        at = [model.idx_vs[joint] - first_joint for joint in joints]
        turn = np.where([_slides(model, joint) for joint in joints], np.inf, np.pi)
        endless = ~np.isfinite(q_min[at]) | ~np.isfinite(q_max[at])
        low, high = np.where(endless, -turn, q_min[at]), np.where(endless, turn, q_max[at])
        if np.isfinite(high).all() and (low <= high).all() and between.stays_apart(low, high, margin):
            found.append(pin.CollisionPair(pair.first, pair.second))
    return found


def _slides(model: Any, joint: int) -> bool:
    return bool(model.joints[joint].shortname().startswith("JointModelP"))


@final
class _Between:
    """Two shapes and the joints that move them against each other, the outermost last."""

    def __init__(self, model: Any, geometry: Any, index: int, memory: tuple[Any, Any]) -> None:
        self._model, self._geometry, self._index = model, geometry, index
        self._kinematics, self._data = memory
        pair = geometry.collisionPairs[index]
        self._shapes = pair.first, pair.second
        carriers = [geometry.geometryObjects[shape].parentJoint for shape in self._shapes]
        self._moved_by = [set(model.supports[joint]) - {0} for joint in carriers]
        self.joints = sorted(self._moved_by[0] ^ self._moved_by[1])
        self._q = pin.neutral(model)

    def stays_apart(self, low: Vec, high: Vec, margin: float) -> bool:
        """Whether the distance is proven to be above ``margin`` for all joint positions within [low, high]."""
        cells = [(low, high)]
        for _ in range(_MOST_CELLS):
            if not cells:
                return True
            low, high = cells.pop()
            half = 0.5 * (high - low)
            room = self._distance(low + half) - margin
            if room <= 0.0:
                return False
            moves = half * self._levers(half)
            if room <= moves.sum():
                widest = int(np.argmax(moves))
                left, right = high.copy(), low.copy()
                left[widest] = right[widest] = low[widest] + half[widest]
                cells += [(low, left), (right, high)]
        return False

    def _distance(self, positions: Vec) -> float:
        for joint, position in zip(self.joints, positions, strict=True):
            self._q[self._model.idx_qs[joint]] = position
        pin.updateGeometryPlacements(self._model, self._kinematics, self._geometry, self._data, self._q)
        pin.computeDistance(self._geometry, self._data, self._index)
        return float(self._data.distanceResults[self._index].min_distance)

    def _levers(self, half: Vec) -> Vec:
        """How far a shape can move for each unit of each joint, anywhere in a cell of these half widths."""
        levers = np.ones(len(self.joints))
        for k in reversed(range(len(levers))):
            joint = self.joints[k]
            if _slides(self._model, joint):
                continue
            reach = 0.0
            for shape, moved_by in zip(self._shapes, self._moved_by, strict=True):
                if joint in moved_by:
                    away = self._data.oMg[shape].translation - self._kinematics.oMi[joint].translation
                    radius = self._geometry.geometryObjects[shape].geometry.aabb_radius
                    reach = max(reach, float(np.linalg.norm(away)) + radius)
            levers[k] = reach + half[k + 1 :] @ levers[k + 1 :]
        return levers
