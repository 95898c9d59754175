"""Derivatives of inverse dynamics: how the torques of a motion change with the motion."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import pinocchio as pin

from wbc.models.model import RobotState
from wbc.types import Mat, Vec


def inverse_dynamics_derivatives(
    state: RobotState, a: Vec, wrenches: Iterable[tuple[str, Any]] = ()
) -> tuple[Mat, Mat, Mat]:
    """Derivatives (nv, nv) of τ = M a + h − Σ Jᵢᵀ wᵢ by the configuration, by v and by a (nv,), in a state.

    ``wrenches`` (frame, pinocchio.Force in world axes about the origin of the world) stay as they are in the axes of
    the joint that carries the frame.

    Source: Carpentier, Mansard: Analytical derivatives of rigid body dynamics algorithms, RSS 2018.

    Example:
        >>> import numpy as np, wbc
        >>> from wbc.models.derivatives import inverse_dynamics_derivatives
        >>> state = wbc.load("arm").state()
        >>> on_q, on_v, on_a = inverse_dynamics_derivatives(state, np.zeros(state.model.nv))
        >>> bool(np.abs(on_v).max() == 0.0), bool(np.array_equal(on_a, state.M))  # at rest
        (True, True)
    """
    model, outer = state.model.pinocchio, [pin.Force.Zero() for _ in range(state.model.pinocchio.njoints)]
    for frame, wrench in wrenches:
        state.frame(frame)  # from here on the joints are placed
        joint = model.frames[state.model.frames[frame]].parentJoint
        outer[joint] += state.data.oMi[joint].actInv(wrench)
    data = model.createData()  # what comes back are views of it
    found = pin.computeRNEADerivatives(model, data, state.q, state.v, a, pin.StdVec_Force(outer))
    return np.array(found[0]), np.array(found[1]), state.M
