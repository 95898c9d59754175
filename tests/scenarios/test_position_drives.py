"""Position drives keep a robot where its setpoint is; the report says what each way of driving it comes to."""

from __future__ import annotations

import pytest

from tests.robots.examples import needs_examples
from tests.scenarios.test_standing import failed, run

pytestmark = pytest.mark.physics


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


def test_a_quadruped_stands_on_them_from_the_first_ticks() -> None:
    result = run("position-drives", "robot=quadruped", duration=0.05)
    assert not failed(result) and result.run.rows == 50
    assert set(result.figures["stood_s"].values()) == {0.05}


@needs_examples
@pytest.mark.deep
@pytest.mark.parametrize("robot", ["panda", "go2", "g1", "talos", "humanoid"])
def test_real_robots_do_too(robot: str) -> None:
    assert not failed(run("position-drives", f"robot={robot}"))
