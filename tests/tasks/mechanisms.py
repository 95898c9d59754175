"""Small mechanisms that are no trees, or have wheels: as URDF text."""

from __future__ import annotations

from pathlib import Path

import wbc
from wbc.models.pinocchio_ import PinocchioModel

_LINK = """
  <link name="{name}"><inertial><origin xyz="{center} 0 0"/><mass value="{mass}"/>
    <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>"""
_JOINT = """
  <joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
    <origin xyz="{origin}"/><axis xyz="{axis}"/>
    <limit lower="-3.1" upper="3.1" velocity="10" effort="100"/></joint>"""


def _link(name: str, center: float = 0.0, mass: float = 1.0) -> str:
    return _LINK.format(name=name, center=center, mass=mass)


def _joint(name: str, parent: str, child: str, origin: str, *, kind: str = "revolute", axis: str = "0 1 0") -> str:
    return _JOINT.format(name=name, parent=parent, child=child, origin=origin, kind=kind, axis=axis)


def _load(folder: Path, name: str, parts: list[str], base: str) -> PinocchioModel:
    path = folder / f"{name}.urdf"
    path.write_text(f'<robot name="{name}">{"".join(parts)}\n</robot>')
    return wbc.load(str(path), base=base)  # type: ignore[arg-type]


def four_bar(folder: Path) -> PinocchioModel:
    """A crank (0.2 m) and a rocker (0.3 m), 0.4 m apart, in the x-z plane; the rod (0.45 m) is only on the crank. Its
    end, ``rod_end``, belongs on the rocker's, ``rocker_end``."""
    parts = [_link("ground"), _link("crank", 0.1), _link("rod", 0.2, 0.8), _link("rocker", 0.15, 1.2)]
    parts += [_link("rod_end", 0.0, 0.01), _link("rocker_end", 0.0, 0.01)]
    parts += [_joint("crank_joint", "ground", "crank", "0 0 0"), _joint("rod_joint", "crank", "rod", "0.2 0 0")]
    parts += [_joint("rocker_joint", "ground", "rocker", "0.4 0 0")]
    parts += [_joint("rod_tip", "rod", "rod_end", "0.45 0 0", kind="fixed")]
    parts += [_joint("rocker_tip", "rocker", "rocker_end", "0.3 0 0", kind="fixed")]
    return _load(folder, "four_bar", parts, "fixed")


def cart(folder: Path) -> PinocchioModel:
    """A body on two driven wheels of 0.1 m, 0.4 m apart, axles along y."""
    parts = [_link("body", 0.0, 5.0), _link("left_wheel"), _link("right_wheel")]
    parts += [_joint("left", "body", "left_wheel", "0 0.2 0", kind="continuous")]
    parts += [_joint("right", "body", "right_wheel", "0 -0.2 0", kind="continuous")]
    return _load(folder, "cart", parts, "floating")


def omni_cart(folder: Path) -> PinocchioModel:
    """A body on four mecanum wheels of 0.1 m at (±0.3, ±0.2) m, axles along y."""
    places = {"front_left": "0.3 0.2 0", "front_right": "0.3 -0.2 0", "rear_left": "-0.3 0.2 0"}
    places["rear_right"] = "-0.3 -0.2 0"
    parts = [_link("body", 0.0, 5.0), *(_link(f"{name}_wheel") for name in places)]
    parts += [_joint(name, "body", f"{name}_wheel", at, kind="continuous") for name, at in places.items()]
    return _load(folder, "omni_cart", parts, "floating")
