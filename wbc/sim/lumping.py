"""Lumping: what is fixed together weighs as one, where the engine refuses the inertia of a single link.

Descriptions give links inertias that no body has (zero, or principal moments A + B < C), and MuJoCo's compiler refuses
those. The motion of a robot knows only the sum over all that is fixed together; where even the sum is of no body, the
compiler is given another one about the same axes, and the compiled model gets the file's own back: its equations of
motion need a positive definite M(q), no more.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from wbc.models.geometry import Origin
from wbc.models.urdf import Inertial, Link, Urdf, six
from wbc.sim.engine import mujoco
from wbc.types import Mat, Vec

#: Moments of inertia that every compiler takes [kg m²], and the room left for rounding.
_LEAST, _ROUNDING = 1e-12, 1e-9


def lumped(urdf: Urdf) -> Urdf:
    """``urdf`` with the mass of every link that is fixed on the one that carries it.

    Sums are of the 4 x 4 pseudo-inertia J = Σ m x̄ x̄ᵀ with x̄ = (x, 1), which the pose T of a link takes to T J Tᵀ.
    """
    fixed = {joint.child: joint for joint in urdf.joints if not joint.moves}
    sums: dict[str, Mat] = {}
    for link in urdf.links:
        if link.inertial is None:
            continue
        carrier, T = link.name, link.inertial.origin.matrix
        while carrier in fixed:
            joint = fixed[carrier]
            carrier, T = joint.parent, joint.origin.matrix @ T
        sums[carrier] = sums.get(carrier, 0.0) + T @ _pseudo_inertia(link.inertial) @ T.T
    return replace(urdf, links=tuple(Link(link.name, _inertial(sums.get(link.name))) for link in urdf.links))


def acceptable(urdf: Urdf) -> Urdf:
    """``urdf`` with inertias about the same centres and axes, but of bodies."""
    return replace(urdf, links=tuple(replace(link, inertial=_of_a_body(link.inertial)) for link in urdf.links))


def restore(physics: Any, urdf: Urdf) -> None:
    """Give ``physics``, compiled from ``acceptable(urdf)``, the inertias of ``urdf``."""
    mj = mujoco()
    for link in urdf.links:
        body = mj.mj_name2id(physics, mj.mjtObj.mjOBJ_BODY, link.name)
        if link.inertial is not None and body > 0:
            moments, axes = _principal(link.inertial)
            physics.body_inertia[body] = moments
            mj.mju_mat2Quat(physics.body_iquat[body], axes.ravel())
            physics.body_sameframe[body] = mj.mjtSameFrame.mjSAMEFRAME_NONE
    mj.mj_setConst(physics, mj.MjData(physics))


def _of_a_body(inertial: Inertial | None) -> Inertial | None:
    if inertial is None or not inertial.mass:
        return inertial
    moments, axes = _principal(inertial)
    a, b, c = moments
    if a > _LEAST and a + b > c * (1 + _ROUNDING):
        return inertial
    inertia = axes @ np.diag([3.0, 4.0, 5.0]) @ axes.T
    return replace(inertial, inertia=six(inertia))


def _principal(inertial: Inertial) -> tuple[Vec, Mat]:
    """Principal moments, rising, and their axes: a rotation."""
    moments, axes = np.linalg.eigh(inertial.matrix)
    return moments, axes * np.linalg.det(axes)


def _pseudo_inertia(inertial: Inertial) -> Mat:
    """About the centre of mass: ∫ x xᵀ dm = ½ tr(I) 1 − I, and the mass in the corner."""
    inertia = inertial.matrix
    J = np.zeros((4, 4))
    J[:3, :3] = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    J[3, 3] = inertial.mass
    return J


def _inertial(J: Mat | None) -> Inertial | None:
    if J is None or not J[3, 3]:
        return None
    centre = J[:3, 3] / J[3, 3]
    spread = J[:3, :3] - J[3, 3] * np.outer(centre, centre)
    inertia = np.trace(spread) * np.eye(3) - spread
    x, y, z = map(float, centre)
    return Inertial(float(J[3, 3]), six(inertia), Origin((x, y, z)))
