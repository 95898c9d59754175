"""Welds: frames of one robot that something rigid joins, such as a bar in two hands, and the force in it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from wbc.errors import NotSupported, UnknownFrame
from wbc.models.pinocchio_ import PinocchioModel
from wbc.sim.engine import PhysicsSettings, mujoco
from wbc.stack.contact import Contact
from wbc.types import Mat, Vec


@final
@dataclass(frozen=True, eq=False)
class Weld:
    """``link`` keeps the pose ``rotation`` (3, 3), ``position`` (3,) in ``carrier``; what joins them weighs nothing."""

    name: str
    link: str
    carrier: str
    rotation: Mat
    position: Vec


def welds(contacts: Iterable[Contact], robot: PinocchioModel) -> list[Weld]:
    """The contacts that join two frames of the robot, as they are at its reference, or at their targets.

    Raises:
        NotSupported: a joint that holds less than all six directions.
    """
    state = robot.state()
    found = []
    for contact in contacts:
        if contact.carrier is None:
            continue
        if contact.dim != 6:
            raise NotSupported(f"{contact.name} holds {contact.dim} of 6 directions: physics can only weld")
        pose = contact.target or contact.anchor(state)
        found.append(
            Weld(contact.name, contact.frame, contact.carrier, np.array(pose.rotation), np.array(pose.position))
        )
    return found


def add_welds(spec: Any, joined: Iterable[Weld], settings: PhysicsSettings) -> None:
    """Write them into a ``mujoco.MjSpec``.

    Raises:
        UnknownFrame: a frame that is not a link.
    """
    mj = mujoco()
    for weld in joined:
        for link in (weld.link, weld.carrier):
            if spec.body(link) is None:
                raise UnknownFrame(link, [body.name for body in spec.bodies[1:]], "a weld joins links")
        quaternion = np.zeros(4)
        mj.mju_mat2Quat(quaternion, weld.rotation.T.ravel())
        # The point that is held, the link's origin, in the carrier and in the link; the carrier's axes in the link.
        data = np.zeros(mj.mjNEQDATA)
        data[:11] = [*weld.position, 0.0, 0.0, 0.0, *quaternion, 1.0]
        spec.add_equality(
            name=weld.name, type=mj.mjtEq.mjEQ_WELD, objtype=mj.mjtObj.mjOBJ_BODY, name1=weld.link, name2=weld.carrier,
            data=data, solref=list(settings.solref), solimp=list(settings.solimp),
        )  # fmt: skip


def weld_forces(physics: Any, data: Any, joined: Sequence[Weld]) -> dict[str, Vec]:
    """Force (3,) [N] of the carrier on each link, in the carrier's axes, in the last step."""
    mj, forces = mujoco(), {}
    of_equality = data.efc_type == mj.mjtConstraint.mjCNSTR_EQUALITY
    for weld in joined:
        index = mj.mj_name2id(physics, mj.mjtObj.mjOBJ_EQUALITY, weld.name)
        carrier = mj.mj_name2id(physics, mj.mjtObj.mjOBJ_BODY, weld.carrier)
        rows = np.flatnonzero(of_equality & (data.efc_id == index))[:3]  # three of the position, three of the rotation
        force = data.efc_force[rows] if len(rows) else np.zeros(3)
        forces[weld.name] = data.xmat[carrier].reshape(3, 3).T @ force
    return forces
