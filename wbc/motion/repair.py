"""Repair: a motion near by for which forces and torques exist. Timing gives way, then the base, legs, waist and arms.

In turn the motion is slower where that helps (:mod:`wbc.motion.pace`), and moved by quadratic programs over windows
around frames without a certificate. δ_k moves the configuration of frame k, and the wrenches f_k are unknowns too:

    min Σ_k ½ |d_k + δ_k|²_W + ½ ρ |δ̈_k|² + slacks     d_k: how far frame k was moved before
    subject to   ID(q, v, a)_base + D_q δ + D_v δ̇ + D_a δ̈ − J_baseᵀ f = 0,   f in its cone, less a margin
                 the same for joints that work hard, within ± τ_max, less a margin
                 J δ = what is missing to the place of what holds,   q_min <= q + δ <= q_max,   speed within v_max
                 pairs of shapes stay apart

with δ̇ and δ̈ the central differences that the witness takes, and D_q the derivative at wrenches that are constant in the
axes of their feet, so that moving the body over its feet moves the centre of pressure. It is solved a few times, each
time about the motion that it gave. W declares what gives way: the base first, legs follow it, then waist and arms.

Source: the derivatives are those of Carpentier, Mansard, RSS 2018; the scheme is sequential quadratic programming.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, TypeVar, final

import numpy as np
import pinocchio
from scipy import sparse

from wbc.models.collision import Distances
from wbc.motion.body import SIDES, spans
from wbc.motion.forces import lacking, wrench_map
from wbc.motion.judged import Judged
from wbc.motion.pace import moments, possible_pace
from wbc.motion.witness import Witness, velocities
from wbc.stack.contact import Contact
from wbc.types import Mat, Vec

#: Frames around those that are mended [s], how often the program is solved, and frames of a window at most.
_AROUND, _ROUNDS, _LONGEST = 0.7, 4, 150
#: W of the base's place [1/m²] and turn, of legs, and of waist and arms [1/rad²]; of feet that swing, and of δ̈.
_BASE, _TURN, _LEGS, _OTHERS, _SWING, _SMOOTH = 1.0, 10.0, 0.1, 10.0, 30.0, 3e-5
#: The margins: shares of cone and torque limit that are used, and the share of the limit from which a torque counts.
_CONE, _TORQUE, _HARD = 0.96, 0.96, 0.5
#: Weight of slacks [shares of weight or limit], and of forces; how far a frame moves at once [rad, m], as derivatives
#: hold nearby.
_SLACK, _FORCE, _NEAR = 1e4, 1e-4, 0.3
_LEVER, _APART = 0.1, 5e-3

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
            for start, stop in _windows(bad, found.rate, shift=turn // 2 % 2):
                moved[start:stop] = program.moved(first, now.q, start, stop)
            now = judged(replace(now, q=moved))
        progress((turn + 1) / (2 * _ROUNDS), "repairing")
        best = max(best, now, key=lambda one: one.certified)
    return best


def _windows(bad: Any, rate: float, *, shift: int) -> list[tuple[int, int]]:
    """Frames around the bad ones, in pieces of a bounded length; shifted by half a piece or not, as edges stay."""
    around = round(_AROUND * rate)
    wide = np.convolve(bad, np.ones(2 * around + 1), mode="same") > 0
    found = []
    for start, stop in spans(wide):
        pieces = -(-(stop - start) // _LONGEST)
        edges = np.linspace(start, stop, pieces + 1)
        if shift and pieces > 1:
            middles = 0.5 * (edges[1:] + edges[:-1])
            edges = np.concatenate([[start], middles, [stop]])
        found += [(int(a), int(b)) for a, b in pairwise(edges)]
    return found


@final
class _Window:
    """The program of frames start … stop: rows (low, high, blocks at columns), diagonal costs of what is no move, where
    the columns of a frame begin, and how many there are."""

    def __init__(self, start: int, stop: int, nv: int) -> None:
        self.at = {k: nv * (k - start) for k in range(start, stop)}
        self.columns = nv * (stop - start)
        self.cost: list[Vec] = [np.zeros(0)]
        self._rows: list[tuple[Vec, Vec, Sequence[tuple[int, Mat]]]] = []

    def add(self, low: Any, high: Any, *blocks: tuple[int, Mat]) -> None:
        """Rows with blocks at columns; equalities where low = high."""
        n = len(blocks[0][1])
        self._rows.append((np.broadcast_to(low, (n,)), np.broadcast_to(high, (n,)), blocks))

    def unknowns(self, weights: Vec) -> int:
        """Where the columns of as many unknowns with these costs begin."""
        self.cost.append(weights)
        self.columns += len(weights)
        return self.columns - len(weights)

    def solved(self, H: Any, gradient: Vec) -> Vec | None:
        """The unknowns of least cost ½ xᵀ H x + gᵀ x, with the costs of what is no move; None: there are none."""
        import qpsolvers

        low, high = (np.concatenate(side) for side in list(zip(*self._rows, strict=True))[:2])
        starts = np.cumsum([0, *(len(row[0]) for row in self._rows)])
        parts = [
            (block[i], first + i[0], column + i[1])
            for first, (_, _, blocks) in zip(starts.tolist(), self._rows, strict=False)
            for column, block in blocks
            for i in [np.nonzero(block)]
        ]
        values, i, j = map(np.concatenate, zip(*parts, strict=True))
        A = sparse.csc_matrix((values, (i, j)), shape=(len(low), self.columns))
        rest, same = np.concatenate(self.cost), low == high
        upper, lower = np.isfinite(high) & ~same, np.isfinite(low) & ~same
        answer: Vec | None = qpsolvers.solve_qp(
            sparse.block_diag([H, sparse.diags(rest)], format="csc"), np.append(gradient, 0.0 * rest),
            sparse.vstack([A[upper], -A[lower]], format="csc"), np.concatenate([high[upper], -low[lower]]),
            A[same], low[same], solver="clarabel",
        )  # fmt: skip
        return answer


@final
class _Program:
    """The quadratic programs of one motion."""

    def __init__(self, found: Judged) -> None:
        self._robot = robot = found.robot
        self._found, self._targets, self._contacts = found, found.targets, found.contacts
        self._model, self._data, self._state = robot.pinocchio, robot.pinocchio.createData(), robot.state()
        self._joints = np.eye(robot.nv)[6:]
        self._feet = [f"{side}_foot" for side in SIDES]
        self._W = np.full(robot.nv, _OTHERS)
        self._W[:3], self._W[3:6] = _BASE, _TURN
        for foot in self._feet:
            joint = self._model.frames[robot.frames[found.contacts[foot].frame]].parentJoint
            self._W[[self._model.joints[j].idx_v for j in self._model.supports[joint] if j > 1]] = _LEGS
        self._apart = Distances(robot, reach=0.05, margin=_APART) if robot.collisions else None

    def moved(self, found: Judged, q: Mat, start: int, stop: int) -> Mat:
        """Frames start … stop of q, moved to be near those of ``found``; those around them stay."""
        self._found, self._targets = found, found.targets
        nv, count, rate = self._robot.nv, stop - start, found.rate
        v, a, steps = velocities(self._robot, q, rate)
        window, costs, gradient = _Window(start, stop, nv), [], []
        still = {*((start, start + 1) if start else ()), *((stop - 2, stop - 1) if stop < len(q) else ())}
        for k, column in window.at.items():
            self._state.update(0.0, q[k], v[k])
            gradient.append(self._W * pinocchio.difference(self._model, found.q[k], q[k]))
            costs.append(self._cost(k))
            if k in still:
                window.add(0.0, 0.0, (column, np.eye(nv)))
                continue
            self._place(window, k, q[k])
            if 0 < k < len(q) - 1 and self._held(k):
                self._force(window, k, q[k], v[k], a[k])
        most = self._robot.limits.v_max / rate
        for k in range(start, stop - 1):
            step, here, after = steps[k, 6:], window.at[k], window.at[k + 1]
            window.add(-most - step, most - step, (here, -self._joints), (after, self._joints))
        second = sparse.diags([1.0, -2.0, 1.0], [-1, 0, 1], shape=(count, count)) * rate**2
        smooth = sparse.kron(second.T @ second, sparse.eye(nv)) * _SMOOTH
        answer = window.solved(sparse.block_diag(costs) + smooth, np.concatenate(gradient))
        if answer is None:
            return q[start:stop]
        moves = answer[: nv * count].reshape(count, nv)
        moves *= min(1.0, _NEAR / max(float(np.abs(moves).max()), 1e-9))
        return np.array([pinocchio.integrate(self._model, one, d) for one, d in zip(q[start:stop], moves, strict=True)])

    def _cost(self, k: int) -> Mat:
        """W, and feet in the air keep their places: w |J δ|²."""
        cost = np.diag(self._W)
        for foot in self._feet:
            if not self._targets.holds[foot][k]:
                J = self._state.frame(self._contacts[foot].frame).jacobian()
                cost += _SWING * J.T @ J
        return cost

    def _place(self, window: _Window, k: int, q: Vec) -> None:
        """What holds is at its place, joints are within their limits, shapes are apart."""
        limits, column = self._robot.limits, window.at[k]
        for part in self._held(k):
            error, J = self._missing(part, k)
            window.add(error, error, (column, J))
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
        contacts = [self._contacts[part] for part in self._held(k)]
        _, f = lacking(robot, self._state, a, contacts)
        weight = robot.mass * float(np.linalg.norm(robot.gravity))
        J = np.vstack([wrench_map(self._state, contact) for contact in contacts])
        needed = self._state.M @ a + self._state.h
        tau = (needed - J.T @ f)[6:]
        hard = np.flatnonzero(np.isfinite(tau_max) & (np.abs(tau) > _HARD * tau_max))
        rows = np.concatenate([np.arange(6), 6 + hard])
        size = np.concatenate([weight * np.array([1, 1, 1, _LEVER, _LEVER, _LEVER]), tau_max[hard]])[:, None]
        Dq, Dv, Da = (part[rows] / size for part in self._derivatives(q, v, a, contacts, f))
        forces = window.unknowns(np.full(len(J), _FORCE))
        slack = window.unknowns(np.full(len(rows), _SLACK))
        blocks = [(forces, -weight * J[:, rows].T / size), (slack, np.eye(len(rows)))]
        on_v, on_a = 0.5 * rate * Dv, rate**2 * Da
        around = {k - 1: on_a - on_v, k: Dq - 2.0 * on_a, k + 1: on_a + on_v}
        blocks += [(window.at[i], block) for i, block in around.items() if i in window.at]
        there, room = needed[rows] / size[:, 0], np.where(rows < 6, 0.0, _TORQUE)
        window.add(-room - there, room - there, *blocks)
        for contact in contacts:
            scale = np.array([1.0 if unit == "N" else 1.0 / _LEVER for _, unit in contact.cone_labels()])
            cone = np.vstack([np.array(contact.cone()) * scale[:, None], -np.eye(contact.dim)[2]])
            cone[:-1, 2] *= _CONE
            window.add(-np.inf, 0.0, (forces, cone))
            forces += contact.dim

    def _held(self, k: int) -> list[str]:
        return [part for part in self._contacts if self._targets.holds[part][k]]

    def _missing(self, part: str, k: int) -> tuple[Vec, Mat]:
        """What lacks to the place of what holds, and its Jacobian, in the axes of the frame."""
        contact = self._contacts[part]
        frame = self._state.frame(contact.frame)
        place = self._targets.places[part][k]
        if contact.dim == 3:
            return place - frame.position, frame.jacobian()[:3].copy()
        goal = pinocchio.SE3(self._targets.turned[part][k], place)
        error = pinocchio.log6(pinocchio.SE3(frame.placement).actInv(goal)).vector
        return error, frame.jacobian_local().copy()

    def _derivatives(self, q: Vec, v: Vec, a: Vec, contacts: Sequence[Contact], f: Vec) -> tuple[Mat, Mat, Mat]:
        model, data = self._model, self._data
        outer = pinocchio.StdVec_Force()
        for _ in range(model.njoints):
            outer.append(pinocchio.Force.Zero())
        pinocchio.framesForwardKinematics(model, data, q)
        at = 0
        for contact in contacts:
            frame = model.frames[self._robot.frames[contact.frame]]
            wrench = np.zeros(6)
            wrench[: contact.dim] = f[at : at + contact.dim]
            at += contact.dim
            turn = np.eye(3) if contact.dim == 6 else data.oMf[self._robot.frames[contact.frame]].rotation.T
            origin = np.asarray(getattr(contact, "origin", np.zeros(3)))
            outer[frame.parentJoint] += (frame.placement * pinocchio.SE3(turn, origin)).act(pinocchio.Force(wrench))
        Dq, Dv, _ = pinocchio.computeRNEADerivatives(model, data, q, v, a, outer)
        return Dq, Dv, self._state.M
