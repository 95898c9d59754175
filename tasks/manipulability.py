"""ManipulabilityTask: keeps the manipulability (Yoshikawa) of a frame from falling to zero (a singular posture)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Self, final

import numpy as np

from wbc import checks
from wbc.models.model import RobotModel, RobotState
from wbc.stack.target import vector_target
from wbc.stack.task import Task, TaskRows
from wbc.stack.tracking import Tracking
from wbc.types import Mat, Vec

from .criteria.manipulability import ROWS, Manipulability, change_along_joints, cross
from .trajectories import Sinusoid


@final
class ManipulabilityTask(Tracking, Task):
    """e = H_target − H: one row. H = √det(J Jᵀ + δ² I) of the rows ``rows`` of the frame's Jacobian over the joints.

    dH = Σ G ∘ dJ with G = H (J Jᵀ + δ² I)⁻¹ J, and J̇, J̈ by recursion along the chain. ``smoothing`` δ (default 1e-3)
    rounds off the kink that the product of singular values has where one of them is zero, so that J and drift exist
    everywhere; H is then at most δ off for each value. To climb H rather than hold it, see
    :class:`~tasks.projected_gradient.ProjectedGradient` with the criterion :class:`~tasks.Manipulability`.
    Source: Yoshikawa, Int. J. Robotics Research 1985.

    ``rows``: some of "x", "y", "z", "rx", "ry", "rz", world axes. ``target`` >= 0, or a function of time giving it or
    (value, rate, acceleration), (1,) each.

    Raises:
        InvalidInput: a row that does not exist, a target that is no number >= 0, more rows than joints.
        UnknownFrame: when a stack is compiled.

    Example:
        >>> from wbc.tasks import ManipulabilityTask
        >>> ManipulabilityTask("tool", target=0.08, kp=10, weight=0.1)
        ManipulabilityTask[tool](weight=0.1)
    """

    dim = 1
    read_once = frozenset({"smoothing"})

    def __init__(
        self, frame: str, *, target: Any, rows: Sequence[str] = ("x", "y", "z"), smoothing: float = 1e-3,
        kp: Any = 100.0, kd: Any = None, rate: Any = None, weight: Any = 1.0, name: str | None = None,
    ) -> None:  # fmt: skip
        self.frame = self.subject = frame
        self._criterion = Manipulability(frame, rows=rows)
        self.units = self._criterion.units
        self._index = [ROWS.index(row) for row in rows]
        super().__init__(kp=kp, kd=kd, rate=rate, weight=weight, name=name)
        self.smoothing = checks.number(f"{self.name}.smoothing", smoothing, low=0.0, strict=True)
        self.target = target

    @staticmethod
    def convert(name: str, value: Any, strict: bool) -> Vec:
        """A number or (1,), not negative."""
        target = _number(name, [value] if checks.ndim(value) == 0 else value, strict)
        if strict:
            checks.number(name, target[0], low=0.0)
        return target

    def prepare(self, model: RobotModel) -> None:
        self._criterion.prepare(model)
        self._damping = self.smoothing**2 * np.eye(len(self._index))

    def fill(self, state: RobotState, out: TaskRows) -> None:
        target, nb = self.reference(state.t), state.model.nb
        J = state.frame(self.frame).jacobian()
        chain, rows = J[:, nb:], self._index
        reduced = chain[rows]
        inverse = np.linalg.inv(reduced @ reduced.T + self._damping)
        H = float(np.linalg.det(inverse)) ** -0.5
        G = np.zeros_like(chain)
        G[rows] = H * inverse @ reduced
        out.e[:] = target.value - H
        out.J[0, nb:] = change_along_joints(chain, G)
        if nb:  # a base that turns takes every column with it
            turned = cross(chain[:3], G[:3]) + cross(chain[3:], G[3:])
            out.J[0, :nb] = turned.sum(axis=1) @ J[3:, :nb]
        out.rate_ref[:], out.acc_ref[:] = target.rate, target.second
        if state.drifts:
            first, second = _rates(chain, J[3:, :nb] @ state.v[:nb], state.v_joints)
            first_reduced = first[rows]
            rate = float((G * first).sum())
            mixed = first_reduced @ reduced.T
            G_rate = (rate / H) * G[rows] + H * inverse @ (first_reduced - (mixed + mixed.T) @ inverse @ reduced)
            out.drift[:] = (G_rate * first_reduced).sum() + (G * second).sum()

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        frame, moving = model.frame_names[-1], Sinusoid([0.1], amplitude=0.05, frequency=0.7)
        return [cls(frame, target=0.1), cls(frame, target=moving, rows=["x", "rz"], smoothing=0.1)]


def _rates(J: Mat, base_spin: Vec, v: Vec) -> tuple[Mat, Mat]:
    """J̇ and J̈ (6, nj) when the joints move at the constant rates v (nj,) and the base turns with ``base_spin`` (3,).

    A column (a, w) turns with what stands before it in the chain, Ω, and its joint w moves what stands behind, u:
    ȧ = Ω × a + w × u, ẇ = Ω × w; once more for the second derivatives.
    """
    a, w = J[:3], J[3:]

    def before(x: Mat) -> Mat:
        moved = v * x
        return np.cumsum(moved, axis=1) - moved

    def behind(x: Mat) -> Mat:
        return np.cumsum((v * x)[:, ::-1], axis=1)[:, ::-1]

    spin, u = base_spin[:, None] + before(w), behind(a)
    w_rate = cross(spin, w)
    a_rate = cross(spin, a) + cross(w, u)
    spin_rate, u_rate = before(w_rate), behind(a_rate)
    w_second = cross(spin_rate, w) + cross(spin, w_rate)
    a_second = cross(spin_rate, a) + cross(spin, a_rate) + cross(w_rate, u) + cross(w, u_rate)
    return np.concatenate([a_rate, w_rate]), np.concatenate([a_second, w_second])


_number = vector_target(1)
