"""Forces: whether contact wrenches and joint torques exist that move a robot as asked, and if not, what lacks.

    M a + h = Sᵀ τ + Σ Jᵢᵀ fᵢ,   fᵢ in the friction cone of a contact that holds,   |τ| <= τ_max

The six rows of the base are equalities on the wrenches f, and those of the joints bound them; the QP of least f is
solved with a certificate. Where it has no solution, rows get slacks: shares of the robot's weight (at a lever of 0.1 m
for moments) and of each joint's torque limit. The least slacks say which rows have to give, and by how much. Contacts
never pull, and the base's rows give last.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pinocchio

from wbc.models.pinocchio_ import PinocchioModel
from wbc.motion.verdict import Fault
from wbc.qp import QP, solve
from wbc.qp.relax import relaxed
from wbc.stack.contact import Contact
from wbc.types import Mat, Status, Vec

#: Lever of moments in the weight of their rows [m], and how much more the base's rows count than others.
_LEVER, _BASE = 0.1, 30.0
#: A slack [share] that is rounding, and the share of the forces' cost beside that of slacks.
_ROUNDING, _SHARE = 1e-3, 1e-6
#: The base's rows always give a little where others give: this slack is a hundredth of the weight.
_MISSING = 0.01 * _BASE
#: A centre of pressure is told for at least this share of the weight: without a load it is anywhere.
_LIGHT = 0.05


class _Row(NamedTuple):
    """What a slack in a row means: the fault's kind and part, and its amount where the slack is 1."""

    kind: str
    part: str
    size: float


def lacking(robot: PinocchioModel, state: Any, a: Vec, contacts: Sequence[Contact]) -> tuple[list[Fault], Vec]:
    """What is impossible about the acceleration a (nv,) in a state with these contacts; nothing, with proof, if [].

    Beside it the wrenches of the contacts, one behind the other, that give the acceleration or come nearest to it.

    Source: the conditions are those of inverse dynamics with contacts, as in Herzog et al., Autonomous Robots 2016;
    slacks of least norm as in Chinneck, Feasibility and Infeasibility in Optimization, 2008.
    """
    weight = float(robot.mass * np.linalg.norm(robot.gravity))
    needed = state.M @ a + state.h
    J = np.vstack([*(wrench_map(state, contact) for contact in contacts), np.zeros((0, robot.nv))])
    n, at = len(J), 0
    units = weight / _BASE * np.array([1.0, 1.0, 1.0, _LEVER, _LEVER, _LEVER])
    rows = [_Row("no force", "", weight / _BASE)] * 6
    tau_max = robot.limits.tau_max
    sizes = np.where(np.isfinite(tau_max) & (tau_max > 0.0), tau_max, 1.0)
    C: list[Mat] = []
    high: list[Vec] = []
    normals: dict[str, int] = {}
    for contact in contacts:
        block = np.zeros((len(contact.cone_labels()), n))
        block[:, at : at + contact.dim] = contact.cone()
        for i, (label, unit) in enumerate(contact.cone_labels()):
            size = weight * (_LEVER if unit == "N m" else 1.0)
            tips = label.lstrip("-")[:2] in ("mx", "my")
            rows.append(_Row("centre of pressure" if tips else "friction", contact.frame, size))
            block[i] /= size
        normals[contact.frame] = at + 2
        at += contact.dim
        C.append(block)
        high.append(np.zeros(len(block)))
    push = np.zeros((len(contacts), n))
    push[np.arange(len(contacts)), list(normals.values())] = -1.0 / weight
    rows += [_Row("torque", joint, size) for joint, size in zip(robot.joint_names, sizes.tolist(), strict=True)]
    limit, tau = tau_max / sizes, needed[6:] / sizes
    m = sum(map(len, C))
    qp = QP(
        np.eye(n) / weight**2, np.zeros(n), A=J[:, :6].T / units[:, None], b=needed[:6] / units,
        C=np.vstack([*C, -J[:, 6:].T / sizes[:, None], push]),
        cl=np.concatenate([np.full(m, -np.inf), -limit - tau, np.full(len(push), -np.inf)]),
        cu=np.concatenate([*high, limit - tau, np.zeros(len(push))]),
    )  # fmt: skip
    if (possible := solve(qp)).status is Status.SOLVED:
        return [], possible.x
    answer = solve(relaxed(qp, range(len(rows)), share=_SHARE))
    if answer.status is not Status.SOLVED:
        return [Fault("no force", "", float(np.linalg.norm(needed[:3])))], np.zeros(n)
    worst: dict[tuple[str, str], float] = {}
    slacks = np.abs(answer.x[n:])
    slacks[0] = np.linalg.norm(slacks[:3])
    some = slacks > min(_ROUNDING, 0.5 * float(slacks.max()))
    some[:6] = slacks[:6] > min(_MISSING, 0.5 * float(slacks.max()))
    for row, slack, counts in zip(rows, slacks.tolist(), some.tolist(), strict=True):
        if counts:
            amount = slack * row.size
            if row.kind == "centre of pressure":
                amount *= 1e3 / max(float(answer.x[normals[row.part]]), _LIGHT * weight)
            worst[row.kind, row.part] = max(worst.get((row.kind, row.part), 0.0), amount)
    return [Fault(kind, part, amount) for (kind, part), amount in worst.items()], answer.x[:n]


def without_contact(robot: PinocchioModel, state: Any, a: Vec) -> list[Fault]:
    """The same in the air, where nothing can be chosen."""
    weight = float(robot.mass * np.linalg.norm(robot.gravity))
    needed = state.M @ a + state.h
    found = []
    if np.abs(needed[:6]).max() > _ROUNDING * weight:
        found.append(Fault("no force", "", float(np.linalg.norm(needed[:3]))))
    over = np.abs(needed[6:]) - robot.limits.tau_max
    return found + [Fault("torque", robot.joint_names[j], float(over[j])) for j in np.flatnonzero(over > 0.0)]


def wrench_map(state: Any, contact: Contact) -> Mat:
    """J (dim, nv): Jᵀ f is the generalised force of the contact's wrench, about its point and in its axes."""
    frame = state.frame(contact.frame)
    axes = frame.rotation if contact.dim == 6 else np.eye(3)
    arm = frame.rotation @ np.asarray(getattr(contact, "origin", np.zeros(3)))
    J = frame.jacobian()
    linear = J[:3] - pinocchio.skew(arm) @ J[3:]
    return np.vstack([axes.T @ linear, axes.T @ J[3:]])[: contact.dim]
