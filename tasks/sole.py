"""Sole: a flat rectangle in contact, as one wrench with its exact cone."""

from __future__ import annotations

from functools import cached_property
from typing import Any, Self, final

import numpy as np
import pinocchio

from wbc import checks
from wbc.errors import InvalidInput
from wbc.friction import wrench_facets
from wbc.models import plausible
from wbc.models.model import RobotModel, RobotState
from wbc.stack.contact import Anchor
from wbc.stack.kernel_members import KernelContact
from wbc.stack.kernel_rows import KernelRows
from wbc.types import Mat


@final
class Sole(KernelContact):
    """Six rows and a wrench f = (fx, fy, fz, mx, my, mz) [N, N m] about the rectangle's centre, in the frame's axes.

    ``half_size`` = (X, Y) [m] along the frame's x and y; its z is the normal, away from the ground. ``origin`` (3,) is
    the centre of the rectangle in the frame. e = log6(actual⁻¹ anchor), J and J̇ v are the body twist's, moved there.

    The rows of the cone are exactly the wrenches that friction pyramids at the four corners can add up to. With 4 sides
    these are 16, with µ = ``pyramid.mu``: |fx|, |fy| <= µ fz; |mx| <= Y fz; |my| <= X fz; and mz between ∓µ (X + Y) fz
    ± (|Y fx ∓ µ mx| + |X fy ∓ µ my|) (Caron, Pham, Nakamura, ICRA 2015). With 8 sides they are 60 to 90, the facets of
    the hull of the 32 wrenches along the pyramids' edges. They imply fz >= 0. Other arguments:
    :class:`~wbc.stack.contact.Contact`.

    Raises:
        InvalidInput: sizes that are not positive. UnknownFrame: when a stack is compiled.

    Example:
        >>> from wbc.tasks import Sole
        >>> Sole("left_sole", half_size=(0.10, 0.065), friction=0.3).cone().shape
        (16, 6)
    """

    dim = 6
    read_once = frozenset({"half_size", "origin"})

    def __init__(
        self, frame: str, *, half_size: Any, friction: float, origin: Any = (0.0, 0.0, 0.0),
        friction_model: str = "inner", sides: int = 4, kp: float = 100.0, kd: float | None = None,
        force_weight: float = 1e-6, f_min: float | None = None, f_max: float | None = None, target: Any = None,
        name: str | None = None,
    ) -> None:  # fmt: skip
        super().__init__(
            frame, friction=friction, friction_model=friction_model, sides=sides, kp=kp, kd=kd,
            force_weight=force_weight, f_min=f_min, f_max=f_max, target=target, name=name,
        )  # fmt: skip
        self.half_size = checks.array(f"{self.name}.half_size", half_size, (2,))
        if (self.half_size <= 0).any():
            raise InvalidInput(f"{self.name}.half_size is {tuple(self.half_size.tolist())}; both must be > 0 [m]")
        plausible.extent(f"{self.name}.half_size", self.half_size)
        self.origin = checks.array(f"{self.name}.origin", origin, (3,))
        self._origin = pinocchio.SE3(np.eye(3), self.origin)

    def anchor(self, state: RobotState) -> Anchor:
        pose = state.pose(self.frame) * self._origin
        return Anchor(pose.rotation, pose.translation)

    def kernel_rows(self) -> KernelRows:
        return KernelRows("wbc.tasks.compiled.frame:sole", (self.frame,), self.origin)

    @cached_property
    def _facets(self) -> Mat:
        """The cone for pyramids of any number of sides."""
        mu, (X, Y), forces = self.pyramid.mu, self.half_size, self.pyramid.edges
        corners = [[i * X, j * Y, 0.0] for i in (1.0, -1.0) for j in (1.0, -1.0)]
        wrenches = np.vstack([np.hstack([forces, np.cross(corner, forces)]) for corner in corners])
        return wrench_facets(wrenches, 2, (mu, mu, 1.0, Y, X, mu * (X + Y)))

    def cone(self) -> Mat:
        if self.sides > 4:
            return self._facets.copy()
        mu, (X, Y) = self.pyramid.mu, self.half_size
        rows = [[s, 0, -mu, 0, 0, 0] for s in (1, -1)] + [[0, s, -mu, 0, 0, 0] for s in (1, -1)]
        rows += [[0, 0, -Y, s, 0, 0] for s in (1, -1)] + [[0, 0, -X, 0, s, 0] for s in (1, -1)]
        for turn in (1, -1):
            rows += [
                [i * Y, j * X, -mu * (X + Y), turn * i * mu, turn * j * mu, turn] for i in (1, -1) for j in (1, -1)
            ]
        return np.array(rows, dtype=np.float64)

    def cone_labels(self) -> list[tuple[str, str]]:
        if self.sides > 4:
            return [(f"facet {i}", "N") for i in range(len(self._facets))]
        labels = [(f"{force} <= mu fz", "N") for force in ("fx", "-fx", "fy", "-fy")]
        labels += [(moment, "N m") for moment in ("mx <= Y fz", "-mx <= Y fz", "my <= X fz", "-my <= X fz")]
        corners = [f"fx {'+-'[i]} fy {'+-'[j]}" for i in (0, 1) for j in (0, 1)]
        return labels + [(f"{turn} <= yaw limit ({corner})", "N m") for turn in ("mz", "-mz") for corner in corners]

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        frame = model.frame_names[-1]
        moved = cls(
            frame,
            half_size=(0.1, 0.05),
            friction=0.8,
            f_min=2.0,
            f_max=900.0,
            friction_model="outer",
            origin=(0.02, 0.01, -0.03),
        )
        round_ = cls(frame, half_size=(0.08, 0.08), friction=0.5, sides=8)
        return [cls(frame, half_size=(0.1, 0.065), friction=0.3), moved, round_]
