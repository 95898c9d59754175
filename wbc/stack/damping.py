"""Damping of the joints by the residual of the kinematic tasks: a target out of reach brings the robot to rest."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import final

import numpy as np

from wbc.compiled import Memory
from wbc.qp.lexicographic import Pull
from wbc.qp.rows import RowProblem, RowTask
from wbc.stack.block import MotionBlock
from wbc.stack.compiled.damping_kernel import DAMPINGS, RESIDUAL, observe
from wbc.stack.hierarchy import Rank
from wbc.stack.layout import Layout
from wbc.stack.motion import MotionRows
from wbc.types import Vec

#: What directions feel of the damping: they are kept to about this share of what is asked.
_SIDEWAYS = 1e-3


@final
class ResidualDamping:
    """Levenberg-Marquardt damping of the joints, with the part of each error that could not be reduced.

    A task linearised where its target is out of reach, J v = rate e, asks for any joint speed along the directions in
    which J is nearly singular: the second order of ½ w ‖e‖² is missing there, of size w ‖e‖ ‖Jⱼ‖ for joint j (Jⱼ its
    column of J: for joints that turn, ‖∂J/∂qᵢ‖ is at most that). What is held meanwhile (levels above, exact tasks)
    pushes back, and its second order is missing, too: a hand out of reach moves all joints that keep the balance. Its
    multipliers are not known yet; they make its largest column as large as that of the task. Contacts are held, too,
    but do not count: when they did, a quadruped crept to rest, and up to a sixth of its ticks were not certified.
    So with e_r = residual / gain, the part of the error (never more than the error itself) that the answer of the tick
    before left, the cost gets

        Velocity level:      ½ dⱼ vⱼ²              dⱼ = max(0, Σ s² lⱼ / (s + lⱼ/100) − bⱼ) over the tasks
        Acceleration level:  ½ dⱼ (aⱼ + kd vⱼ)²    s = λ √w‖e_r‖, lⱼ = √w (‖Jⱼ‖ + Σ ‖Hⱼ‖ max‖J‖ / max‖H‖)

    over the rows H of each that is held, max the longest column. That is s lⱼ but for small s: a residual that is small
    beside lⱼ, as tasks that contradict each other a little leave, hardly counts. bⱼ is the weight that the joint has
    from tasks on the joints and the regularisation. It moves no point of rest: there v = 0 whatever d is. Where the
    tasks are met, e_r = 0 and d = 0. λ is ``lm_damping`` of the level, or rate dt (4 kp dt²) where that is more: the
    steps of a tick need as much.

    Source: Sugihara, IEEE T-RO 27(5), 2011 (damping by the residual); Dennis, Schnabel, Numerical Methods for
    Unconstrained Optimization, ch. 10 (why the second order counts where the residual is large); Nocedal, Wright,
    Numerical Optimization, 18.1 (with constraints it is that of the Lagrangian).
    """

    def __init__(
        self, layout: Layout, motion: MotionRows, problem: RowProblem, factor: float, dt: float, *,
        blocks: Sequence[MotionBlock], held: Sequence[MotionBlock],
    ) -> None:  # fmt: skip
        nb, nv, nj = layout.model.nb, layout.model.nv, layout.model.nj
        blocks = blocks if factor > 0.0 else []
        #: The tasks whose residuals damp the joints.
        self.names, starts = [block.name for block in blocks], np.cumsum([0, *(block.dim for block in blocks)])
        rows, own = int(starts[-1]), slice(*([blocks[0].motion.start, blocks[-1].motion.stop] if blocks else [0, 0]))
        of_tasks = slice(layout.motion_row + own.start, layout.motion_row + own.stop)
        weighed, soft = sum(block.dim for block in layout.kinematic), of_tasks.start - problem.soft.start
        motions = problem.G[layout.motion_row :]
        gain = motion.rate if motion.order == 1 else motion.kp
        step = dt if motion.order == 1 else 4.0 * dt**2
        sizes = [len(blocks), rows, nj, problem.n + 1, nb, len(held), weighed, len(motions)]
        memory = RESIDUAL.arrays(
            np.array(sizes, dtype=np.int64), first=starts.astype(np.int64), numbers=np.array([factor, step, 0.0, 0.0]),
            G=problem.G[of_tasks], left=problem.value[problem.item(of_tasks.start) :][:rows],
            weights=problem.weights[soft:][:rows] if soft < len(problem.weights) else np.ones(rows),
            gain=gain[own], kd=motion.kd[own], e=motion.e[own], G_held=motions,
            held=np.array([(block.motion.start, block.motion.stop) for block in held], dtype=np.int64),
            weights_held=problem.weights[layout.motion_row - problem.soft.start :][:weighed],
        )  # fmt: skip
        #: λ, the step, a residual that needs no damping, and whether any joint is damped.
        self._numbers = memory.numbers
        #: Weight that the joints have without it (nj,).
        self.base = memory.base
        #: Weight of the damping of each joint (nj,), and which of the unknowns y the joints are.
        self.applied, self.columns = memory.applied, slice(nb - layout.n_u, nv - layout.n_u)
        #: a = −rate v is what is wanted of each joint (nj,).
        self.rate = memory.rate
        #: What a level that is damped by itself costs beside its tasks: weight of each joint, and what it wants there.
        self.weights, self.wanted = memory.cost
        self._memory = Memory(*memory)
        #: For the compiled code that reads what the last answer left.
        self.address = self._memory.address

    def reset(self) -> None:
        """No damping, as before the first tick."""
        self.applied[:] = 0.0
        self._numbers[2:] = 0.0

    def go_on_from(self, former: ResidualDamping) -> None:
        """Damp as another did whose tasks have the same names."""
        if self.names == former.names:
            self.applied[:], self.rate[:], self._numbers[2:] = former.applied, former.rate, former._numbers[2:]

    @property
    def is_on(self) -> bool:
        """Whether any joint is damped."""
        return bool(self._numbers.item(3) != 0.0)

    def now(self) -> tuple[Vec, Vec]:
        """Weight of the damping of each joint (nj,), and its rate, by the residuals in the problem's memory."""
        self.reset()
        observe(self.address)
        return self.applied, self.rate


