"""The shipped scenarios hold what their verdict demands: briefly in every run, whole in physics when asked."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest

import wbc
from tasks.scenarios import SCENARIOS
from tasks.scenarios.arm_reach import TOOLS, tool
from tasks.scenarios.humanoid_stand import HumanoidStand
from tasks.scenarios.quadruped_stand import QuadrupedStand
from tasks.scenarios.standing import Demand, joint_constraints
from tests.robots.examples import needs_examples
from wbc.sim.scenario import ScenarioResult, Settings


def run(name: str, *settings: str, duration: float | None = None, plant: str | None = None) -> ScenarioResult:
    scenario = SCENARIOS[name]
    chosen = scenario.choose(plant=plant, hierarchy=None, duration=duration)
    return scenario.run(scenario.parse(settings), Settings(**chosen))


def failed(result: ScenarioResult) -> list[Any]:
    return [check for check in result.verdict if not check.ok]


@pytest.mark.physics
@pytest.mark.parametrize("name, robot", [("humanoid-stand", "humanoid"), ("quadruped-stand", "quadruped")])
def test_our_own_robots_stand_through_the_first_push(name: str, robot: str) -> None:
    result = run(name, f"robot={robot}", duration=2.5)
    assert not failed(result)
    assert result.run.rows == 2500
    assert result.figures["com_max_with_pushes_m"] > 1e-3, "the push was not felt"


@needs_examples
@pytest.mark.physics
@pytest.mark.slow
@pytest.mark.parametrize(
    "name, settings",
    [
        ("humanoid-stand", ["robot=talos"]),
        pytest.param("humanoid-stand", ["robot=talos", "push=120"], marks=pytest.mark.deep),
        ("humanoid-stand", ["robot=g1"]),
        ("quadruped-stand", ["robot=go2"]),
    ],
    ids=lambda x: " ".join(x) if isinstance(x, list) else x,
)
def test_real_robots_stand_ten_seconds_through_both_pushes(name: str, settings: list[str]) -> None:
    result = run(name, *settings)
    assert not failed(result)
    assert result.figures["stood_s"] == pytest.approx(10.0)


@pytest.mark.physics
def test_a_push_too_strong_is_a_verdict_of_no() -> None:
    result = run("humanoid-stand", "robot=humanoid", "push=900", duration=2.5)
    assert not result.ok
    assert "stays up through pushes: 1" in {check.text for check in failed(result)}


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
