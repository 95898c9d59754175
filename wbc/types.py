"""The symbol table: what every letter means, in which unit and in which frame.

==========  ===============  =====================================================================
symbol      shape            meaning
==========  ===============  =====================================================================
nq, nv      scalars          size of the configuration, of the velocity
nb          scalar           floating-base velocities: 6, or 0 on a fixed base
nj          scalar           joints: nv = nb + nj; torques and limits have nj entries
nf          scalar           contact force variables
q           (nq,)            configuration; floating base: x y z, quaternion x y z w, then joints
v           (nv,)            velocity; floating base: linear then angular **in the base frame**, then joints
a           (nv,)            acceleration, the time derivative of v
M           (nv, nv)         inertia matrix
h           (nv,)            bias: Coriolis, centrifugal and gravity; M a + h = Sᵀ τ + Jᵀ f
tau         (nj,)            joint torques [N m], forces on prismatic joints [N]
f           (3,) or (6,)     contact wrench on the robot, force before moment, axes of the contact surface
J           (dim, nv)        Jacobian: ẏ = J v; frame rows are linear before angular, world axes
drift       (dim,)           J̇ v: the acceleration of y when a = 0 (classical, world axes for frames)
e           (dim,)           error, target − actual; rotations log(R_target Rᵀ) in world axes
ed          (dim,)           its rate, ẏ_ref − J v
H, g        (n, n), (n,)     cost of a QP, ½ xᵀHx + gᵀx
A, b        (n_eq, ·)        equality rows, A x = b
C, cl, cu   (n_in, ·)        two-sided rows, cl <= C x <= cu
lb, ub      (n,)             bounds on x
y, z, z_box multipliers      H x + g + Aᵀy + Cᵀz + z_box = 0; z > 0 at an upper bound, < 0 at a lower
==========  ===============  =====================================================================

SI units throughout: rad, m, s, N, N m, kg. Positions and poses are in the world frame and a pose
maps frame coordinates to world coordinates. ``inf`` means "no limit"; zero, negative and NaN
limits are errors, but a torque limit of zero is a joint without a motor.
"""

from __future__ import annotations

from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

Vec = NDArray[np.float64]
Mat = NDArray[np.float64]
Index = NDArray[np.intp]
Flags = NDArray[np.bool_]


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """The same array, into which nobody can write from now on."""
    array.setflags(False)  # type: ignore[call-arg]  # positional: a keyword takes twice as long, ``flags`` ten times
    return array


class Frozen:
    """What is written while it is built, and frozen for everybody else."""

    def _set(self, **fields: Any) -> None:
        for name, value in fields.items():
            object.__setattr__(self, name, value)


class Status(Enum):
    """How a solve, or a tick, ended. The value of each member is advice.

    Example:
        >>> from wbc.types import Status
        >>> Status.SOLVED.ok, Status.INFEASIBLE.ok
        (True, False)
    """

    SOLVED = "an optimum was found and certified"
    INFEASIBLE = "the rows contradict each other: no point meets them all; loosen or drop one"
    UNBOUNDED = "the cost has no minimum; add a posture or damping task"
    MAX_ITERATIONS = "the iteration limit came first; raise it or choose another solver"
    INACCURATE = "no answer could be certified; bring the sizes of weights and rows nearer, or take another solver"
    FAILED = "a row is not finite, numbers broke down, or a member of the stack failed: controller.why says which"
    INVALID_STATE = "the state was not finite or not plausible"

    @property
    def ok(self) -> bool:
        """True if the solution may be used as it is."""
        return self is _SOLVED

    def __str__(self) -> str:
        return self.name.lower().replace("_", " ")


_SOLVED = Status.SOLVED  # a member of an Enum is slow to look up
