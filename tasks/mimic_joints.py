"""mimic_joints: the gears that a robot's description speaks of."""

from __future__ import annotations

from typing import Any

from wbc import checks
from wbc.arguments import tells_arguments
from wbc.errors import NotSupported
from wbc.models.pinocchio_ import PinocchioModel

from .joint_coupling import JointCoupling


@tells_arguments
def mimic_joints(robot: PinocchioModel, **settings: Any) -> list[JointCoupling]:
    """A :class:`~tasks.joint_coupling.JointCoupling` for each ``<mimic>`` of the robot's URDF; ``settings`` are each's.

    The robot moves such joints by themselves: what holds them is up to the stack. ``[c.with_reaction() for c in
    mimic_joints(robot)]`` in ``contacts`` are gears, ``[c.exactly() for c in mimic_joints(robot)]`` in ``subject_to``
    motors that do as gears would.

    Raises:
        NotSupported: a joint that mimics one that does not move. InvalidInput: with a multiplier of zero.

    Example:
        >>> import wbc
        >>> from wbc.tasks import mimic_joints
        >>> mimic_joints(wbc.load("arm"))
        []
    """
    checks.instance("robot", robot, PinocchioModel, "a robot from wbc.load(...)")
    found = []
    for joint in robot.urdf.joints:
        if joint.mimics is None or joint.name not in robot.joint_names:
            continue
        if joint.mimics not in robot.joint_names:
            raise NotSupported(f"joint {joint.name!r} mimics {joint.mimics!r}, which is no joint that moves")
        ratios = {joint.mimics: joint.mimic_ratio}
        found.append(JointCoupling(joint.name, to=ratios, offset=joint.mimic_offset, **settings))
    return found
