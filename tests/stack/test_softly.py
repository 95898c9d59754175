"""A constraint among the tasks costs nothing while it holds, and has a slack at its weight where it cannot."""

from __future__ import annotations

import numpy as np
import pytest

import wbc
from tasks import JointPositionLimits, JointVelocityLimits, Position, Posture, TorqueLimits
from tests.stack.conftest import moving, standing
from wbc.errors import NotSupported
from wbc.models.pinocchio_ import PinocchioModel
from wbc.stack.constraint import Barrier, BarrierRows, ConstraintRows, LinearConstraint

LEVELS = (wbc.VelocityLevel(), wbc.AccelerationLevel(), wbc.InverseDynamics())


class Ceiling(Barrier):
    """The tool stays below a height."""

    dim, units = 1, "m"

    def __init__(self, z_max: float) -> None:
        super().__init__(name=f"Ceiling at {z_max}")
        self.z_max = z_max

    def fill(self, state, out: BarrierRows) -> None:
        tool = state.frame("tool")
        out.h[:] = self.z_max - tool.position[2]
        out.J[:] = -tool.jacobian()[2]
        out.drift[:] = -tool.drift()[2]


class SlowSum(LinearConstraint):
    """|sum of all velocities| is small."""

    on, dim, units = "velocity", 1, "rad/s"

    def __init__(self, most: float) -> None:
        super().__init__()
        self.most = most

    def fill(self, state, out: ConstraintRows) -> None:
        out.A[:] = 1.0
        out.lo[:], out.hi[:] = -self.most, self.most


def reach(arm: PinocchioModel, *soft: object, hard: tuple = ()) -> wbc.Stack:
    return wbc.Stack(
        [Position("tool", target=[0.5, 0.1, 0.4], kp=50), Posture(arm.q0, kp=10, weight=1e-2), *soft], subject_to=hard
    )


def decided(robot: PinocchioModel, stack: wbc.Stack, level: wbc.stack.formulation.Formulation, seed: int = 3) -> object:
    q, v = moving(robot, seed)
    return wbc.Controller(robot, stack, level=level, dt=0.01).tick(0.0, q, v)


@pytest.mark.parametrize("level", LEVELS, ids=lambda level: level.name)
def test_a_soft_constraint_that_holds_changes_nothing(arm: PinocchioModel, level) -> None:
    constraints = [Ceiling(9.0), SlowSum(1e3), JointVelocityLimits(90.0), JointPositionLimits()]
    if level.dynamics:
        constraints.append(TorqueLimits(1e4))
    bare = decided(arm, reach(arm), level)
    soft = decided(arm, reach(arm, *(constraint.softly(weight=5.0) for constraint in constraints)), level)
    assert soft.status.ok
    np.testing.assert_allclose(soft.v, bare.v, atol=1e-7)


@pytest.mark.parametrize("level", LEVELS, ids=lambda level: level.name)
@pytest.mark.parametrize(
    "constraint",
    [Ceiling(0.3), SlowSum(0.01), JointVelocityLimits(0.02), TorqueLimits(2.0)],
    ids=lambda constraint: constraint.name,
)
def test_a_very_heavy_soft_constraint_is_the_constraint_and_a_light_one_is_none(
    arm: PinocchioModel, level, constraint
) -> None:
    if isinstance(constraint, TorqueLimits) and not level.dynamics:
        with pytest.raises(NotSupported, match="torque"):
            decided(arm, reach(arm, constraint.softly()), level)
        return
    hard = decided(arm, reach(arm, hard=(constraint,)), level)
    heavy = decided(arm, reach(arm, constraint.softly(weight=1e7)), level)
    light = decided(arm, reach(arm, constraint.softly(weight=1e-9)), level)
    bare = decided(arm, reach(arm), level)
    away = np.abs(hard.v - bare.v).max()
    assert heavy.status.ok
    assert away > 1e-4 or not hard.status.ok
    if hard.status.ok:
        np.testing.assert_allclose(heavy.v, hard.v, atol=1e-3 * away)
    np.testing.assert_allclose(light.v, bare.v, atol=1e-3 * max(away, 1e-3))


def test_a_soft_limit_is_exceeded_by_its_share_of_the_least_squares(arm: PinocchioModel) -> None:
    q, v = moving(arm, 1)
    limit, weight, rate = 0.05, 3.0, 2.0
    stack = wbc.Stack([Posture(arm.q0 + 1.0, rate=rate), JointVelocityLimits(limit).softly(weight=weight)])
    command = wbc.Controller(arm, stack, level=wbc.VelocityLevel()).tick(0.0, q, v)
    wanted = rate * (arm.q0 + 1.0 - q)  # per joint: ½ (v − wanted)² + ½ · 3 · (v − limit)², above the limit
    np.testing.assert_allclose(command.v, (wanted + weight * limit) / (1 + weight), rtol=1e-6)


def test_soft_torque_limits_keep_a_humanoid_standing_with_less_torque(humanoid: PinocchioModel) -> None:
    bare = decided(humanoid, standing(humanoid), wbc.InverseDynamics())
    soft = decided(humanoid, standing(humanoid, extra=(TorqueLimits(8.0).softly(weight=1.0),)), wbc.InverseDynamics())
    assert soft.status.ok and soft.certificate.ok
    over = [np.maximum(np.abs(command.tau) - 8.0, 0.0).sum() for command in (soft, bare)]
    assert over[0] < 0.9 * over[1]
    assert set(soft.f) == set(bare.f)


def test_a_soft_constraint_names_its_rows_and_its_slack(arm: PinocchioModel) -> None:
    stack = reach(arm, JointVelocityLimits(0.02).softly(weight=2.0), Ceiling(0.3).softly())
    plan = wbc.VelocityLevel().compile(arm, stack, dt=0.01)
    names = [str(row) for row in plan.problem.rows]
    assert f"JointVelocityLimits softly: {arm.joint_names[0]}" in names
    assert f"JointVelocityLimits softly: slack: {arm.joint_names[0]}" in names
    assert [row.unit for row in plan.problem.rows if row.owner == "Ceiling at 0.3 softly"] == ["m/s"]
    assert "JointVelocityLimits softly(weight=2.0)" in repr(stack)
