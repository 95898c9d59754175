"""Our own robots stand, are pushed, carry and reach as their verdicts demand."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

import wbc
from tasks import LoopClosure
from tasks.scenarios.arm_reach import TOOLS, tool
from tasks.scenarios.humanoid_stand import HumanoidStand
from tasks.scenarios.quadruped_stand import QuadrupedStand
from tasks.scenarios.reach_strict import ReachStrict
from tasks.scenarios.stand_family import LOAD, PUSH, STANCES
from tasks.scenarios.standing import Demand, joint_constraints
from tests.robots.examples import needs_examples
from tests.scenarios.runs import failed, run
from wbc.errors import NotSupported, UnknownFrame


@pytest.mark.physics
@pytest.mark.parametrize("name, robot", [("humanoid-stand", "humanoid"), ("quadruped-stand", "quadruped")])
def test_our_own_robots_stand_through_the_first_push(name: str, robot: str) -> None:
    result = run(name, f"robot={robot}", duration=2.5)
    assert not failed(result)
    assert result.run.rows == 2500
    assert result.figures["com_max_with_pushes_m"] > 1e-3, "the push was not felt"


@pytest.mark.physics
def test_a_push_too_strong_is_a_verdict_of_no() -> None:
    result = run("humanoid-stand", "robot=humanoid", "push=900", duration=2.5)
    assert not result.ok
    assert "stays up through pushes: 1" in failed(result)


@pytest.mark.parametrize("demands", [HumanoidStand.demands, QuadrupedStand.demands], ids=["humanoids", "quadrupeds"])
def test_standing_is_demanded_to_the_millimetre(demands: Mapping[str, Demand]) -> None:
    for demand in demands.values():
        assert 5e-4 <= demand.com_rms <= 5e-3 and 5e-4 <= demand.slip <= 5e-3


def test_what_is_kept_in_hand_lies_within_the_robots_limits_and_holds_its_reference() -> None:
    robot = wbc.load("humanoid", base="floating")
    limits, q = robot.limits, robot.q0[-robot.nj :]
    _, speed, position = joint_constraints(robot)
    low, high = speed.bounds(robot)
    assert (-limits.v_max < low).all() and (high < limits.v_max).all() and (high > 0.5 * limits.v_max).all()
    low, high = position.bounds(robot)
    assert (limits.q_min <= low).all() and (low <= q).all() and (q <= high).all() and (high <= limits.q_max).all()
    inner = (q > limits.q_min + 0.1) & (q < limits.q_max - 0.1)
    assert inner.any() and ((low - limits.q_min)[inner] > 0.01).all() and ((limits.q_max - high)[inner] > 0.01).all()


@pytest.mark.parametrize("name", [pytest.param("panda", marks=needs_examples), "arm"])
def test_the_tool_of_an_arm_is_what_it_is_called(name: str) -> None:
    assert tool(wbc.load(name)) == TOOLS[name]


def test_the_tool_of_another_robot_is_its_one_end() -> None:
    arm = wbc.load("arm")
    arm.name = "another"
    assert tool(arm) == "tool"


@pytest.mark.parametrize(
    "settings, plant",
    [([], "integrator"), (["level=dynamics"], "integrator"), (["level=dynamics"], "mujoco")],
    ids=["velocity", "dynamics", "physics"],
)
def test_an_arm_runs_into_its_speed_limits_and_catches_up(settings: list[str], plant: str) -> None:
    result = run("arm-reach", "robot=arm", *settings, plant=plant, duration=3.0)
    assert not failed(result)
    assert result.figures["speed_use"] == pytest.approx(1.0, abs=1e-6), "the step never reached a limit"
    assert result.figures["catch_up_s"] > 0.1
    assert result.verdict[0].place.part == "Frame[tool]"


@pytest.mark.physics
def test_a_push_that_does_not_come_is_not_counted_as_survived() -> None:
    for settings, duration in (([], 1.0), (["push=0"], 2.5)):
        result = run("humanoid-stand", "robot=humanoid", *settings, duration=duration)
        assert "stays up" in {check.text for check in result.verdict}
        assert not result.run["push"].any()


# ---- pushes from all sides and loads in either hand
@pytest.mark.physics
def test_our_quadruped_is_pushed_from_both_sides_alike() -> None:
    result = run("stand-family", "robot=quadruped", "sides=2", "push=20", duration=1.7)
    forward, backward = result.figures["rows"]
    assert forward["stands"] and backward["stands"] and result.ok
    assert forward["what"] == "push towards 0°" and backward["what"] == "push towards 180°"
    assert 0.5 < forward["most_mm"] / backward["most_mm"] < 2.0
    (section,) = result.sections
    assert section.title == "From all sides"


@pytest.mark.parametrize("name", [*(pytest.param(n, marks=needs_examples) for n in ("talos", "g1", "go2")), "humanoid",
                                  "quadruped"])  # fmt: skip
def test_usual_pushes_and_loads_are_felt_and_are_no_robots_weight(name: str) -> None:
    mass = STANCES[name].robot(name).mass
    assert 0.02 < PUSH[name] / (9.81 * mass) < 0.5
    assert name not in LOAD or 5e-3 < LOAD[name] / mass < 0.1


@pytest.mark.parametrize("name", STANCES)
def test_stances_are_the_same_on_both_sides(name: str) -> None:
    joints = STANCES[name].joints
    for joint, angle in joints.items():
        assert abs(joints[joint.replace("left", "right") if "left" in joint else joint]) == abs(angle)


@pytest.mark.physics
def test_our_humanoid_bears_its_usual_load_in_either_hand() -> None:
    result = run("stand-family", "robot=humanoid", "push=0", duration=1.8)
    assert result.ok
    left, right = result.figures["rows"]
    assert [left["what"], right["what"]] == ["load in left_hand", "load in right_hand"]
    assert left["most_mm"] == pytest.approx(right["most_mm"], rel=0.1)


# ---- a hand asked for too much: the same stack, ranked and weighed
REACH = ReachStrict()


@pytest.mark.parametrize("hierarchy", ReachStrict.hierarchies)
def test_fifty_ticks_under_every_hierarchy(hierarchy: str) -> None:
    result = run("reach-strict", plant="integrator", hierarchy=hierarchy, duration=0.05)
    assert result.run.rows == 50 and result.figures["certified_share"] == 1.0
    assert next(iter(result.figures["balance_rms_m"])) == hierarchy
    assert set(result.figures["balance_rms_m"]) == set(ReachStrict.hierarchies)
    assert result.figures["hand_error_m"] < 0.01  # the target has not left yet
    assert result.run.meta["hierarchy"].lower().startswith(hierarchy)


@pytest.mark.physics
@pytest.mark.slow
def test_in_physics_balance_does_not_give_where_weights_let_it() -> None:
    pytest.importorskip("mujoco")
    result = run("reach-strict", "reach=1.0", plant="mujoco", hierarchy="strict", duration=1.3)
    rms = result.figures["balance_rms_m"]
    assert rms["strict"] < 1e-3
    assert rms["weighted"] > 10.0 * rms["strict"]
    (section,) = result.sections
    assert [row[0] for row in section.items[1].rows] == ["strict", "weighted", "scaled"]


# ---- a bar in two hands, welded in physics
@pytest.mark.physics
def test_our_own_humanoid_squeezes_a_bar() -> None:
    result = run("dual-arm", "robot=humanoid", "squeeze=12", duration=1.8)
    assert not failed(result)
    assert result.figures["grip_error_m"] < 1e-3
    assert np.linalg.norm(result.run["plant.f.bar"][-1]) == pytest.approx(12.0, abs=0.1)
    np.testing.assert_allclose(result.run["plant.f.bar"][-1], result.run["f.bar"][-1, :3], atol=0.1)


@pytest.mark.physics
def test_what_physics_cannot_join_is_refused() -> None:
    from wbc.sim.mujoco_ import MujocoPlant

    robot = wbc.load("humanoid")
    with pytest.raises(NotSupported, match="holds 3 of 6 directions"):
        MujocoPlant(robot, contacts=[LoopClosure("right_hand", to="left_hand")])
    rows = ("x", "y", "z", "rx", "ry", "rz")
    with pytest.raises(UnknownFrame, match="a weld joins links"):
        MujocoPlant(robot, contacts=[LoopClosure("left_wrist_roll", to="left_hand", rows=rows)])


# ---- position drives keep a robot where its setpoint is
@pytest.mark.physics
@pytest.mark.deep
def test_an_arm_follows_as_well_as_what_it_is_sent() -> None:
    result = run("position-drives", "robot=arm", duration=1.2)
    assert not failed(result)
    error = result.figures["error_rms_m"]
    assert error["torques alone"] < error["commanded, with torques"] < 1e-3
    assert error["commanded, positions alone"] > 20 * error["commanded, with torques"]
    (comparison,) = result.sections
    assert [row[0] for row in comparison.items[1].rows] == list(error)
    assert result.run.meta["feedback"] == "commanded"


@pytest.mark.physics
def test_a_quadruped_stands_on_them_from_the_first_ticks() -> None:
    result = run("position-drives", "robot=quadruped", duration=0.05)
    assert not failed(result) and result.run.rows == 50
    assert set(result.figures["stood_s"].values()) == {0.05}
