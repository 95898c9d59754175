"""Witness: judges a robot's motion frame by frame, by its joints, its contacts, and the forces that it needs.

    v_k = (q_{k+1} ⊖ q_{k−1}) / 2T      a_k = (q_{k+1} ⊖ q_k − q_k ⊖ q_{k−1}) / T²

A *jump* is one step of a joint that neither the step before nor the one after resembles. A foot *slips* that holds and
is off its place, the median of its places while it holds. Forces are looked for in frames without a fault of motion,
with proof.

Contact wrenches and joint torques have to exist that give the motion:

    M a + h = Sᵀ τ + Σ Jᵢᵀ fᵢ,   fᵢ in the friction cone of a contact that holds,   |τ| <= τ_max

The six rows of the base are equalities on the wrenches f, and those of the joints bound them; the QP of least f is
solved with a certificate. Where it has no solution, rows get slacks: shares of the robot's weight (at a lever of 0.1 m
for moments) and of each joint's torque limit. The least slacks say which rows have to give, and by how much. Contacts
never pull, and the base's rows give last.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput
from wbc.models.along import placed, velocities
from wbc.models.feet import Foot
from wbc.models.pinocchio_ import PinocchioModel
from wbc.qp import QP, solve
from wbc.qp.relax import relaxed
from wbc.report.measure import spans
from wbc.stack.contact import Contact, cones
from wbc.tasks import CollisionAvoidance
from wbc.types import Flags, Mat, Status, Vec

#: Kinds of faults and the units of their amounts, beyond the limit. What causes others stands first: the forces of a
#: motion that jumps, or whose feet slip, say little.
UNITS = {
    "jump": "°", "slip": "mm", "penetration": "mm", "collision": "mm", "gap": "mm", "speed": "rad/s", "position": "rad",
    "no force": "N", "centre of pressure": "mm", "friction": "N", "torque": "N m",
}  # fmt: skip
KINDS = tuple(UNITS)
#: Those of the forces that a motion asks for, which are less where it is slower.
FORCES = frozenset(KINDS[KINDS.index("no force") :])
#: Of the base's rows the forces, and the moments over a lever [m]; how much more they count than others.
LEVER = 0.1
LEVERS = np.array([1.0, 1.0, 1.0, LEVER, LEVER, LEVER])
_BASE = 30.0
#: A slack [share] that is rounding, and the share of the forces' cost beside that of slacks.
_ROUNDING, _SHARE = 1e-3, 1e-6
#: The base's rows always give a little where others give: this slack is a hundredth of the weight.
_MISSING = 0.01 * _BASE
#: A centre of pressure is told for at least this share of the weight: without a load it is anywhere.
_LIGHT = 0.05
#: What is no fault yet: a step of one frame beyond its neighbours [rad], slip, depth, and height of what holds [m],
#: speed [rad/s] and position [rad] beyond a limit.
_JUMP, _SLIP, _DEPTH, _GAP, _SPEED, _POSITION = np.deg2rad(4.0), 5e-3, 3e-3, 10e-3, 1e-3, 1e-3
#: Steps around a jump are smaller than this share of it.
_ALONE = 0.4
#: A kind of fault, the parts it is looked for in, amounts (N, parts), and what is none yet.
_Told = tuple[str, Sequence[str], Mat, float]


class Fault(NamedTuple):
    """What is impossible in a frame: its ``kind``, the ``part`` (a joint, a contact, two links), and by how much, in
    the unit ``UNITS[kind]`` beyond the limit.

    Example:
        >>> from wbc.motion import Fault
        >>> print(Fault("torque", "left_knee", 12.34))
        torque of left_knee, 12.3 N m
    """

    kind: str
    part: str
    amount: float

    def __str__(self) -> str:
        return f"{self.kind}{f' of {self.part}' if self.part else ''}, {self.amount:.3g} {UNITS[self.kind]}"


class Verdict(NamedTuple):
    """Of a frame: the ``faults``, what causes others first; none where forces and torques for it exist, with proof.

    Example:
        >>> from wbc.motion import Fault, Verdict
        >>> Verdict().certified, Verdict((Fault("slip", "left_sole", 30.0),)).certified
        (True, False)
    """

    faults: tuple[Fault, ...] = ()

    @property
    def certified(self) -> bool:
        """Whether nothing is impossible about it."""
        return not self.faults

    def __str__(self) -> str:
        return "; ".join(map(str, self.faults)) or "certified"


def lacking(robot: PinocchioModel, state: Any, a: Vec, contacts: Sequence[Contact]) -> tuple[list[Fault], Vec]:
    """What is impossible about the acceleration a (nv,) in a state with these contacts; nothing, with proof, if [].

    Beside it the wrenches of the contacts, one behind the other, that give the acceleration or come nearest to it.
    In the air nothing can be chosen.

    Source: the conditions are those of inverse dynamics with contacts, as in Herzog et al., Autonomous Robots 2016;
    slacks of least norm as in Chinneck, Feasibility and Infeasibility in Optimization, 2008.
    """
    weight, tau_max, needed = robot.weight, robot.limits.tau_max, state.M @ a + state.h
    missing = Fault("no force", "", float(np.linalg.norm(needed[:3])))
    if not contacts:
        found = [missing] * bool(np.abs(needed[:6]).max() > _ROUNDING * weight)
        over = zip(robot.joint_names, (np.abs(needed[6:]) - tau_max).tolist(), strict=True)
        return found + [Fault("torque", joint, amount) for joint, amount in over if amount > 0.0], np.zeros(0)
    J = np.vstack([contact.rows(state).J for contact in contacts])
    n, units = len(J), weight / _BASE * LEVERS
    sizes = np.where(np.isfinite(tau_max) & (tau_max > 0.0), tau_max, 1.0)
    rows = [Fault(missing.kind, "", weight / _BASE)] * 6  # what a slack of 1 in a row means
    for frame, (label, unit) in ((one.frame, row) for one in contacts for row in one.cone_labels()):
        kind = "centre of pressure" if label.lstrip("-")[:2] in ("mx", "my") else "friction"
        rows.append(Fault(kind, frame, weight * (LEVER if unit == "N m" else 1.0)))
    rows += [Fault("torque", *one) for one in zip(robot.joint_names, sizes.tolist(), strict=True)]
    (cone, normals), limit, tau = cones(contacts, lever=LEVER), tau_max / sizes, needed[6:] / sizes
    qp = QP(
        np.eye(n) / weight**2, np.zeros(n), A=J[:, :6].T / units[:, None], b=needed[:6] / units,
        C=np.vstack([cone / weight, -J[:, 6:].T / sizes[:, None]]),
        cl=np.concatenate([np.full(len(cone), -np.inf), -limit - tau]),
        cu=np.concatenate([np.zeros(len(cone)), limit - tau]),
    )  # fmt: skip
    if (possible := solve(qp)).status is Status.SOLVED:
        return [], possible.x
    gives = np.delete(np.arange(len(qp.lower)), np.arange(6, 6 + len(contacts)))
    answer = solve(relaxed(qp, gives, share=_SHARE))
    if answer.status is not Status.SOLVED:
        return [missing], np.zeros(n)
    loads = dict(zip((contact.frame for contact in contacts), answer.x[normals].tolist(), strict=True))
    slacks, worst = np.abs(answer.x[n:]), dict[tuple[str, str], float]()
    slacks[0] = np.linalg.norm(slacks[:3])
    none = np.repeat([_MISSING, _ROUNDING], [6, len(slacks) - 6])
    for i in np.flatnonzero(slacks > np.minimum(none, 0.5 * slacks.max())):
        kind, part, amount = rows[i]
        if kind == "centre of pressure":
            amount *= 1e3 / max(loads[part], _LIGHT * weight)
        worst[kind, part] = max(worst.get((kind, part), 0.0), amount * float(slacks[i]))
    return [Fault(*what, amount) for what, amount in worst.items()], answer.x[:n]


@final
class Witness:
    """Judges motions of a robot with the ``contacts`` {part: contact} that may hold, and the friction they have.

    ``collisions``: whether shapes of the robot inside one another are looked for.

    Raises:
        InvalidInput: a robot without a floating base, or contacts that are none.
    """

    def __init__(self, robot: PinocchioModel, contacts: Mapping[str, Contact], *, collisions: bool = True) -> None:
        checks.instance("robot", robot, PinocchioModel, "a robot from wbc.load(...)")
        checks.instance("contacts", contacts, Mapping, "contacts by the names of parts")
        for part, contact in contacts.items():
            checks.instance(f"contacts[{part}]", contact, Contact, "a contact")
        if robot.nq - robot.nj != 7:
            raise InvalidInput(f"{robot.name} needs a floating base: load it with base='floating'")
        self._robot, self._contacts, self._state = robot, dict(contacts), robot.state()
        self._apart = CollisionAvoidance(margin=0.0, reach=0.02) if collisions and robot.collisions else None

    def judge(
        self, q: Mat, rate: float, holds: Mapping[str, Flags], progress: Any = lambda done: None
    ) -> tuple[Verdict, ...]:
        """A verdict for each frame of configurations q (N, nq) at ``rate`` [1/s]; ``holds`` {part: (N,)}.

        Raises:
            InvalidInput: q or a part's flags of another size, or not finite; no flags for a contact; fewer than three
                frames, a rate that is not positive.
        """
        q = checks.array("q", q, (None, self._robot.nq))
        if len(q) < 3:
            raise InvalidInput(f"q has {len(q)} frames; accelerations need three at least")
        checks.number("rate", rate, low=0.0, strict=True)
        checks.instance("holds", holds, Mapping, "flags by the names of parts")
        checks.function("progress", progress, "a function of a share")
        holds = {part: checks.array(f"holds[{part}]", holds.get(part), (len(q),)) > 0.5 for part in self._contacts}
        found: list[list[Fault]] = [[] for _ in q]
        v, a, steps = velocities(self._robot, q, rate)
        told = self._of_joints(q[:, 7:], np.abs(steps[:, 6:]), rate)
        frames = {part: contact.frame for part, contact in self._contacts.items()}
        for part, (positions, rotations) in placed(self._robot, q, frames).items():
            foot = self._robot.feet.get(frames[part], Foot(frames[part], "point", 0.0))
            told += _of_contact(frames[part], foot.lowest_in_world(positions, rotations), holds[part])
        for kind, parts, amounts, most in told:
            for k, j in np.argwhere(amounts > most):
                found[k].append(Fault(kind, parts[j], float(amounts[k, j])))
        for k, faults in enumerate(found):
            self._state.update(0.0, q[k], v[k])
            for one, other, distance in self._apart.closest(self._state)[:1] if self._apart is not None else ():
                if distance < -_DEPTH:
                    faults.append(Fault("collision", f"{one} and {other}", -1e3 * distance))
            if not faults:
                held = [contact for part, contact in self._contacts.items() if holds[part][k]]
                faults += lacking(self._robot, self._state, a[k], held)[0]
            progress((k + 1) / len(found))
        return tuple(Verdict(tuple(sorted(faults, key=lambda one: KINDS.index(one.kind)))) for faults in found)

    def _of_joints(self, joints: Mat, steps: Mat, rate: float) -> list[_Told]:
        limits, names = self._robot.limits, self._robot.joint_names
        alone, first = _alone(steps), np.zeros((1, len(names)))
        fast = np.where(alone > _JUMP, 0.0, steps * rate - limits.v_max)
        return [
            ("position", names, np.maximum(limits.q_min - joints, joints - limits.q_max), _POSITION),
            ("jump", names, np.rad2deg(np.vstack([first, alone])), np.rad2deg(_JUMP)),
            ("speed", names, np.vstack([first, fast]), _SPEED),
        ]


def _of_contact(frame: str, points: Vec, held: Flags) -> list[_Told]:
    """Depth always; slip and height while the contact holds."""
    low, high, middle = points[:, :, 2].min(axis=1), points[:, :, 2].max(axis=1), points.mean(axis=1)[:, :2]
    off = np.zeros(len(points))
    for start, stop in spans(held):
        off[start:stop] = np.linalg.norm(middle[start:stop] - np.median(middle[start:stop], axis=0), axis=1)
    of_kind = {"penetration": (-low, _DEPTH), "slip": (off, _SLIP), "gap": (np.where(held, high, 0.0), _GAP)}
    return [(kind, [frame], 1e3 * amounts[:, None], 1e3 * most) for kind, (amounts, most) in of_kind.items()]


def _alone(size: Mat) -> Mat:
    """Steps (N, nj) beyond those around them, where they resemble none of them but one that leads back; else 0."""
    around = np.pad(size, ((2, 2), (0, 0)), mode="edge")
    near = np.sort([around[1:-3], around[3:-1]], axis=0)
    far = np.maximum(around[:-4], around[4:])
    once = near[1] < _ALONE * size
    back = (near[0] < _ALONE * size) & (far < _ALONE * size)
    return np.where(once | back, size - near[0], 0.0)
