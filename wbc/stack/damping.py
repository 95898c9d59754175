"""Damping of the joints by what the last answer left of the kinematic tasks: out of reach leads to rest."""

from __future__ import annotations

from typing import final

import numpy as np
from scipy.linalg.blas import dgemv, idamax

from wbc.qp.rows import RowProblem
from wbc.stack.layout import Layout
from wbc.stack.motion import MotionRows
from wbc.types import Mat, Vec

#: The Jacobian may grow by this factor before a residual that needed no damping is looked at again.
_GROWTH = 2.0
#: What counts as a small angle: a residual over the lever of a joint.
_WELL = 0.01


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
        self._problem, self._factor, self._motion = problem, factor, motion
        rows = sum(task.dim for task in layout.kinematic)
        first = layout.motion_row
        #: 1 where a row (column) belongs to a task (row).
        self._of = np.zeros((len(layout.kinematic), rows))
        for of, task, row in zip(self._of, layout.kinematic, layout.kinematic_rows, strict=True):
            of[row - first : row - first + task.dim] = 1.0
        block = problem.G[first : first + rows]
        self._rows_T, self._J = block.T, block[:, nb:nv]
        self._weights = problem.weights[first - problem.soft.start :][:rows]
        gain = motion.rate if motion.order == 1 else motion.kp
        self._gain, self._kd, self._e = gain[:rows], motion.kd[:rows], motion.e[:rows]
        self._residual = np.zeros(rows)
        self._step = dt if motion.order == 1 else 4.0 * dt**2
        #: Weight that the joints have without it (nj,).
        self.base = np.zeros(nj)
        #: Of each kinematic task: what it asks for, in the units of weights (tasks, nj).
        self.asked = np.zeros((len(layout.kinematic), nj))
        #: Weight of the damping of each joint (nj,), and which of the unknowns y the joints are.
        self.applied, self.columns = np.zeros(nj), slice(nb - layout.n_u, nv - layout.n_u)
        self.reset()

    def reset(self) -> None:
        """No damping, as before the first tick."""
        self.asked[:] = 0.0
        self.applied[:] = 0.0
        self._quiet = 0.0

    @property
    def is_on(self) -> bool:
        """Whether any joint is damped."""
        return bool(self.applied.any())

    def observe(self) -> bool:
        """Read what the last answer left; whether the damping changed by it."""
        residual = dgemv(1.0, self._rows_T, self._problem.x1, 0.0, self._residual, 0, 1, 0, 1, 1, 1)
        largest = abs(float(residual[idamax(residual)]))
        was_on = self.is_on
        if largest <= self._quiet and not was_on:
            return False
        left = np.divide(np.abs(residual), self._gain, out=np.zeros(len(residual)), where=self._gain > 0.0)
        lever = np.sqrt(self._of @ (self._weights[:, None] * self._J**2))
        self.asked[:] = self._asked_for(np.minimum(left, np.abs(self._e)), lever)
        needed = self.asked.sum(axis=0)
        if not np.isfinite(needed).all():
            self.reset()
            return was_on
        applied = np.maximum(needed - self.base, 0.0)
        self.applied[:] = applied
        if applied.any():
            self._set_rate(needed)
            return True
        # The same residuals x times as large need x² times as much at most, also where errors allow for all of them.
        most = self._asked_for(left, lever).sum(axis=0)
        with np.errstate(divide="ignore"):
            self._quiet = largest * min(1.0, float(np.sqrt((self.base / most).min()))) / _GROWTH
        return was_on

    def _asked_for(self, left: Vec, lever: Mat) -> Mat:
        """Weights for what is left of the errors (rows,), with the levers √w‖Jⱼ‖ (tasks, nj)."""
        factor = np.maximum(self._step * (self._of * self._gain).max(axis=1), self._factor)
        asked = (factor * np.sqrt(self._of @ (self._weights * left * left)))[:, None]
        weights: Mat = np.zeros(lever.shape)
        np.divide(asked**2 * lever, asked + _WELL * lever, out=weights, where=lever > 0.0)
        return weights

    def _set_rate(self, needed: Vec) -> None:
        """At the acceleration level a joint is damped at the rate kd of the tasks that ask for it."""
        kd = (self._of @ self._kd) / self._of.sum(axis=1)
        self._motion.set_damping(np.divide(kd @ self.asked, needed, out=np.zeros(len(needed)), where=needed > 0.0))
