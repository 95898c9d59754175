"""Whether the physics and the model are the same robot, asked before anything moves.

Importers of robot descriptions lose masses without a word (a root link fused into the world, an inertia balanced).
So at random states: total mass, M(q), bias h(q, v) and the acceleration M⁻¹(Sᵀ tau − h) of free motion.
"""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from wbc.errors import SimulationError
from wbc.models.pinocchio_ import PinocchioModel
from wbc.sim.bridge import Bridge
from wbc.sim.engine import mujoco
from wbc.types import Mat, Vec

TOLERANCE = 1e-8
"""Relative, largest entry against largest entry. Honest pairs agree to 1e-12."""

_STATES = 3


def check_agreement(model: PinocchioModel, physics: Any, bridge: Bridge) -> dict[str, float]:
    """The largest relative difference of each quantity, over a few random states.

    On a fixed base the links bolted to the world are left out of the mass: they never move, and models do not count
    them. Contacts, stops, drives, limits of actuators, friction and the armature of settings are off: they are the
    plant's own.

    Raises:
        SimulationError: one of them is larger than 1e-8.
    """
    mj = mujoco()
    bare = _without_extras(mj, physics)
    for i, armature in enumerate(model.armature):
        bare.dof_armature[bridge.velocity_index(i)] = armature
    data = mj.MjData(bare)
    moving = bare.body_weldid != 0
    worst = {"total mass": _difference(bare.body_mass[moving].sum(), model.mass), "M": 0.0, "h": 0.0, "a": 0.0}
    state, random = model.state(), np.random.default_rng(0)
    for _ in range(_STATES):
        q, v = model.random_configuration(random), random.standard_normal(model.nv)
        tau = 10.0 * random.standard_normal(model.nj) * (model.limits.tau_max > 0)  # the others are passive
        state.update(0.0, q, v)
        bridge.write(data, q, v)
        bridge.write_torques(data, tau)
        mj.mj_forward(bare, data)
        X, drift = bridge.velocity_map(data), bridge.velocity_drift(data, v)
        M_physics = _inertia(mj, bare, data)
        free = cho_solve(cho_factor(state.M), np.concatenate([np.zeros(model.nb), tau]) - state.h)
        found = {
            "M": _difference(X.T @ M_physics @ X, state.M),
            "h": _difference(X.T @ (M_physics @ drift + data.qfrc_bias), state.h),
            "a": _difference(np.linalg.solve(X, data.qacc - drift), free),
        }
        worst = {name: max(value, found.get(name, 0.0)) for name, value in worst.items()}
    wrong = [f"{name} by {value:.1e}" for name, value in worst.items() if not value <= TOLERANCE]
    if wrong:
        raise SimulationError(
            f"physics and model of {model.name} are not the same robot: {', '.join(wrong)} (relative)"
        )
    return worst


def _without_extras(mj: Any, physics: Any) -> Any:
    bare = copy.copy(physics)
    off = mj.mjtDisableBit
    bare.opt.disableflags |= off.mjDSBL_CONSTRAINT | off.mjDSBL_CLAMPCTRL
    bare.dof_armature[:] = 0.0
    bare.dof_damping[:] = 0.0
    bare.actuator_biasprm[:] = 0.0  # drives are motors here
    bare.actuator_forcelimited[:] = 0
    return bare


def _inertia(mj: Any, physics: Any, data: Any) -> Mat:
    M = np.zeros((physics.nv, physics.nv))
    mj.mj_fullM(physics, data, M)
    return M


def _difference(found: Mat | Vec | float, expected: Mat | Vec | float) -> float:
    return float(np.abs(np.subtract(found, expected)).max() / max(np.abs(expected).max(), 1e-12))
