"""Damping of the joints by what the last answer left of the kinematic tasks: out of reach leads to rest."""

from __future__ import annotations

from typing import final

import numpy as np

from wbc.compiled import Memory
from wbc.qp.rows import RowProblem
from wbc.stack.compiled.damping_kernel import CHANGED, SPOILT, observe
from wbc.stack.layout import Layout
from wbc.stack.motion import MotionRows


@final
class ResidualDamping:
    """Levenberg-Marquardt damping of the joints, with the part of each error that could not be reduced.

    A task linearised where its target is out of reach, J v = rate e, asks for any joint speed along the directions in
    which J is nearly singular: the second order of ½ w ‖e‖² is missing there, of size w ‖e‖ ‖Jⱼ‖ for joint j (Jⱼ its
    column of J: for joints that turn, ‖∂J/∂qᵢ‖ is at most that). So with e_r = residual / gain, the part of the error
    (never more than the error itself) that the answer of the tick before left, the cost gets

        Velocity level:      ½ dⱼ vⱼ²                 dⱼ = max(0, Σ s² lⱼ / (s + lⱼ/100) − bⱼ) over the tasks
        Acceleration level:  ½ dⱼ (aⱼ + kd vⱼ)²       s = λ √w‖e_r‖, lⱼ = √w‖Jⱼ‖

    which is s lⱼ but for small s: a residual that is small beside lⱼ, as tasks that contradict each other a little
    leave, hardly counts. bⱼ is the weight that the joint has from tasks on the joints and the regularisation. It moves
    no point of rest: there v = 0 whatever d is. Where the tasks are met, e_r = 0 and d = 0. λ is ``lm_damping`` of the
    level, or rate dt (4 kp dt²) where that is more: the steps of a tick need as much.

    Source: Sugihara, IEEE T-RO 27(5), 2011 (damping by the residual); Dennis, Schnabel, Numerical Methods for
    Unconstrained Optimization, ch. 10 (why the second order counts where the residual is large).
    """

    def __init__(self, layout: Layout, motion: MotionRows, problem: RowProblem, factor: float, dt: float) -> None:
        nb, nv, nj = layout.model.nb, layout.model.nv, layout.model.nj
        self._motion = motion
        dims = [task.dim for task in layout.kinematic]
        rows, first = sum(dims), layout.motion_row
        starts = np.cumsum([0, *dims])
        gain = motion.rate if motion.order == 1 else motion.kp
        step = dt if motion.order == 1 else 4.0 * dt**2
        #: λ, the step, and a residual that needs no damping.
        self._numbers = np.array([factor, step, 0.0])
        #: Weight that the joints have without it (nj,).
        self.base = np.zeros(nj)
        #: Weight of the damping of each joint (nj,), and which of the unknowns y the joints are.
        self.applied, self.columns = np.zeros(nj), slice(nb - layout.n_u, nv - layout.n_u)
        self._rate = np.zeros(nj)
        self._memory = Memory(
            np.array([len(dims), rows, nj, problem.n + 1, nb], dtype=np.int64), starts.astype(np.int64), self._numbers,
            problem.G[first : first + rows], problem.x1, problem.weights[first - problem.soft.start :][:rows],
            gain[:rows], motion.kd[:rows], motion.e[:rows], self.base, self.applied, np.zeros((len(dims), nj)),
            self._rate, np.zeros(rows), *(np.zeros(nj) for _ in range(3)),
        )  # fmt: skip
        self._at = self._memory.address
        self.reset()

    def reset(self) -> None:
        """No damping, as before the first tick."""
        self.applied[:] = 0.0
        self._numbers[2] = 0.0

    @property
    def is_on(self) -> bool:
        """Whether any joint is damped."""
        return bool(self.applied.any())

    def observe(self) -> bool:
        """Read what the last answer left; whether the damping changed by it."""
        found = observe(self._at)
        if found == CHANGED:
            self._motion.set_damping(self._rate)
        elif found == SPOILT:
            was_on = self.is_on
            self.reset()
            return was_on
        return found == CHANGED
