"""Descriptions of robots as text, for tests that need a robot of their own; robots read quietly; states."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from wbc.models import RobotState, load

LIMIT = '<limit lower="-1" upper="1" effort="9" velocity="9"/>'


def origin(xyz: object = "0 0 0", rpy: object = "0 0 0") -> str:
    """A place: two texts of three numbers, or two sequences."""
    words = [place if isinstance(place, str) else " ".join(repr(float(x)) for x in place) for place in (xyz, rpy)]
    return f'<origin xyz="{words[0]}" rpy="{words[1]}"/>'


def inertial(mass: float = 1.0, moments: tuple[float, ...] = (1.0, 1.0, 1.0), at: str = "") -> str:
    """A mass [kg] and moments of inertia [kg m²] about the axes of the link."""
    xx, yy, zz = (repr(float(moment)) for moment in moments)
    inertia = f'<inertia ixx="{xx}" ixy="0" ixz="0" iyy="{yy}" iyz="0" izz="{zz}"/>'
    return f'<inertial>{at}<mass value="{float(mass)!r}"/>{inertia}</inertial>'


def shape(geometry: str, at: str = "", kind: str = "collision") -> str:
    """A shape of a link."""
    return f"<{kind}>{at}<geometry>{geometry}</geometry></{kind}>"


def link(name: str, *inside: str) -> str:
    """A link with what is inside."""
    return f'<link name="{name}">{"".join(inside)}</link>'


def joint(name: str, parent: str, child: str, kind: str = "revolute", inside: str = "", axis: str = "0 1 0") -> str:
    """A joint; ``inside`` has its limit, unless it is the usual one."""
    limit = "" if "<limit" in inside or kind in ("fixed", "continuous") else LIMIT
    ends = f'<parent link="{parent}"/><child link="{child}"/><axis xyz="{axis}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{limit}{inside}</joint>'


def saved(folder: Path, *parts: str, name: str = "robot") -> Path:
    """A file of links and joints, called as its robot."""
    path = folder / f"{name}.urdf"
    path.write_text(f'<?xml version="1.0" encoding="utf-8"?><robot name="{name}">{"".join(parts)}</robot>')
    return path


def quietly(robot: Any, **settings: Any) -> Any:
    """A robot; what is said about it is not the matter."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return load(robot, **settings)


def at(robot: Any, q: Any = None, v: Any = None, t: float = 0.0, **settings: Any) -> RobotState:
    """A state there: at the reference and at rest, unless another is given."""
    state: RobotState = robot.state(**settings)
    state.update(t, robot.q0 if q is None else q, np.zeros(robot.nv) if v is None else v)
    return state
