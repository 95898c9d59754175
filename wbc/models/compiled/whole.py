"""What the passes over the joints leave for the robot as a whole: gravity, drifts and the centre of mass.

``crba`` finds the map of the momentum, A_G, and with it the Jacobian of the centre of mass, A_G's linear rows over the
mass. ``nonLinearEffects`` without gravity finds what moves each joint at a = 0: the forces on the joints at the root
are the rate of the linear momentum.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np

from wbc.compiled import Layout, Memory, carray, copy, entry, floats
from wbc.models.views import view
from wbc.types import Index, Mat, Vec


class Whole(NamedTuple):
    """Memory of Pinocchio; its matrices stand column by column."""

    sizes: Annotated[Index, "4"]  # nv, entries of h, joints, joints at the root: the last three 0 without h
    momentum_map: Annotated[Mat, "nv, 6"]  # A_Gᵀ
    com_jacobian: Annotated[Mat, "nv, 3"]
    com_drift: Annotated[Vec, "3"]
    numbers: Annotated[Vec, "4"]  # the mass, gravity
    h: Annotated[Vec, "n_h"]  # C v, then with gravity
    joints: Annotated[Index, "n_joints, 2"]  # where spatial accelerations are without gravity, and where they go
    roots: Annotated[Index, "n_roots, 2"]  # where rotations and forces are, in the joint's axes


LAYOUT = Layout(Whole, nv="sizes[0]", n_h="sizes[1]", n_joints="sizes[2]", n_roots="sizes[3]")
views = LAYOUT.views


def memory(model: Any, data: Any, *, has_h: bool) -> Memory:
    """What :func:`complete` reads and writes of a ``pinocchio.Data``, after ``nonLinearEffects`` or without it."""
    nv, joints = model.nv, range(model.njoints) if has_h else range(0)
    roots = [i for i in joints[1:] if model.parents[i] == 0]
    accelerations = Memory(*(motion[i].np for i in joints for motion in (data.a_gf, data.a)))
    forces = Memory(*(place for i in roots for place in (data.oMi[i].rotation, data.f[i].np)))
    mass = sum(inertia.mass for inertia in model.inertias[1:])
    return Memory(*LAYOUT.arrays(
        np.array([nv, nv * has_h, len(joints), len(roots)]), momentum_map=view(data.Ag, data, 6, nv).T,
        com_jacobian=view(data.Jcom, data, 3, nv).T, com_drift=data.acom[0], h=data.nle[: nv * has_h],
        numbers=np.array([mass, *model.gravity.linear]), joints=accelerations.addresses, roots=forces.addresses,
    ))  # fmt: skip


@entry
def complete(at: int) -> int:
    """J_com = A_lin / m, and where there is h: h = C v − A_linᵀ γ, the drifts, and c̈ = Σ R f / m of the roots."""
    s = views(at)
    share = 1.0 / s.numbers[0]
    for c in range(s.sizes[0]):
        for k in range(3):
            s.com_jacobian[c, k] = share * s.momentum_map[c, k]
    if len(s.h) == 0:
        return 1
    for c in range(s.sizes[0]):
        for k in range(3):
            s.h[c] -= s.momentum_map[c, k] * s.numbers[1 + k]
    for i in range(len(s.joints)):
        copy(carray(floats(s.joints[i, 0]), 6), carray(floats(s.joints[i, 1]), 6))
    for k in range(3):
        s.com_drift[k] = 0.0
    for i in range(len(s.roots)):
        rotation, force = carray(floats(s.roots[i, 0]), (3, 3)), carray(floats(s.roots[i, 1]), 3)
        for k in range(3):
            for c in range(3):
                s.com_drift[k] += share * rotation[c, k] * force[c]
    return 1
