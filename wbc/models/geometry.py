"""Shapes of a robot: primitive shapes and meshes fixed to its links."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np

from wbc.types import Mat, Vec

Triple = tuple[float, float, float]
Color = tuple[float, float, float, float]


def triple(values: Any) -> Triple:
    """Three numbers as a tuple of floats."""
    x, y, z = map(float, values)
    return x, y, z


@final
@dataclass(frozen=True)
class Origin:
    """A pose as URDF writes it: ``xyz`` [m] and fixed-axis roll, pitch, yaw ``rpy`` [rad], in the parent's frame."""

    xyz: Triple = (0.0, 0.0, 0.0)
    rpy: Triple = (0.0, 0.0, 0.0)

    @classmethod
    def of(cls, position: Any, R: Mat) -> Origin:
        """The pose of a rotation R = Rz Ry Rx (3, 3): roll is what is left without yaw, at a pitch of ±π/2 too."""
        import pinocchio as pin

        return cls(triple(position), triple(pin.rpy.matrixToRpy(R)))

    @property
    def rotation(self) -> Mat:
        """Rz(yaw) Ry(pitch) Rx(roll), (3, 3)."""
        import pinocchio as pin

        return np.asarray(pin.rpy.rpyToMatrix(np.array(self.rpy)), dtype=np.float64)

    @property
    def matrix(self) -> Mat:
        """The homogeneous transform (4, 4) from these coordinates to the parent's."""
        result = np.eye(4)
        result[:3, :3] = self.rotation
        result[:3, 3] = self.xyz
        return result


#: No offset.
IDENTITY = Origin()


@final
@dataclass(frozen=True)
class Box:
    """A box with edges ``size`` [m] along x, y, z, centred."""

    size: Triple


@final
@dataclass(frozen=True)
class Sphere:
    """A ball of ``radius`` [m], centred."""

    radius: float


@final
@dataclass(frozen=True)
class Cylinder:
    """A cylinder of ``radius`` and ``length`` [m] along z, centred."""

    radius: float
    length: float


@final
@dataclass(frozen=True)
class Mesh:
    """A mesh file, each axis multiplied by ``scale``. The file exists and lies in the folders the model may read."""

    path: Path
    scale: Triple = (1.0, 1.0, 1.0)


Shape = Box | Sphere | Cylinder | Mesh


def capsule(radius: float, length: float) -> list[tuple[Shape, Vec]]:
    """A cylinder along z with a ball at each end: its parts and where they are."""
    ends: list[tuple[Shape, Vec]] = [(Sphere(radius), np.array([0.0, 0.0, z])) for z in (-length / 2, length / 2)]
    return [(Cylinder(radius, length), np.zeros(3)), *ends]


def lengths(shape: Shape) -> list[float]:
    """What the size of a shape is made of, beside the numbers in a mesh file."""
    sizes = [value for key, value in vars(shape).items() if key != "path"]
    return [float(x) for x in np.hstack(sizes)]


@final
@dataclass(frozen=True)
class Geometry:
    """A shape fixed to a link at ``origin``; ``color`` is red, green, blue, opacity in 0…1, None if not said."""

    link: str
    shape: Shape
    origin: Origin = IDENTITY
    color: Color | None = None
