"""Repair: the nearest motion for which forces and torques exist, by quadratic programs over windows of frames.

Around frames without a certificate, δ_k moves the configuration of frame k, and the wrenches f_k are unknowns too:

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
from itertools import pairwise
from typing import Any, final

import numpy as np
import pinocchio
from scipy import sparse

from wbc.models.collision import Distances
from wbc.motion.body import SIDES, spans
from wbc.motion.forces import lacking, wrench_map
from wbc.motion.judged import Judged
from wbc.motion.verdict import Verdict
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


def repaired(found: Judged, witness: Witness, progress: Callable[[float, str], None]) -> tuple[Mat, list[Verdict]]:
    """Configurations (N, nq) near those found, and their verdicts; of all rounds those with most certified frames."""
    program = _Program(found)
    best = now = found.q, list(found.verdicts)
    for turn in range(_ROUNDS):
        bad = np.array([not verdict.certified for verdict in now[1]])
        if not bad.any():
            break
        moved = now[0].copy()
        for start, stop in _windows(bad, found.rate, shift=turn % 2):
            moved[start:stop] = program.moved(now[0], start, stop)
        now = moved, witness.judge(moved, found.rate, found.holds)
        progress(0.5 + 0.5 * (turn + 1) / _ROUNDS, "repairing")
        if _count(now[1]) > _count(best[1]):
            best = now
    return best


def _count(verdicts: Sequence[Verdict]) -> int:
    return sum(verdict.certified for verdict in verdicts)


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
class _Rows:
    """Sparse rows low <= A x <= high, block by block."""

    def __init__(self) -> None:
        self.blocks: list[tuple[int, int, Mat]] = []
        self.low: list[Vec] = []
        self.high: list[Vec] = []
        self.count = 0

    def add(self, low: Any, high: Any, *blocks: tuple[int, Mat]) -> None:
        """Rows with blocks at columns."""
        n = len(blocks[0][1])
        self.blocks += [(self.count, column, block) for column, block in blocks]
        self.low.append(np.broadcast_to(low, (n,)))
        self.high.append(np.broadcast_to(high, (n,)))
        self.count += n

    def bounds(self) -> tuple[Vec, Vec]:
        """low and high."""
        return np.concatenate(self.low), np.concatenate(self.high)

    def matrix(self, columns: int) -> Any:
        """A."""
        i, j, values = [], [], []
        for row, column, block in self.blocks:
            at, of = np.nonzero(block)
            i.append(row + at)
            j.append(column + of)
            values.append(block[at, of])
        entries = (np.concatenate(values), (np.concatenate(i), np.concatenate(j)))
        return sparse.coo_matrix(entries, shape=(self.count, columns)).tocsc()


@final
class _Window:
    """The program of frames start … stop: rows, diagonal costs, where the columns of a frame begin, and how many."""

    def __init__(self, start: int, stop: int, nv: int) -> None:
        self.equal, self.bounded = _Rows(), _Rows()
        self.cost: list[tuple[int, Vec]] = []
        self.at = {k: nv * (k - start) for k in range(start, stop)}
        self.columns = nv * (stop - start)


@final
class _Program:
    """The quadratic programs of one motion."""

    def __init__(self, found: Judged) -> None:
        self._robot = robot = found.robot
        self._found, self._targets, self._contacts = found, found.targets, found.contacts
        self._model, self._data, self._state = robot.pinocchio, robot.pinocchio.createData(), robot.state()
        self._weight = float(robot.mass * np.linalg.norm(robot.gravity))
        self._feet = [f"{side}_foot" for side in SIDES]
        self._W = np.full(robot.nv, _OTHERS)
        self._W[:3], self._W[3:6] = _BASE, _TURN
        for foot in self._feet:
            joint = self._model.frames[robot.frames[found.contacts[foot].frame]].parentJoint
            self._W[[self._model.joints[j].idx_v for j in self._model.supports[joint] if j > 1]] = _LEGS
        self._apart = Distances(robot, reach=0.05, margin=_APART) if robot.collisions else None

    def moved(self, q: Mat, start: int, stop: int) -> Mat:
        """The configurations of frames start … stop, moved; those around them stay."""
        import qpsolvers

        nv, count, rate = self._robot.nv, stop - start, self._found.rate
        v, a, steps = velocities(self._robot, q, rate)
        window = _Window(start, stop, nv)
        at, joints = window.at, np.hstack([np.zeros((nv - 6, 6)), np.eye(nv - 6)])
        gradient = np.zeros(nv * count)
        still = {*((start, start + 1) if start else ()), *((stop - 2, stop - 1) if stop < len(q) else ())}
        for k in at:
            before = pinocchio.difference(self._model, self._found.q[k], q[k])
            window.cost.append((at[k], self._W))
            gradient[at[k] : at[k] + nv] = self._W * before
            if k in still:
                window.equal.add(0.0, 0.0, (at[k], np.eye(nv)))
                continue
            self._place(window, k, q[k], v[k])
            if 0 < k < len(q) - 1:
                self._force(window, k, q[k], v[k], a[k])
        most = self._robot.limits.v_max / rate
        for k in range(start, stop - 1):
            step = steps[k, 6:]
            window.bounded.add(-most - step, most - step, (at[k], -joints), (at[k + 1], joints))
        size = window.columns
        diagonal = np.zeros(size)
        for column, values in window.cost:
            diagonal[column : column + len(values)] += values
        H = sparse.diags(diagonal) + self._smooth(count, size) + self._swings(q, window)
        G, low, high = window.bounded.matrix(size), *window.bounded.bounds()
        upper, lower = np.isfinite(high), np.isfinite(low)
        answer = qpsolvers.solve_qp(
            H.tocsc(), np.concatenate([gradient, np.zeros(size - nv * count)]),
            sparse.vstack([G[upper], -G[lower]]).tocsc(), np.concatenate([high[upper], -low[lower]]),
            window.equal.matrix(size), window.equal.bounds()[0], solver="clarabel",
        )  # fmt: skip
        if answer is None:
            return q[start:stop]
        moves = answer[: nv * count].reshape(count, nv)
        moves *= min(1.0, _NEAR / max(float(np.abs(moves).max()), 1e-9))
        return np.array([pinocchio.integrate(self._model, one, d) for one, d in zip(q[start:stop], moves, strict=True)])

    def _place(self, window: _Window, k: int, q: Vec, v: Vec) -> None:
        """What holds is at its place, joints are within their limits, shapes are apart."""
        nv, limits, column = self._robot.nv, self._robot.limits, window.at[k]
        self._state.update(0.0, q, v)
        for part in self._held(k):
            error, J = self._missing(part, k)
            window.equal.add(error, error, (column, J))
        low, high = np.minimum(limits.q_min - q[7:], 0.0), np.maximum(limits.q_max - q[7:], 0.0)
        window.bounded.add(low, high, (column, np.hstack([np.zeros((nv - 6, 6)), np.eye(nv - 6)])))
        if self._apart is not None:
            self._apart.read(self._state)
            near = self._apart.which >= 0
            if near.any():
                d = self._apart.distance[near]
                window.bounded.add(np.minimum(_APART, d) - d, np.inf, (column, self._apart.jacobian[near].copy()))

    def _force(self, window: _Window, k: int, q: Vec, v: Vec, a: Vec) -> None:
        """The base's rows, those of joints that work hard, and the cones; wrenches are in shares of the weight."""
        robot, rate, weight = self._robot, self._found.rate, self._weight
        contacts = [self._contacts[part] for part in self._held(k)]
        if not contacts:
            return
        self._state.update(0.0, q, v)
        _, f = lacking(robot, self._state, a, contacts)
        J = np.vstack([wrench_map(self._state, contact) for contact in contacts])
        needed = self._state.M @ a + self._state.h
        tau_max = robot.limits.tau_max
        tau = (needed - J.T @ f)[6:]
        hard = np.flatnonzero(np.isfinite(tau_max) & (np.abs(tau) > _HARD * tau_max))
        rows = np.concatenate([np.arange(6), 6 + hard])
        size = np.concatenate([weight * np.array([1, 1, 1, _LEVER, _LEVER, _LEVER]), tau_max[hard]])[:, None]
        D, n = [part[rows] / size for part in self._derivatives(q, v, a, contacts, f)], len(J)
        forces, slack = window.columns, window.columns + n
        window.columns += n + len(rows)
        window.cost += [(forces, np.full(n, _FORCE)), (slack, np.full(len(rows), _SLACK))]
        blocks = [(forces, -weight * J[:, rows].T / size), (slack, np.eye(len(rows)))]
        for i, on_q, on_v, on_a in ((-1, 0.0, -0.5, 1.0), (0, 1.0, 0.0, -2.0), (1, 0.0, 0.5, 1.0)):
            if k + i in window.at:
                blocks.append((window.at[k + i], on_q * D[0] + on_v * rate * D[1] + on_a * rate**2 * D[2]))
        there = needed[rows] / size[:, 0]
        window.equal.add(-there[:6], -there[:6], *((column, block[:6]) for column, block in blocks))
        if len(hard):
            window.bounded.add(-_TORQUE - there[6:], _TORQUE - there[6:], *((c, block[6:]) for c, block in blocks))
        for contact in contacts:
            scale = np.array([1.0 if unit == "N" else 1.0 / _LEVER for _, unit in contact.cone_labels()])
            cone = np.array(contact.cone()) * scale[:, None]
            cone[:, 2] *= _CONE
            push = np.zeros((1, contact.dim))
            push[0, 2] = -1.0
            window.bounded.add(-np.inf, 0.0, (forces, np.vstack([cone, push])))
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
        Dq, Dv, Da = pinocchio.computeRNEADerivatives(model, data, q, v, a, outer)
        upper = np.triu(Da)
        return Dq, Dv, upper + np.triu(Da, 1).T

    def _smooth(self, count: int, columns: int) -> Any:
        """ρ δ̈ᵀ δ̈."""
        second = sparse.diags([1.0, -2.0, 1.0], [-1, 0, 1], shape=(count, count)) * self._found.rate**2
        whole = sparse.kron(second.T @ second, sparse.eye(self._robot.nv)) * _SMOOTH
        return sparse.block_diag([whole, sparse.csc_matrix((columns - whole.shape[0],) * 2)])

    def _swings(self, q: Mat, window: _Window) -> Any:
        """Feet in the air keep their places: w |J δ|²."""
        blocks, nv = [], self._robot.nv
        for k in window.at:
            self._state.update(0.0, q[k], np.zeros(nv))
            free = [foot for foot in self._feet if not self._targets.holds[foot][k]]
            maps = [self._state.frame(self._contacts[foot].frame).jacobian() for foot in free]
            blocks.append(sparse.csc_matrix(sum((_SWING * J.T @ J for J in maps), np.zeros((nv, nv)))))
        rest = window.columns - nv * len(blocks)
        return sparse.block_diag([*blocks, sparse.csc_matrix((rest, rest))])
