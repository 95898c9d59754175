"""Arms that lose motors, carry loads and are pushed."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given

import wbc
from tasks.scenarios import SCENARIOS, arm_collision
from tasks.scenarios.arm_actuator_loss import out_of_reach
from tasks.scenarios.arm_collision import jacobian, moved_links
from tasks.scenarios.arm_payload import heaviest
from tests.robots.examples import needs_examples
from tests.scenarios.test_faults import run
from tests.scenarios.test_standing import failed
from wbc.models.model import RobotState
from wbc.report.document import Table
from wbc.sim.actuator_fault import ActuatorFault
from wbc.sim.disturbance import Push
from wbc.sim.scenario import Parameters
from wbc.testing.strategies import states

ARM = wbc.load("arm")


@needs_examples
@pytest.mark.physics
@pytest.mark.deep
@pytest.mark.parametrize("name", ["arm-payload", "arm-actuator-loss", "arm-collision"])
def test_panda_keeps_what_the_verdict_demands(name: str) -> None:
    assert not failed(run(name))


@pytest.mark.physics
def test_our_arm_goes_on_with_a_brake() -> None:
    result = run("arm-actuator-loss", "robot=arm", "joints=1", duration=4.5)
    assert result.figures["found_joint"] == result.figures["joint"]
    assert result.figures["with"]["task_rms_m"] < 1e-3
    assert result.figures["delay_ms"][0] < 20.0


def test_a_path_within_reach_is_reached_and_one_beyond_is_not() -> None:
    assert out_of_reach(ARM, "tool", ARM.joint_names[0], ARM.q0) < 1e-6
    folded = ARM.q0.copy()
    folded[3] = ARM.limits.q_max[3] if abs(ARM.limits.q_max[3]) > abs(ARM.limits.q_min[3]) else ARM.limits.q_min[3]
    assert out_of_reach(ARM, "tool", ARM.joint_names[3], folded) > 1e-2


@needs_examples
def test_the_heaviest_load_is_held_by_the_torque_limits_and_twice_the_torque_holds_more() -> None:
    panda = wbc.load("panda")
    most, joint = heaviest(panda)
    assert most > 0.0 and joint in panda.joint_names
    strong = panda.replace(limits=replace(panda.limits, tau_max=2.0 * panda.limits.tau_max))
    assert heaviest(strong)[0] > 2.0 * most


def test_links_stand_in_the_order_of_their_joints() -> None:
    links = moved_links(ARM)
    assert len(links) == ARM.nj
    J = [ARM.state().frame(link).jacobian() for link in links]
    for i, columns in enumerate(J):
        assert np.abs(columns[:, i]).max() > 0.1 and not columns[:, i + 1 :].any()


@pytest.mark.parametrize("name", ["arm-actuator-loss", "arm-collision"])
def test_what_happens_to_an_arm_leaves_it_time_to_show(name: str) -> None:
    scenario = SCENARIOS[name]
    p = scenario.complete_parameters({"robot": "arm"})
    for case in scenario.cases(p).values():
        (disturbance,) = scenario.build(Parameters({**p, **case}, p.settings)).disturbances
        assert isinstance(disturbance, ActuatorFault | Push)
        end = disturbance.start + (disturbance.duration if isinstance(disturbance, Push) else 0.0)
        assert 1.0 <= disturbance.start and end + 0.5 < p.settings.duration


@pytest.mark.parametrize("after", [0.004, np.inf])
def test_the_table_of_pushes_says_after_how_many_milliseconds_each_was_answered(after: float) -> None:
    said = SimpleNamespace(t=arm_collision.START + after) if np.isfinite(after) else None
    hit = arm_collision.Hit(cast("Any", None), "tool", "x", cast("Any", said), "tool", np.full(3, 2.0), 5.0, 5.0)
    (table,) = (item for item in arm_collision._every([hit]).items if isinstance(item, Table))
    row = dict(zip(table.columns, table.rows[0], strict=True))
    assert row["after [ms]"] == (pytest.approx(4.0) if np.isfinite(after) else None)
    assert row["force estimated [N]"] == pytest.approx(2.0 * 3.0**0.5)


@given(states(ARM))
def test_bodies_of_links_move_the_centre_of_mass_together(state: RobotState) -> None:
    masses = [inertia.mass for inertia in list(ARM.pinocchio.inertias)[1:]]
    momentum = sum(m * jacobian(ARM, link, state.q) for m, link in zip(masses, moved_links(ARM), strict=True))
    np.testing.assert_allclose(momentum, ARM.mass * state.com_jacobian, atol=1e-9)


@pytest.mark.physics
@pytest.mark.deep
@pytest.mark.parametrize(
    "rough",
    [
        pytest.param([], id="clean"),
        pytest.param(
            ["noise=true", "masses=0.1"], id="noise and wrong masses",
            marks=pytest.mark.xfail(reason="of 63 large biases 7 are first called an external force: docs/adaptive.md"),
        ),
    ],
)  # fmt: skip
def test_what_happens_to_our_arm_is_taken_for_what_it_is(rough: list[str]) -> None:
    result = run("diagnosis-statistics", "robot=arm", "cases=36", *rough)
    assert not failed(result)
    assert result.figures["clear"] >= 3, "a verdict on nothing is none"


@pytest.mark.physics
def test_clear_faults_of_our_arm_are_found_and_laid_to_the_right_joint() -> None:
    result = run("fault-statistics", "robot=arm", "faults=12", "nominal=0", "learning=4")
    figures = result.figures
    assert figures["faults"] == 12 and figures["clear_faults"] >= 3
    assert figures["detected"] == 1.0
    assert figures["isolated"] >= 0.75
    assert figures["false_alarms"] == 0
