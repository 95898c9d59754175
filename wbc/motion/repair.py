"""Repair: a motion near by for which forces and torques exist. It changes timing, then base, legs, waist, arms.

In turn the motion is slower where that helps (:mod:`wbc.motion.pace`), and moved by quadratic programs over windows
around frames without a certificate. δ_k moves the configuration of frame k, and the wrenches f_k are unknowns too:

    min Σ_k ½ |d_k + δ_k|²_W + ½ ρ |δ̈_k|² + slacks     d_k: how far frame k was moved before
    subject to   ID(q, v, a)_base + D_q δ + D_v δ̇ + D_a δ̈ − J_baseᵀ f = 0,   f in its cone, less a margin
                 the same for joints that work hard, within ± τ_max, less a margin
                 J δ = what is missing to the place of what holds,   q_min <= q + δ <= q_max,   speed within v_max
                 pairs of shapes stay apart

with δ̇ and δ̈ the central differences that the witness takes, and D_q the derivative at wrenches that are constant in the
axes of their feet, so that moving the body over its feet moves the centre of pressure. It is solved a few times, each
time about the motion that it gave. The weights W let the base and the legs move first, then waist and arms.

Source: the derivatives are those of Carpentier, Mansard, RSS 2018; the scheme is sequential quadratic programming.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import pairwise
from typing import Any, TypeVar, final

import numpy as np
import pinocchio
from scipy import sparse
from scipy.ndimage import binary_dilation

from wbc.models.collision import Distances
from wbc.motion.body import SIDES, spans
from wbc.motion.forces import LEVERS, cones, lacking, weight_of
from wbc.motion.judged import Judged
from wbc.motion.kinematics import velocities
from wbc.motion.pace import moments, possible_pace
from wbc.motion.retargeting import anchor
from wbc.motion.witness import Witness
from wbc.types import Mat, Vec

#: Frames around those that are mended [s], how often the program is solved, and frames of a window at most.
_AROUND, _ROUNDS, _LONGEST = 0.7, 4, 600
#: W of the base's place [1/m²] and turn, of legs, and of waist and arms [1/rad²]; of feet that swing, and of δ̈.
_BASE, _TURN, _LEGS, _OTHERS, _SWING, _SMOOTH = 1.0, 10.0, 0.1, 10.0, 30.0, 3e-5
#: The margins: shares of cone and torque limit that are used, and the share of the limit from which a torque counts.
_CONE, _TORQUE, _HARD = 0.96, 0.96, 0.5
#: Weight of slacks [shares of weight or limit], and of forces; how far a frame moves at once [rad, m], as derivatives
#: hold nearby.
_SLACK, _FORCE, _NEAR = 1e4, 1e-4, 0.3
_APART = 5e-3

_J = TypeVar("_J", bound=Judged)


def repaired(found: _J, witness: Witness, progress: Callable[[float, str], None]) -> _J:
    """The motion with most certified frames that comes of it: in turn a slower one, and one that moves otherwise.

    ``before`` is the motion that was found; ``unsolved`` are frames of that.
    """

    def judged(motion: _J) -> _J:
        return replace(motion, verdicts=tuple(witness.judge(motion.q, motion.rate, motion.holds)))

    program, first = _Program(found), found
    best = now = replace(found, before=found)
    for turn in range(2 * _ROUNDS):
        bad = np.array([not verdict.certified for verdict in now.verdicts])
        if not bad.any():
            break
        if turn % 2 == 0:
            pace = possible_pace(now)
            if pace.min() == 1.0:
                continue
            when = moments(pace, now.rate)
            first, now = first.at(when), judged(now.at(when))
        else:
            moved = now.q.copy()
            for span in spans(binary_dilation(bad, iterations=round(_AROUND * found.rate))):
                for start, stop in _pieces(*span, shifted=turn // 2 % 2 == 1):
                    moved[start:stop] = program.moved(first, now.q, start, stop)
            now = judged(replace(now, q=moved))
        progress((turn + 1) / (2 * _ROUNDS), "repairing")
        best = max(best, now, key=lambda one: one.certified)
    return best


def _pieces(start: int, stop: int, *, shifted: bool) -> Iterable[tuple[int, int]]:
    """Windows of a bounded length; ``shifted`` by half of one or not, as the frames at their edges stay."""
    edges = np.linspace(start, stop, -(-(stop - start) // _LONGEST) + 1).astype(int).tolist()
    middles = [(a + b) // 2 for a, b in pairwise(edges)]
    return pairwise([start, *middles, stop] if shifted and len(middles) > 1 else edges)


@final
class _Window:
    """The program of frames start … stop: rows (low, high, blocks at columns), diagonal costs of what is no move, where
    the columns of a frame begin, and how many there are."""

    def __init__(self, start: int, stop: int, nv: int) -> None:
        self.at = {k: nv * (k - start) for k in range(start, stop)}
        self.columns, self._count = nv * (stop - start), 0
        self._cost: list[Vec] = [np.zeros(0)]
        self._bounds: list[tuple[Vec, Vec]] = []
        self._entries: list[tuple[Vec, Any, Any]] = []

    def add(self, low: Any, high: Any, *blocks: tuple[int, Mat]) -> None:
        """Rows with blocks at columns; equalities where low = high."""
        n = len(blocks[0][1])
        for column, block in blocks:
            i, j = np.nonzero(block)
            self._entries.append((block[i, j], self._count + i, column + j))
        self._bounds.append((np.broadcast_to(low, (n,)), np.broadcast_to(high, (n,))))
        self._count += n

    def unknowns(self, weights: Vec) -> int:
        """Where the columns of as many unknowns with these costs begin."""
        self._cost.append(weights)
        self.columns += len(weights)
        return self.columns - len(weights)

    def solved(self, H: Any, gradient: Vec) -> Vec | None:
        """The unknowns of least cost ½ xᵀ H x + gᵀ x, with the costs of what is no move; None: there are none."""
        import qpsolvers

        values, i, j = map(np.concatenate, zip(*self._entries, strict=True))
        A = sparse.csc_matrix((values, (i, j)), shape=(self._count, self.columns))
        low, high = map(np.concatenate, zip(*self._bounds, strict=True))
        rest, same = np.concatenate(self._cost), low == high
        upper, lower = np.isfinite(high) & ~same, np.isfinite(low) & ~same
        answer: Vec | None = qpsolvers.solve_qp(
            sparse.csc_matrix(sparse.block_diag([H, sparse.diags_array(rest)])), np.append(gradient, 0.0 * rest),
            sparse.vstack([A[upper], -A[lower]], format="csc"), np.concatenate([high[upper], -low[lower]]),
            A[same], low[same], solver="clarabel",
        )  # fmt: skip
        return answer


@final
class _Program:
    """The quadratic programs of one motion."""

    def __init__(self, found: Judged) -> None:
        self._found, self._robot, self._state = found, found.robot, found.robot.state()
        self._model, self._data = found.robot.pinocchio, found.robot.pinocchio.createData()
        self._joints = np.eye(found.robot.nv)[6:]
        self._W = np.repeat([_BASE, _TURN, _OTHERS], [3, 3, found.robot.nj])
        self._feet = {part: found.contacts[part].frame for part in (f"{side}_foot" for side in SIDES)}
        for frame in self._feet.values():
            joint = self._model.frames[found.robot.frames[frame]].parentJoint
            self._W[[self._model.joints[j].idx_v for j in self._model.supports[joint] if j > 1]] = _LEGS
        self._apart = Distances(found.robot, reach=0.05, margin=_APART) if found.robot.collisions else None

    def moved(self, found: Judged, q: Mat, start: int, stop: int) -> Mat:
        """Frames start … stop of q, moved to be near those of ``found``; those around them stay."""
        self._found = found
        nv, count, rate = self._robot.nv, stop - start, found.rate
        v, a, steps = velocities(self._robot, q, rate)
        window, costs, gradient = _Window(start, stop, nv), [], []
        still = {*((start, start + 1) if start else ()), *((stop - 2, stop - 1) if stop < len(q) else ())}
        for k, column in window.at.items():
            self._state.update(0.0, q[k], v[k])
            gradient.append(self._W * self._robot.difference(found.q[k], q[k]))
            swing = [self._state.frame(f).jacobian() for part, f in self._feet.items() if part not in found.held(k)]
            costs.append(sum((_SWING * J.T @ J for J in swing), np.diag(self._W)))
            if k in still:
                window.add(0.0, 0.0, (column, np.eye(nv)))
                continue
            self._place(window, k, q[k])
            if 0 < k < len(q) - 1 and found.held(k):
                self._force(window, k, q[k], v[k], a[k])
        most = self._robot.limits.v_max / rate
        for k in range(start, stop - 1):
            step, here, after = steps[k, 6:], window.at[k], window.at[k + 1]
            window.add(-most - step, most - step, (here, -self._joints), (after, self._joints))
        second = sparse.diags_array([1.0, -2.0, 1.0], offsets=[-1, 0, 1], shape=(count, count)) * rate**2
        smooth = sparse.kron(second.T @ second, sparse.eye_array(nv)) * _SMOOTH
        answer = window.solved(
            sparse.block_diag([sparse.coo_array(cost) for cost in costs]) + smooth, np.concatenate(gradient)
        )
        if answer is None:
            return q[start:stop]
        moves = answer[: nv * count].reshape(count, nv)
        moves *= min(1.0, _NEAR / max(float(np.abs(moves).max()), 1e-9))
        return np.array([self._robot.integrate(one, d) for one, d in zip(q[start:stop], moves, strict=True)])

    def _place(self, window: _Window, k: int, q: Vec) -> None:
        """What holds is at its place, joints are within their limits, shapes are apart."""
        limits, column = self._robot.limits, window.at[k]
        for part, contact in self._found.held(k).items():
            rows = contact.rows(self._state, anchor(contact, self._found.targets, part, k))
            window.add(rows.e, rows.e, (column, rows.J))
        low, high = np.minimum(limits.q_min - q[7:], 0.0), np.maximum(limits.q_max - q[7:], 0.0)
        window.add(low, high, (column, self._joints))
        if self._apart is not None:
            self._apart.read(self._state)
            near = self._apart.which >= 0
            d = self._apart.distance[near]
            window.add(np.minimum(_APART, d) - d, np.inf, (column, self._apart.jacobian[near]))

    def _force(self, window: _Window, k: int, q: Vec, v: Vec, a: Vec) -> None:
        """The base's rows, those of joints that work hard, and the cones; wrenches are in shares of the weight."""
        robot, rate, tau_max = self._robot, self._found.rate, self._robot.limits.tau_max
        contacts = [*self._found.held(k).values()]
        _, f = lacking(robot, self._state, a, contacts)
        weight, (cone, normals) = weight_of(robot), cones(contacts)
        J = np.vstack([contact.rows(self._state).J for contact in contacts])
        needed = self._state.M @ a + self._state.h
        tau = (needed - J.T @ f)[6:]
        hard = np.flatnonzero(np.isfinite(tau_max) & (np.abs(tau) > _HARD * tau_max))
        rows = np.concatenate([np.arange(6), 6 + hard])
        size = np.concatenate([weight * LEVERS, tau_max[hard]])[:, None]
        forces = window.unknowns(np.full(len(J), _FORCE))
        slack = window.unknowns(np.full(len(rows), _SLACK))
        blocks = [(forces, -weight * J[:, rows].T / size), (slack, np.eye(len(rows)))]
        cone[:, normals] *= _CONE
        window.add(-np.inf, 0.0, (forces, np.vstack([cone, -np.eye(len(J))[normals]])))
        outer = [pinocchio.Force.Zero() for _ in range(self._model.njoints)]
        for contact in contacts:
            wrench, f = np.append(f[: contact.dim], np.zeros(6 - contact.dim)), f[contact.dim :]
            joint = self._model.frames[robot.frames[contact.frame]].parentJoint
            there = contact.anchor(self._state).pose.act(pinocchio.Force(wrench))
            outer[joint] += self._state.data.oMi[joint].actInv(there)
        derivatives = pinocchio.computeRNEADerivatives(self._model, self._data, q, v, a, pinocchio.StdVec_Force(outer))
        Dq, Dv, Da = (part[rows] / size for part in (*derivatives[:2], self._state.M))
        on_v, on_a = 0.5 * rate * Dv, rate**2 * Da
        around = {k - 1: on_a - on_v, k: Dq - 2.0 * on_a, k + 1: on_a + on_v}
        blocks += [(window.at[i], block) for i, block in around.items() if i in window.at]
        there, room = needed[rows] / size[:, 0], np.where(rows < 6, 0.0, _TORQUE)
        window.add(-room - there, room - there, *blocks)
