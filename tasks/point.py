"""Point: a contact in one point, or of a ball-shaped foot."""

from __future__ import annotations

from typing import Any, Self, final

import numpy as np

from wbc import checks
from wbc.models import plausible
from wbc.models.model import RobotModel, RobotState
from wbc.stack.contact import Anchor
from wbc.stack.kernel_members import KernelContact
from wbc.stack.kernel_rows import KernelRows
from wbc.stack.tracking import rotation_target
from wbc.types import Mat


@final
class Point(KernelContact):
    """Three rows and a force f = (fx, fy, fz) [N] in the axes of a surface that stays where it is, z its normal.

    J v is the velocity of the material point p − radius·n, where p is the frame's origin and n the normal:
    Rᵀ (J_linear − [o]ₓ J_angular) with o = −radius·n. A ball rolls, so where it touches is not fixed along the surface:
    with a radius only the normal row has an error e, the others hold their velocity at zero. ``axes`` (3, 3) are the
    surface's in the world, columns x y z (default: level ground). The friction pyramid implies fz >= 0. Other
    arguments: :class:`~wbc.stack.contact.Contact`.

    Raises:
        InvalidInput: axes that are no rotation, a negative radius. UnknownFrame: when a stack is compiled.

    Example:
        >>> from wbc.tasks import Point
        >>> Point("foot", friction=0.5, radius=0.02, friction_model="outer").cone()
        array([[ 1. ,  0. , -0.5],
               [-1. ,  0. , -0.5],
               [ 0. ,  1. , -0.5],
               [ 0. , -1. , -0.5]])
    """

    dim = 3
    read_once = frozenset({"axes", "radius"})

    def __init__(
        self, frame: str, *, friction: float, radius: float = 0.0, axes: Any = None, friction_model: str = "inner",
        sides: int = 4, kp: float = 100.0, kd: float | None = None, force_weight: float = 1e-6,
        f_min: float | None = None, f_max: float | None = None, target: Any = None, name: str | None = None,
    ) -> None:  # fmt: skip
        super().__init__(
            frame, friction=friction, friction_model=friction_model, sides=sides, kp=kp, kd=kd,
            force_weight=force_weight, f_min=f_min, f_max=f_max, target=target, name=name,
        )  # fmt: skip
        self.radius = checks.number(f"{self.name}.radius", radius, low=0.0)
        plausible.extent(f"{self.name}.radius", self.radius)
        self.axes = np.eye(3) if axes is None else rotation_target(f"{self.name}.axes", axes, True)
        self._offset = -self.radius * self.axes[:, 2]

    def anchor(self, state: RobotState) -> Anchor:
        return Anchor(self.axes, state.pose(self.frame).translation + self._offset)

    def kernel_rows(self) -> KernelRows:
        held = [self.radius == 0.0, self.radius == 0.0, True]
        return KernelRows("wbc.tasks.compiled.frame:point", (self.frame,), [*self.axes.T.ravel(), *self._offset, *held])

    def cone(self) -> Mat:
        return self.pyramid.rows

    def cone_labels(self) -> list[tuple[str, str]]:
        return [(f"{force} <= mu fz", "N") for force in self.pyramid.names]

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        frame, half = model.frame_names[-1], np.sqrt(0.5)
        slope = [[half, 0.0, half], [0.0, 1.0, 0.0], [-half, 0.0, half]]
        return [
            cls(frame, friction=0.5), cls(frame, friction=0.8, axes=slope, friction_model="outer"),
            cls(frame, friction=0.5, radius=0.02, sides=8), cls(frame, friction=0.5, radius=0.05, axes=slope),
        ]  # fmt: skip
