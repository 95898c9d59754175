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
from scipy.linalg import block_diag

from wbc.models.pinocchio_ import PinocchioModel
from wbc.motion.verdict import Fault
from wbc.qp import QP, solve
from wbc.qp.relax import relaxed
from wbc.stack.contact import Contact
from wbc.types import Index, Mat, Status, Vec

#: Of the base's rows the forces, and the moments over a lever [m]; how much more they count than others.
LEVERS = np.array([1.0, 1.0, 1.0, 0.1, 0.1, 0.1])
_BASE = 30.0
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


def weight_of(robot: PinocchioModel) -> float:
    """The robot's weight [N]."""
    return float(robot.mass * np.linalg.norm(robot.gravity))


def cones(contacts: Sequence[Contact]) -> tuple[Mat, Index]:
    """K (m, n) with K f <= 0 for the wrenches f (n,) of contacts, one behind the other, in rows of force, those of
    moments over a lever of 0.1 m; and which of f are the normal forces."""
    lever = {"N": 1.0, "N m": LEVERS[-1]}
    scaled = [contact.cone() / [[lever[unit]] for _, unit in contact.cone_labels()] for contact in contacts]
    return block_diag(*scaled), np.cumsum([0, *(contact.dim for contact in contacts[:-1])]) + 2


def lacking(robot: PinocchioModel, state: Any, a: Vec, contacts: Sequence[Contact]) -> tuple[list[Fault], Vec]:
    """What is impossible about the acceleration a (nv,) in a state with these contacts; nothing, with proof, if [].

    Beside it the wrenches of the contacts, one behind the other, that give the acceleration or come nearest to it.
    In the air nothing can be chosen.

    Source: the conditions are those of inverse dynamics with contacts, as in Herzog et al., Autonomous Robots 2016;
    slacks of least norm as in Chinneck, Feasibility and Infeasibility in Optimization, 2008.
    """
    weight, tau_max, needed = weight_of(robot), robot.limits.tau_max, state.M @ a + state.h
    missing = Fault("no force", "", float(np.linalg.norm(needed[:3])))
    if not contacts:
        found = [missing] * bool(np.abs(needed[:6]).max() > _ROUNDING * weight)
        over = zip(robot.joint_names, (np.abs(needed[6:]) - tau_max).tolist(), strict=True)
        return found + [Fault("torque", joint, amount) for joint, amount in over if amount > 0.0], np.zeros(0)
    J = np.vstack([contact.rows(state).J for contact in contacts])
    n, units = len(J), weight / _BASE * LEVERS
    sizes = np.where(np.isfinite(tau_max) & (tau_max > 0.0), tau_max, 1.0)
    rows = [_Row(missing.kind, "", weight / _BASE)] * 6
    for contact in contacts:
        for label, unit in contact.cone_labels():
            kind = "centre of pressure" if label.lstrip("-")[:2] in ("mx", "my") else "friction"
            rows.append(_Row(kind, contact.frame, weight * (float(LEVERS[-1]) if unit == "N m" else 1.0)))
    rows += [_Row("torque", joint, size) for joint, size in zip(robot.joint_names, sizes.tolist(), strict=True)]
    cone, normals = cones(contacts)
    push = -np.eye(n)[normals]
    limit, tau = tau_max / sizes, needed[6:] / sizes
    qp = QP(
        np.eye(n) / weight**2, np.zeros(n), A=J[:, :6].T / units[:, None], b=needed[:6] / units,
        C=np.vstack([cone / weight, -J[:, 6:].T / sizes[:, None], push / weight]),
        cl=np.concatenate([np.full(len(cone), -np.inf), -limit - tau, np.full(len(push), -np.inf)]),
        cu=np.concatenate([np.zeros(len(cone)), limit - tau, np.zeros(len(push))]),
    )  # fmt: skip
    if (possible := solve(qp)).status is Status.SOLVED:
        return [], possible.x
    answer = solve(relaxed(qp, range(len(rows)), share=_SHARE))
    if answer.status is not Status.SOLVED:
        return [missing], np.zeros(n)
    loads = dict(zip((contact.frame for contact in contacts), answer.x[normals].tolist(), strict=True))
    worst: dict[tuple[str, str], float] = {}
    slacks = np.abs(answer.x[n:])
    slacks[0] = np.linalg.norm(slacks[:3])
    some = slacks > min(_ROUNDING, 0.5 * float(slacks.max()))
    some[:6] = slacks[:6] > min(_MISSING, 0.5 * float(slacks.max()))
    for row, slack in ((rows[i], float(slacks[i])) for i in np.flatnonzero(some)):
        amount = slack * row.size
        if row.kind == "centre of pressure":
            amount *= 1e3 / max(loads[row.part], _LIGHT * weight)
        worst[row.kind, row.part] = max(worst.get((row.kind, row.part), 0.0), amount)
    return [Fault(kind, part, amount) for (kind, part), amount in worst.items()], answer.x[:n]
