"""Contacts that hold more than the legs can move: the tick is relaxed, and says why."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import wbc
from tasks import JointAccelerationLimits, JointVelocityLimits, Point, Posture
from wbc.types import Status


def legged(folder: Path, *axes: str) -> wbc.RobotModel:
    """A robot on four legs, whose joints from the hip down turn about these axes."""

    def link(name: str) -> str:
        return (
            f'<link name="{name}"><inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" '
            'ixz="0" iyz="0"/></inertial></link>'
        )

    parts = [link("base")]
    for leg, (x, y) in enumerate([(0.2, 0.1), (0.2, -0.1), (-0.2, 0.1), (-0.2, -0.1)]):
        parent, at = "base", f"{x} {y} 0"
        for k, axis in enumerate(axes):
            name = f"link_{leg}_{k}"
            parts += [
                link(name),
                f'<joint name="joint_{leg}_{k}" type="revolute"><parent link="{parent}"/><child link="{name}"/>'
                f'<origin xyz="{at}" rpy="0 0.4 0"/><axis xyz="{axis}"/>'
                '<limit lower="-2" upper="2" velocity="9" effort="30"/></joint>',
            ]
            parent, at = name, "0.02 0 -0.2"
        parts.append(
            f'<link name="foot_{leg}"/><joint name="ankle_{leg}" type="fixed"><parent link="{parent}"/>'
            f'<child link="foot_{leg}"/><origin xyz="{at}"/></joint>'
        )
    path = folder / "legged.urdf"
    path.write_text('<robot name="legged">' + "".join(parts) + "</robot>")
    return wbc.load(path, base="floating", feet=[])


@pytest.mark.parametrize(("axes", "depend"), [(("0 1 0",) * 2, True), (("1 0 0", "0 1 0", "0 1 0"), False)])
@pytest.mark.parametrize("level", [wbc.AccelerationLevel(), wbc.InverseDynamics()])
def test_a_tick_that_relaxes_contacts_says_where_their_rows_depend_on_one_another(
    tmp_path: Path, axes: tuple[str, ...], level: wbc.Formulation, *, depend: bool
):
    robot = legged(tmp_path, *axes)
    contacts = [Point(f"foot_{leg}", friction=0.5) for leg in range(4)]
    limits = [JointVelocityLimits(), JointAccelerationLimits(20.0)]
    stack = wbc.Stack([Posture(robot.q0)], contacts=contacts, subject_to=limits)
    control = wbc.Controller(robot, stack, level=level)
    control.tick(0.0, robot.q0, np.zeros(robot.nv))
    off = robot.integrate(robot.q0, 1e-2 * np.sin(np.arange(robot.nv)))
    control.tick(1e-3, off, np.zeros(robot.nv))
    state = robot.state()
    state.update(0.0, off, np.zeros(robot.nv))
    rank = np.linalg.matrix_rank(np.vstack([state.frame(f"foot_{leg}").jacobian()[:3] for leg in range(4)]))
    assert depend == (rank < 12) == (control.status is Status.INFEASIBLE)
    said = f"the contacts hold 12 directions, of which {rank} are independent"
    assert depend == control.why.endswith(said) and depend == control.why.startswith("relaxed: contact[foot_")
