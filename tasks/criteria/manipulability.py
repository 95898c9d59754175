"""Manipulability: how far a frame is from a singular posture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel, RobotState
from wbc.types import Mat, Vec

from .criterion import Criterion

ROWS = ("x", "y", "z", "rx", "ry", "rz")


@final
class Manipulability(Criterion):
    """H = √det(J Jᵀ) = σ_1 … σ_m, the product of the singular values of the rows ``rows`` of a frame's Jacobian.

    J (m, nj) holds the columns of the joints; rows "x", "y", "z" are linear, "rx", "ry", "rz" angular, world axes.
    With J = U Σ Vᵀ and G = Σ_k (Π_{l≠k} σ_l) u_k v_kᵀ (m, nj), ∂H/∂q_j = Σ G ∘ ∂J/∂q_j. The derivatives of the
    columns (a_i linear, w_i angular) are exact: for j before i in the chain ∂a_i/∂q_j = w_j × a_i,
    ∂w_i/∂q_j = w_j × w_i; for j behind i ∂a_i/∂q_j = w_i × a_j, ∂w_i/∂q_j = 0. Where J loses one rank, H has a kink
    and the gradient is that of one side; it leads away from the singularity.
    Source: Yoshikawa, Int. J. Robotics Research 1985.

    Raises:
        InvalidInput: a row that does not exist or comes twice; when a stack is compiled, more rows than joints.
        UnknownFrame: when a stack is compiled.

    Example:
        >>> import wbc
        >>> from wbc.tasks import Manipulability
        >>> robot, dexterity = wbc.load("arm"), Manipulability("tool")
        >>> dexterity.prepare(robot)
        >>> dexterity.value(robot.state()) > 0.0, dexterity.gradient(robot.state()).shape
        (True, (7,))
    """

    def __init__(self, frame: str, *, rows: Sequence[str] = ("x", "y", "z")) -> None:
        rows = checks.names("Manipulability.rows", rows, ROWS)
        self.frame, self.rows = frame, rows
        self.name = f"manipulability of {frame}"
        linear = sum(len(row) == 1 for row in rows)
        self.units = " ".join(f"{unit}^{k}" for unit, k in (("m", linear), ("rad", len(rows) - linear)) if k)
        self._index = [ROWS.index(row) for row in rows]

    def prepare(self, model: RobotModel) -> None:
        model.check_frame(self.frame)
        if len(self.rows) > model.nj:
            raise InvalidInput(f"Manipulability.rows are {len(self.rows)}, the joints of {model.name} {model.nj}")

    def value(self, state: RobotState) -> float:
        return float(np.prod(np.linalg.svd(self._jacobian(state)[self._index], compute_uv=False)))

    def gradient(self, state: RobotState) -> Vec:
        J = self._jacobian(state)
        left, sizes, right = np.linalg.svd(J[self._index], full_matrices=False)
        others = np.array([np.prod(np.delete(sizes, k)) for k in range(len(sizes))])
        G = np.zeros_like(J)
        G[self._index] = (left * others) @ right
        return change_along_joints(J, G)

    def _jacobian(self, state: RobotState) -> Mat:
        return state.frame(self.frame).jacobian()[:, state.model.nb :]


def change_along_joints(J: Mat, G: Mat) -> Vec:
    """Σ G ∘ ∂J/∂q_j of each joint j (nj,). Joints of a chain are counted from its base; others have zero columns."""
    a, w, Ga, Gw = J[:3], J[3:], G[:3], G[3:]
    # From w_j × x · g = w_j · (x × g): sums over the joints i from j on, of what turns with joint j ...
    turned = cross(a, Ga) + cross(w, Gw)
    behind = np.cumsum(turned[:, ::-1], axis=1)[:, ::-1]
    # ... and from w_i × a_j · g_i = a_j · (g_i × w_i): over the joints i before j.
    moved = cross(Ga, w)
    before = np.cumsum(moved, axis=1) - moved
    change: Vec = (w * behind).sum(axis=0) + (a * before).sum(axis=0)
    return change


def cross(a: Mat, b: Mat) -> Mat:
    """a × b, column by column (3, n); numpy's own takes five times as long for a few columns."""
    product: Mat = a[_NEXT] * b[_LAST] - a[_LAST] * b[_NEXT]
    return product


_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])
