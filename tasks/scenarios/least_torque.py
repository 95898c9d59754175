"""What statics asks of one joint: whether a robot could stand as it does without that joint's motor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import block_diag

import wbc
from wbc.models.model import RobotModel
from wbc.stack.contact import Contact
from wbc.types import Vec

from .judge import TOLERANCE

#: Weight of the forces' norm against the joint's torque [m²]: so small that it costs no more than 1e-4 N m, and no
#: smaller, for a problem with larger and smaller numbers in it is answered wrongly.
LEAST = 1e-8


def least_torque(robot: RobotModel, contacts: Sequence[Contact], q: Vec, joint: str) -> float:
    """The smallest torque [N m, N] that ``joint`` must give for the robot to stand still at q (nq,), by a QP.

    Over all contact forces f within their cones and torques τ of the other joints within their limits with
    g = Sᵀ τ + Jᵀ f. Zero: the others can do without it; NaN: the robot cannot stand still here at all.
    """
    state = robot.state()
    state.update(0.0, q, np.zeros(robot.nv))
    J = np.vstack([contact.rows(state).J for contact in contacts])
    K = block_diag(*(contact.cone() for contact in contacts))
    nb, i = robot.nb, robot.joint(joint)
    torque_rows, g = -J.T[nb:], state.g[nb:]  # τ = g − Jᵀ f
    most = np.where(np.arange(robot.nj) == i, np.inf, robot.limits.tau_max)
    own = torque_rows[i]
    qp = wbc.QP(
        2.0 * (np.outer(own, own) + LEAST * np.eye(len(J))), 2.0 * g[i] * own,
        A=J.T[:nb], b=state.g[:nb], C=np.vstack([K, torque_rows]),
        cl=np.concatenate([np.full(len(K), -np.inf), -most - g]), cu=np.concatenate([np.zeros(len(K)), most - g]),
    )  # fmt: skip
    found = wbc.solve(qp, "daqp")
    if not found.status.ok:
        return float("nan")
    torque = abs(float(g[i] + own @ found.x))
    return 0.0 if torque < 1e3 * TOLERANCE else torque
