"""Whatever size the numbers of a description have, it is refused by name, or its robot ticks with finite commands."""

from __future__ import annotations

import warnings
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from tasks import CollisionAvoidance, Obstacle, Posture, TorqueLimits
from wbc.errors import ModelError, WbcError
from wbc.models.geometry import Sphere

USUAL = {
    "origin of a joint": 0.3, "angle of a joint": 0.1, "centre of mass": 0.1, "mass": 1.0, "moment": 1.0,
    "product": 0.0, "mass fixed to it": 1.0, "where that is": 0.1, "effort": 10.0, "speed": 1.0, "upper": 1.0,
    "damping": 0.0, "radius": 0.05, "centre of a shape": 0.0,
}  # fmt: skip
URDF = """<robot name="sized"><link name="base"/>
<link name="arm"><inertial><origin xyz="{centre of mass} 0 0"/><mass value="{mass}"/>
  <inertia ixx="{moment}" iyy="1" izz="1" ixy="{product}" ixz="0" iyz="0"/></inertial>
  <collision><origin xyz="{centre of a shape} 0 0"/><geometry><sphere radius="{radius}"/></geometry></collision></link>
<link name="load"><inertial><mass value="{mass fixed to it}"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="weld" type="fixed"><parent link="arm"/><child link="load"/><origin xyz="{where that is} 0 0"/></joint>
<joint name="hinge" type="revolute"><parent link="base"/><child link="arm"/>
  <origin xyz="{origin of a joint} 0 0" rpy="{angle of a joint} 0 0"/><axis xyz="0 0 1"/>
  <limit lower="-1" upper="{upper}" velocity="{speed}" effort="{effort}"/>
  <dynamics damping="{damping}"/></joint></robot>"""
MJCF = """<mujoco model="sized"><worldbody><body name="base"><body name="arm" pos="{origin of a joint} 0 0">
<inertial pos="{centre of mass} 0 0" mass="{mass}" diaginertia="{moment} 1 1"/>
<joint name="hinge" range="-1 1" limited="true"/>
<body name="load" pos="{where that is} 0 0"><inertial pos="0 0 0" mass="{mass fixed to it}" diaginertia="1 1 1"/></body>
<geom type="sphere" size="{radius}" pos="{centre of a shape} 0 0"/></body></body></worldbody></mujoco>"""


def tick(description: str, kind: str, base: Literal["fixed", "floating"]) -> Any:
    """The first command of a robot at rest, braked, and the next one."""
    with TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of what is doubtful and not refused
        path = Path(folder) / f"sized.{kind}"
        path.write_text(description)
        robot = wbc.load(path, base=base)
        apart = CollisionAvoidance([Obstacle("ball", Sphere(0.1), pin.SE3.Identity())], self_collision=False)
        stack = wbc.Stack([Posture(robot.q0)], subject_to=[TorqueLimits(), apart])
        controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics())
        return [controller.tick(0.0, q, np.zeros(robot.nv)) for q in (np.nan * robot.q0, robot.q0)]


@given(
    st.sampled_from(sorted(USUAL)), st.floats(-320.0, 308.2), st.sampled_from([1.0, -1.0]),
    st.sampled_from(["urdf", "xml"]), st.sampled_from(["fixed", "floating"]),
)  # fmt: skip
def test_any_size_is_refused_or_has_finite_commands(place: str, power: float, sign: float, kind: str, base: Any):
    text = (URDF if kind == "urdf" else MJCF).format(**(USUAL | {place: repr(sign * 10.0**power)}))
    try:
        commands = tick(text, kind, base)
    except WbcError as refusal:
        assert any(name in str(refusal) for name in ("sized", "hinge"))
        return
    assert all(np.isfinite(command.tau).all() for command in commands)


@pytest.mark.parametrize("base", ["fixed", "floating"])
@pytest.mark.parametrize("place", ["origin of a joint", "centre of mass", "mass", "moment", "where that is", "radius"])
def test_lengths_and_masses_that_no_robot_has_are_refused_by_name(place: str, base: Any):
    with pytest.raises(ModelError, match=r"(arm|load|hinge|weld).* 1e\+200 .*at most 1e\+09"):
        tick(URDF.format(**(USUAL | {place: "1e200"})), "urdf", base)
