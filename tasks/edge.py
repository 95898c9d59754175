"""Edge: contact along a line, as of a foot that tips over its toe."""

from __future__ import annotations

from itertools import product
from typing import Any, Self, final

import numpy as np
import pinocchio

from wbc import checks
from wbc.errors import InvalidInput
from wbc.models import plausible
from wbc.models.model import RobotModel, RobotState
from wbc.stack.contact import Anchor
from wbc.stack.kernel_members import KernelContact
from wbc.stack.kernel_rows import KernelRows
from wbc.types import Mat, Vec


@final
class Edge(KernelContact):
    """Five rows and a wrench f = (fx, fy, fz, my, mz) [N, N m] about the middle of a straight edge: it turns about
    itself freely, so it gives no moment mx. Axes stay as they were when the contact was made: x along the edge, z the
    ``normal`` of the surface (world, away from the ground), as nearly as it is square to the edge.

    ``half_length`` L [m]; in the frame, ``origin`` (3,) is the middle of the edge and ``direction`` (3,) goes along it.
    e is the way back (3,) and the small turn back, d × x about y and z, with d the edge's direction now.

    The rows of the cone are exactly what friction pyramids at both ends add up to. Twice the force at an end is
    z = fz ∓ my / L along the normal and y = fy ± mz / L across the edge, and fx may be shared in any way, so |y| <= µ z
    at both ends, and ±fx <= ½ Σ (µ z − n_y y) / n_x over the ends, with each side n of the pyramid, n_x > 0, at either:
    6 rows for pyramids of 4 sides, 22 for 8, with µ = ``pyramid.mu``. They imply |my| <= L fz. Other arguments:
    :class:`~wbc.stack.contact.Contact`.

    Raises:
        InvalidInput: a length that is not positive, a direction or normal of length 0. UnknownFrame: when a stack is
            compiled.

    Example:
        >>> from wbc.tasks import Edge
        >>> toe = Edge("left_sole", half_length=0.05, origin=(0.11, 0.0, 0.0), friction=0.5)
        >>> toe.cone().shape
        (6, 5)
    """

    dim = 5
    read_once = frozenset({"direction", "half_length", "normal", "origin"})

    def __init__(
        self, frame: str, *, half_length: float, friction: float, origin: Any = (0.0, 0.0, 0.0),
        direction: Any = (0.0, 1.0, 0.0), normal: Any = (0.0, 0.0, 1.0), friction_model: str = "inner", sides: int = 4,
        kp: float = 100.0, kd: float | None = None, force_weight: float = 1e-6, f_min: float | None = None,
        f_max: float | None = None, target: Any = None, name: str | None = None,
    ) -> None:  # fmt: skip
        super().__init__(
            frame, friction=friction, friction_model=friction_model, sides=sides, kp=kp, kd=kd,
            force_weight=force_weight, f_min=f_min, f_max=f_max, target=target, name=name,
        )  # fmt: skip
        self.half_length = checks.number(f"{self.name}.half_length", half_length, low=0.0, strict=True)
        plausible.extent(f"{self.name}.half_length", self.half_length)
        self.origin = checks.array(f"{self.name}.origin", origin, (3,))
        self.direction, self.normal = self._unit("direction", direction), self._unit("normal", normal)
        self._origin = pinocchio.SE3(np.eye(3), self.origin)

    def _unit(self, what: str, value: Any) -> Vec:
        vector = checks.array(f"{self.name}.{what}", value, (3,))
        length = float(np.linalg.norm(vector))
        if length == 0.0:
            raise InvalidInput(f"{self.name}.{what} is (0, 0, 0), which points nowhere")
        return vector / length

    @property
    def wrench_axes(self) -> tuple[int, ...]:
        """All but the moment about the edge."""
        return (0, 1, 2, 4, 5)

    def anchor(self, state: RobotState) -> Anchor:
        pose = state.pose(self.frame) * self._origin
        x: Vec = pose.rotation @ self.direction
        y = np.cross(self.normal, x)
        if np.linalg.norm(y) < 1e-6:  # an edge that stands upright has no side: any will do
            y = np.cross(np.roll(self.normal, 1), x)
        y /= np.linalg.norm(y)
        return Anchor(np.column_stack([x, y, np.cross(x, y)]), pose.translation)

    def kernel_rows(self) -> KernelRows:
        return KernelRows("wbc.tasks.compiled.frame:edge", (self.frame,), [*self.origin, *self.direction])

    def cone(self) -> Mat:
        mu, L = self.pyramid.mu, self.half_length
        # Twice the normal force and twice the force across the edge, at the positive and at the negative end.
        pressing = [np.array([0.0, 0.0, 1.0, -end / L, 0.0]) for end in (1, -1)]
        across = [np.array([0.0, 1.0, 0.0, 0.0, end / L]) for end in (1, -1)]
        along = [normal for normal in self.pyramid.normals if normal[0] > 0.0]
        most = [[(mu * z - n[1] * y) / n[0] for n in along] for z, y in zip(pressing, across, strict=True)]
        rows = [
            [s, 0.0, 0.0, 0.0, 0.0] - 0.5 * (positive + negative)
            for s in (1.0, -1.0) for positive, negative in product(*most)
        ]  # fmt: skip
        for z, y in zip(pressing, across, strict=True):
            rows += [L * (s * y - mu * z) for s in (1.0, -1.0)]
        return np.array(rows)

    def cone_labels(self) -> list[tuple[str, str]]:
        along = [name for name, normal in zip(self.pyramid.names, self.pyramid.normals, strict=True) if normal[0] > 0.0]
        if len(along) == 1:
            labels = [(f"{force} <= mu fz", "N") for force in ("fx", "-fx")]
        else:
            labels = [
                (f"{force} by {first} and {second}", "N") for force in ("fx", "-fx")
                for first, second in product(along, repeat=2)
            ]  # fmt: skip
        ends = [f"{side} <= mu fz at the {end} end" for end in ("positive", "negative") for side in ("fy", "-fy")]
        return labels + [(label, "N m") for label in ends]

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        frame = model.frame_names[-1]
        slope = (np.sqrt(0.5), 0.0, np.sqrt(0.5))
        moved = cls(
            frame, half_length=0.2, friction=0.8, friction_model="outer", origin=(0.1, 0.02, -0.03), normal=slope
        )
        return [
            cls(frame, half_length=0.05, friction=0.5),
            cls(frame, half_length=1.0, friction=0.4, direction=(1, 2, 0), sides=8),
            moved,
        ]
