"""Repair: a motion near by for which forces and torques exist. It changes timing, then base, legs, waist, arms.

In turn the motion is slower where that helps, and moved by quadratic programs over windows
around frames without a certificate. δ_k moves the configuration of frame k, and the wrenches f_k are unknowns too:

    min Σ_k ½ |d_k + δ_k|²_W + ½ ρ |δ̈_k|² + slacks     d_k: how far frame k was moved before
    subject to   ID(q, v, a)_base + D_q δ + D_v δ̇ + D_a δ̈ − J_baseᵀ f = 0,   f in its cone, less a margin
                 the same for joints that work hard, within ± τ_max, less a margin
                 J δ = what is missing to the place of what holds,   q_min <= q + δ <= q_max,   speed within v_max
                 pairs of shapes stay apart

with δ̇ and δ̈ the central differences that the witness takes, and D_q the derivative at wrenches that are constant in the
axes of their feet, so that moving the body over its feet moves the centre of pressure. It is solved a few times, each
time about the motion that it gave. The weights W let the base and the legs move first, then waist and arms.

**Pace.** At r times the pace a frame has the velocity r v and the acceleration r² a at the same configuration. What it
needs then lies on the line from what it needs at rest to what it needs at its own pace:

    M (r² a) + h(q, r v) = g + r² (M a + h − g)

Forces that are possible form a convex set. A frame that is possible at the least pace is so up to one r, found by
bisection; one that is not has faults which no timing mends. The pace changes slowly from frame to frame, so that its
own change asks for little: ṙ v is not in the equation.

Source: of the pace J. M. Hollerbach, Dynamic scaling of manipulator trajectories, ASME Journal of Dynamic Systems,
Measurement, and Control 106(1), 1984; the derivatives are those of Carpentier, Mansard, RSS 2018; the scheme is
sequential quadratic programming.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import pairwise
from typing import Any, final

import numpy as np
import pinocchio
from scipy import sparse
from scipy.interpolate import CubicSpline
from scipy.ndimage import binary_dilation, minimum_filter1d
from scipy.signal.windows import hann

from wbc.models.along import velocities
from wbc.models.collision import Distances
from wbc.models.derivatives import inverse_dynamics_derivatives
from wbc.motion.clip import SIDES
from wbc.motion.retargeted import Retargeted
from wbc.motion.targets import anchor
from wbc.motion.witness import FORCES, LEVER, LEVERS, Witness, lacking
from wbc.qp.sparse import solve_sparse
from wbc.report.measure import spans
from wbc.stack.contact import cones
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
#: The pace at which timing has to help, the least at once, the share of what was found that is used, and how often
#: what lies between is halved.
_LEAST, _AT_ONCE, _MARGIN, _HALVINGS = 0.2, 0.7, 0.97, 6
#: Within so many seconds the pace comes down to what a frame needs, and up again.
_EASED = 0.3
#: A sum of frames is whole up to this.
_ROUNDING = 1e-9


def repaired(found: Retargeted, witness: Witness, progress: Callable[[float, str], None]) -> Retargeted:
    """The motion with most certified frames that comes of it: in turn a slower one, and one that moves otherwise.

    ``before`` is the motion that was found; ``unsolved`` are frames of that.
    """
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
            first, now = first.at(when), now.at(when)
        else:
            moved = now.q.copy()
            for span in spans(binary_dilation(bad, iterations=round(_AROUND * found.rate))):
                for start, stop in _pieces(*span, shifted=turn // 2 % 2 == 1):
                    moved[start:stop] = program.moved(first, now.q, start, stop)
            now = replace(now, q=moved)
        now = replace(now, verdicts=witness.judge(now.q, now.rate, now.holds))
        progress((turn + 1) / (2 * _ROUNDS), "repairing")
        best = max(best, now, key=lambda one: one.certified)
    return best


def _pieces(start: int, stop: int, *, shifted: bool) -> Iterable[tuple[int, int]]:
    """Windows of a bounded length; ``shifted`` by half of one or not, as the frames at their edges stay."""
    edges = np.linspace(start, stop, -(-(stop - start) // _LONGEST) + 1).astype(int).tolist()
    middles = [(a + b) // 2 for a, b in pairwise(edges)]
    return pairwise([start, *middles, stop] if shifted and len(middles) > 1 else edges)


def possible_pace(found: Retargeted) -> Vec:
    """The share of its pace (N,) at which each frame is possible, at least 0.7; 1 where it is, or no pace helps."""
    v, a, _ = velocities(found.robot, found.q, found.rate)
    state, pace = found.robot.state(), np.ones(len(found.q))
    for k, verdict in enumerate(found.verdicts):
        contacts = [*found.held(k).values()]
        if verdict.certified or not contacts or not {fault.kind for fault in verdict.faults} <= FORCES:
            continue
        low, middle, high = 0.0, _LEAST**2, 1.0  # of its square
        for _ in range(_HALVINGS):
            state.update(0.0, found.q[k], middle**0.5 * v[k])
            possible = not lacking(found.robot, state, middle * a[k], contacts)[0]
            low, high = (middle, high) if possible else (low, middle)
            if not low:
                break
            middle = 0.5 * (low + high)
        pace[k] = max(_MARGIN * low**0.5, _AT_ONCE) if low else 1.0
    return pace


def moments(pace: Vec, rate: float) -> Vec:
    """The moments (M,) in frames from 0 to N − 1 at which a motion has at most this pace (N,), smoothly.

    The least pace within a window around each frame, averaged over as many frames, is nowhere above what was asked.

    Example:
        >>> import numpy as np
        >>> from wbc.motion.repair import moments
        >>> moments(np.full(7, 0.5), 60.0).round(3)
        array([0. , 0.5, 1. , 1.5, 2. , 2.5, 3. , 3.5, 4. , 4.5, 5. , 5.5, 6. ])
    """
    size, frames = 2 * round(_EASED * rate) + 1, np.arange(len(pace))
    weights = hann(size + 2)[1:-1]
    edged = np.pad(minimum_filter1d(pace, size, mode="nearest"), size // 2, mode="edge")
    smooth = np.convolve(edged, weights / weights.sum(), mode="valid")
    passed = np.append(0.0, np.cumsum(2.0 / (smooth[1:] + smooth[:-1])))  # since the start, in frames as long as now
    last = np.ceil(passed[-1] - _ROUNDING)
    return np.asarray(CubicSpline(passed * last / passed[-1], frames)(np.arange(last + 1.0)).clip(0.0, frames[-1]))


@final
class _Program:
    """The quadratic programs of one motion."""

    def __init__(self, found: Retargeted) -> None:
        self._found, self._robot, self._state = found, found.robot, found.robot.state()
        self._joints = np.eye(found.robot.nv)[6:]
        self._W = np.repeat([_BASE, _TURN, _OTHERS], [3, 3, found.robot.nj])
        self._feet = {part: found.contacts[part].frame for part in (f"{side}_foot" for side in SIDES)}
        for frame in self._feet.values():
            self._W[6:][self._state.frame(frame).jacobian()[:, 6:].any(axis=0)] = _LEGS
        self._apart = Distances(found.robot, reach=0.05, margin=_APART) if found.robot.collisions else None

    def moved(self, found: Retargeted, q: Mat, start: int, stop: int) -> Mat:
        """Frames start … stop of q, moved to be near those of ``found``; those around them stay."""
        self._found = found
        nv, count, rate = self._robot.nv, stop - start, found.rate
        v, a, steps = velocities(self._robot, q, rate)
        still = {*((start, start + 1) if start else ()), *((stop - 2, stop - 1) if stop < len(q) else ())}
        costs, gradient, frames = [], [], []
        for k in range(start, stop):
            self._state.update(0.0, q[k], v[k])
            gradient.append(self._W * self._robot.difference(found.q[k], q[k]))
            swing = [self._state.frame(f).jacobian() for part, f in self._feet.items() if part not in found.held(k)]
            costs.append(sum((_SWING * J.T @ J for J in swing), np.diag(self._W)))
            stays = np.eye(nv, 3 * nv), *np.zeros((2, nv)), np.zeros(0)
            frames.append(stays if k in still else self._rows(k, q[k], v[k], a[k], forces=0 < k < len(q) - 1))
        rows, low, high, weights = zip(*frames, strict=True)
        each, size = sparse.eye_array(nv), (count, count)
        rates = sparse.kron(sparse.diags_array([-0.5, 0.5], offsets=[-1, 1], shape=size) * rate, each)
        seconds = sparse.kron(sparse.diags_array([1.0, -2.0, 1.0], offsets=[-1, 0, 1], shape=size) * rate**2, each)
        on_q, on_v, on_a, on_f = map(_diagonal, zip(*(np.hsplit(R, [nv, 2 * nv, 3 * nv]) for R in rows), strict=True))
        steps_of = sparse.kron(sparse.diags_array([-1.0, 1.0], offsets=[0, 1], shape=(count - 1, count)), self._joints)
        fast, taken = np.tile(self._robot.limits.v_max / rate, count - 1), steps[start : stop - 1, 6:].ravel()
        rest = sparse.diags_array(np.concatenate(weights))
        answer = solve_sparse(
            _diagonal([_diagonal(costs) + _SMOOTH * seconds.T @ seconds, rest]),
            np.concatenate([*gradient, rest.diagonal() * 0.0]),
            sparse.block_array([[on_q + on_v @ rates + on_a @ seconds, on_f], [steps_of, None]]),
            np.concatenate([*low, -fast - taken]), np.concatenate([*high, fast - taken]),
        )  # fmt: skip
        if answer is None:
            return q[start:stop]
        moves = answer[: nv * count].reshape(count, nv)
        moves *= min(1.0, _NEAR / max(float(np.abs(moves).max()), 1e-9))
        return np.array([self._robot.integrate(one, d) for one, d in zip(q[start:stop], moves, strict=True)])

    def _place(self, k: int, q: Vec) -> tuple[Mat, Vec, Vec]:
        """Rows on δ and their bounds: what holds is at its place, joints are within limits, shapes are apart."""
        limits = self._robot.limits
        rows = [(self._joints, np.minimum(limits.q_min - q[7:], 0.0), np.maximum(limits.q_max - q[7:], 0.0))]
        for part, contact in self._found.held(k).items():
            at = contact.rows(self._state, anchor(contact, self._found.targets, part, k))
            rows.append((at.J, at.e, at.e))
        if self._apart is not None:
            self._apart.read(self._state)
            near = self._apart.which >= 0
            least = np.minimum(_APART - self._apart.distance[near], 0.0)
            rows.append((self._apart.jacobian[near], least, np.full(len(least), np.inf)))
        J, low, high = (np.concatenate(parts) for parts in zip(*rows, strict=True))
        return J, low, high

    def _rows(self, k: int, q: Vec, v: Vec, a: Vec, *, forces: bool) -> tuple[Mat, Vec, Vec, Vec]:
        """Rows on δ, δ̇, δ̈, and on wrenches and slacks, which are shares of the weight and of limits; their bounds; and
        the costs of wrenches and slacks. Of forces: those of the base and of joints that work hard, and the cones."""
        robot, tau_max, nv = self._robot, self._robot.limits.tau_max, self._robot.nv
        place, low, high = self._place(k, q)
        contacts = [*self._found.held(k).values()]
        if not forces or not contacts:
            return np.pad(place, ((0, 0), (0, 2 * nv))), low, high, np.zeros(0)
        _, f = lacking(robot, self._state, a, contacts)
        weight, (cone, normals) = robot.weight, cones(contacts, lever=LEVER)
        J = np.vstack([contact.rows(self._state).J for contact in contacts])
        needed = self._state.M @ a + self._state.h
        tau = (needed - J.T @ f)[6:]
        hard = np.flatnonzero(np.isfinite(tau_max) & (np.abs(tau) > _HARD * tau_max))
        rows = np.concatenate([np.arange(6), 6 + hard])
        size = np.concatenate([weight * LEVERS, tau_max[hard]])[:, None]
        cone[:, normals] *= _CONE
        wrenches = [np.pad(one, (0, 6 - len(one))) for one in np.split(f, normals[1:] - 2)]
        anchors = [contact.anchor(self._state) for contact in contacts]
        poses = [pinocchio.SE3(at.rotation, at.position) for at in anchors]
        pushes = [(c.frame, at.act(pinocchio.Force(w))) for c, at, w in zip(contacts, poses, wrenches, strict=True)]
        on_moves = [part[rows] / size for part in inverse_dynamics_derivatives(self._state, a, pushes)]
        weights = np.repeat([_FORCE, _SLACK], [len(J), len(rows)])
        matrix = np.block([
            [place, np.zeros((len(place), 2 * nv + len(weights)))],
            [*on_moves, -weight * J.T[rows] / size, np.eye(len(rows))],
            [np.zeros((len(cone), 3 * nv)), cone, np.zeros((len(cone), len(rows)))],
        ])  # fmt: skip
        there, room, inside = needed[rows] / size[:, 0], np.where(rows < 6, 0.0, _TORQUE), np.zeros(len(cone))
        low, high = np.concatenate([low, -room - there, inside - np.inf]), np.concatenate([high, room - there, inside])
        return matrix, low, high, weights


def _diagonal(blocks: Iterable[Any]) -> Any:
    """A sparse array of ``blocks`` along its diagonal; of matrices, versions of SciPy make one or the other."""
    return sparse.block_diag([sparse.coo_array(block) for block in blocks])
