"""SupportPolygon: keeps the centre of mass above a convex region of the ground."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Self, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput, NotSupported, UnknownFrame
from wbc.models.model import RobotModel
from wbc.models.pinocchio_ import PinocchioModel
from wbc.stack.kernel_members import KernelBarrier
from wbc.stack.kernel_rows import CENTRE, KernelRows
from wbc.types import Mat


@final
class SupportPolygon(KernelBarrier):
    """h_i = n_i·c − offset_i − margin >= 0 [m]: the centre of mass c, seen from above, inside the hull of ``points``.

    ``points`` (k, 2) or (k, 3) in the world [m], k >= 3, in any order; n_i are the inward normals of the edges of their
    convex hull. ``margin`` [m] is the distance that is kept from every edge.

    Raises:
        InvalidInput: points that span no area, a margin that leaves none; when a stack is compiled, a robot without
            mass.

    Example:
        >>> import wbc
        >>> from wbc.tasks import SupportPolygon
        >>> robot = wbc.load("quadruped", base="floating")
        >>> SupportPolygon.under(robot, margin=0.02).dim
        4
    """

    units = "m"

    read_once = frozenset({"margin"})

    def __init__(
        self, points: Any, *, margin: float = 0.0, rate: float = 10.0, slack: float | None = 1e6,
        name: str | None = None,
    ) -> None:  # fmt: skip
        super().__init__(rate=rate, slack=slack, name=name)
        corners = checks.array(f"{self.name}.points", points, (None, None))
        if corners.shape[1] not in (2, 3) or len(corners) < 3:
            raise InvalidInput(f"{self.name}.points must have shape (k, 2) or (k, 3), k >= 3, not {corners.shape}")
        self.margin = checks.number(f"{self.name}.margin", margin, low=0.0)
        self._normals, self._offsets = _edges(self.name, corners[:, :2])
        self._offsets += self.margin
        self.dim = len(self._normals)
        if not _has_room(self._normals, self._offsets):
            raise InvalidInput(f"{self.name}: a margin of {self.margin:g} m leaves nothing of the polygon")

    @classmethod
    def under(cls, robot: RobotModel, frames: Iterable[str] | None = None, **settings: Any) -> Self:
        """The polygon of the feet, or of the feet called ``frames``, where the reference configuration has them.

        Raises:
            NotSupported: the robot's description knows no feet. UnknownFrame: no such foot. InvalidInput: no robot.
        """
        robot = checks.instance("robot", robot, RobotModel, "a robot from wbc.load(...)")
        if not isinstance(robot, PinocchioModel) or not robot.feet:
            raise NotSupported(f"nothing is known about the feet of {robot.name}; give the points of the polygon")
        state, corners = robot.state(), []
        for name in robot.feet if frames is None else checks.names("frames", frames):
            if name not in robot.feet:
                raise UnknownFrame(name, robot.feet)
            placement = state.frame(name).placement
            corners += [placement.act(np.array(point)) for point, _ in robot.feet[name].lowest()]
        return cls(np.array(corners), **settings)

    def kernel_rows(self) -> KernelRows:
        numbers = np.column_stack([self._normals, np.zeros(self.dim), self._offsets])
        return KernelRows("wbc.tasks.compiled.limit:half_spaces", (CENTRE,), numbers.ravel())

    def label(self, row: int) -> str:
        return f"edge {row}"

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        return [cls([[0.3, 0.2], [-0.3, 0.2], [0.0, -0.4], [0.0, 0.1]], margin=0.01)]


def _edges(name: str, points: Mat) -> tuple[Any, Any]:
    """Inward unit normals (m, 2) and offsets (m,) of the edges of the convex hull."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(points)
    except QhullError:
        raise InvalidInput(f"{name}.points span no area") from None
    equations = np.unique(hull.equations.round(12), axis=0)
    return -equations[:, :2], equations[:, 2].copy()


def _has_room(normals: Mat, offsets: Any) -> bool:
    """Whether some point is on the inner side of every edge."""
    from scipy.optimize import linprog

    found = linprog([0.0, 0.0], A_ub=-normals, b_ub=-offsets, bounds=(None, None), method="highs")
    return bool(found.success)