@final
class Damping:
    """The damping of a plan: one in the metric of all joints, and one by itself for each level that ranks above others.

    A level above others is damped by the residual of its own tasks only. It solves

        minimise ½ Σ wᵢ (Jᵢ x − tᵢ)² + ½ Σ dⱼ (xⱼ − cⱼ)² + ½ ε ‖x‖²        over the joints' part of x

    and the levels below keep J x. The damping in the metric uses the residual of all other kinematic tasks.

    The null space of a level is free to first order only: the second order for which the level is damped also affects
    the levels below. These are therefore damped in the same joints, by dⱼ/σ² times the curvature of their own tasks
    there; d/σ² is the ratio of the residual of the level to the motion that it made. They slow down and come to rest at
    the same points. Source: Chiaverini, IEEE T-RA 13(3), 1997 (damped least squares above an undamped null space);
    Pfeiffer, Escande, Righetti, IEEE RA-L 3(4), 2018 (the second order of a level takes the
    freedom of those below).
    """

    def __init__(
        self, layout: Layout, motion: MotionRows, problem: RowProblem, factor: float, dt: float, *, least: float,
        ranks: Sequence[Rank],
    ) -> None:  # fmt: skip
        self._least = least
        made_of = layout, motion, problem, factor, dt
        #: By what exact tasks leave, for a tick in which they are relaxed.
        self.of_exact = ResidualDamping(*made_of, blocks=layout.exact, held=[])
        above = ranks if ranks[-1].after else ranks[:-1]
        upper = [rank for rank in above if any(task.kinematic for task in rank.tasks)] if factor else []
        ends = np.cumsum([0, *(sum(task.kinematic for task in rank.tasks) for rank in upper)]).tolist()
        *self.of_levels, self.in_metric = self._all = [
            ResidualDamping(
                *made_of, blocks=layout.kinematic[first:last], held=[*layout.kinematic[:first], *layout.exact]
            )
            for first, last in pairwise([*ends, len(layout.kinematic)])
        ]
        #: Of each stage of the ranks what damps it; the last stage has its damping in the metric.
        self.pulls: list[Pull | None] = []
        #: Tasks on the joints at the levels that are damped.
        self._on_joints: list[tuple[ResidualDamping, RowTask]] = []
        #: What a task does in part it brakes with all of its kd: the place of its level, its motion rows, their drift.
        braking: list[tuple[int, slice, Vec]] = []
        for rank in ranks if upper else ():
            if rank not in upper:
                self.pulls += [None] * len(rank.stages)
                continue
            damping = self.of_levels[k := upper.index(rank)]
            turning, whole = (
                Pull(damping.columns, damping.weights, damping.wanted, share) for share in (_SIDEWAYS, 1.0)
            )
            self.pulls += [*[turning] * len(rank.directions), whole, *[None] * len(rank.after)]
            first = layout.model.nb  # of the unknowns that the joints are
            joints = (task for task in rank.tasks if task.unknowns is not None and task.unknowns.start == first)
            self._on_joints += [(damping, task) for task in joints]
            turned = (part.task for stage in rank.directions for part in stage)
            for task in turned if motion.order > 1 else ():
                if task.kinematic and task.rows is not None:
                    own = slice(task.rows.start - layout.motion_row, task.rows.stop - layout.motion_row)
                    braking.append((k, own, task.drift))
        self._braked = [drift for _, _, drift in braking]
        brakes = [(k, own.start, own.stop, drift.__array_interface__["data"][0]) for k, own, drift in braking]
        nj, rows = layout.model.nj, problem.G[layout.motion_row :]
        sizes = [len(self._all), nj, len(brakes), len(rows), problem.n + 1, layout.model.nb, motion.order]
        memory = DAMPINGS.arrays(
            np.array(sizes, dtype=np.int64), at=np.array([damping.address for damping in self._all], dtype=np.int64),
            least=np.array([least]), brakes=np.array(brakes, dtype=np.int64), kd=motion.kd[: len(rows)], G=rows,
        )  # fmt: skip
        self._memory = Memory(*memory)
        #: For the compiled code of a tick.
        self.address = self._memory.address

    def read_weights(self) -> None:
        """The weights that the joints have from the tasks of their own levels, and the regularisation."""
        for damping in self.of_levels:
            damping.base[:] = self._least
        for damping, task in self._on_joints:
            damping.base += task.weights

    def reset(self) -> None:
        """No damping, as before the first tick."""
        for damping in self._all:
            damping.reset()

    @property
    def is_on(self) -> bool:
        """Whether any joint is damped, by any level."""
        return any(damping.is_on for damping in self._all)

    @property
    def largest(self) -> float:
        """The largest weight of the damping of a joint."""
        return max(float(damping.applied.max(initial=0.0)) for damping in self._all)

    def go_on_from(self, former: Damping) -> None:
        """Damp as another did, level by level, where the tasks have the same names."""
        for mine, theirs in zip(self._all, former._all, strict=False) if len(self._all) == len(former._all) else ():
            mine.go_on_from(theirs)
