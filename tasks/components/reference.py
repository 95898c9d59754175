"""References of adaptive control: which velocity and acceleration of the joints lead back to a motion."""

from __future__ import annotations

from typing import Any, final

import numpy as np

from wbc.models.model import RobotModel, RobotState
from wbc.stack.target import Target
from wbc.stack.tracking import joints_target, pose_target, rotation_error
from wbc.types import Vec

#: Singular values of a Jacobian are damped below this.
DAMPING = 1e-3
#: How fast spare joints go back to their reference [1/s].
SPARE_RATE = 1.0


@final
class JointReference:
    """v_r = v_d + Λ e, a_r = a_d + Λ ė for a motion of the joints."""

    def __init__(self, name: str, target: Any, model: RobotModel, ratio: Vec) -> None:
        self._target = Target(name, target, model.nj, joints_target(model, model.nj))
        self._ratio = ratio

    def at(self, state: RobotState) -> tuple[Vec | None, Vec, Vec, Vec]:
        """e, ė, v_r, a_r, (nj,) each."""
        wanted = self._target.at(state.t)
        e, e_rate = wanted.value - state.q, wanted.rate - state.v
        return e, e_rate, wanted.rate + self._ratio * e, wanted.second + self._ratio * e_rate


@final
class TaskReference:
    """v_r = J⁺ (ẋ_d + Λ e) + N k (q₀ − q), a_r its derivative, for a motion of a frame (six rows, world axes).

    J⁺ is damped, and its derivative is left out of a_r but for −J⁺ J̇ v_r: where spare joints move slowly that is all of
    it that counts.
    """

    def __init__(self, name: str, target: Any, model: RobotModel, frame: str, rate: float) -> None:
        model.check_frame(frame)
        self._target = Target(name, target, 6, pose_target)
        self._frame, self._rate, self._rest = frame, rate, model.q0
        self._J_before: Vec | None = None
        self._t = 0.0

    def at(self, state: RobotState) -> tuple[Vec | None, Vec, Vec, Vec]:
        """None: there is no e of the joints; then ṡ's part that needs none, v_r, a_r."""
        wanted, frame = self._target.at(state.t), state.frame(self._frame)
        rotation, position = wanted.value
        e = np.concatenate([position - frame.position, rotation_error(rotation, frame.rotation)])
        J, drift, v = frame.jacobian(), frame.drift(), state.v
        e_rate = wanted.rate - J @ v
        inverse = J.T @ np.linalg.inv(J @ J.T + DAMPING**2 * np.eye(6))
        back = SPARE_RATE * (self._rest - state.q)
        v_r = inverse @ (wanted.rate + self._rate * e - J @ back) + back
        a_back = -SPARE_RATE * v
        a_r = inverse @ (wanted.second + self._rate * e_rate - drift - J @ a_back) + a_back
        return None, e_rate[:0], v_r, a_r
