"""Robots that lose a motor fall without an answer and stand with one; arms lose motors, carry loads and are pushed."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from scipy.optimize import linprog

import wbc
from tasks import feet
from tasks.scenarios import SCENARIOS, arm_collision
from tasks.scenarios.arm_actuator_loss import out_of_reach
from tasks.scenarios.arm_collision import jacobian, moved_links
from tasks.scenarios.arm_payload import heaviest
from tasks.scenarios.least_torque import least_torque
from tests.robots.examples import needs_examples
from tests.scenarios.runs import failed, run
from wbc.models.model import RobotState
from wbc.report.document import Plot, Table
from wbc.sim.actuator_fault import ActuatorFault
from wbc.sim.disturbance import Push
from wbc.sim.scenario import Parameters, ScenarioResult
from wbc.testing.strategies import states

HUMANOID = wbc.load("humanoid", base="floating")


@pytest.mark.slow
@pytest.mark.physics
def test_our_humanoid_falls_without_its_knee_unless_it_is_answered() -> None:
    result = run("humanoid-joint-loss", "robot=humanoid", "moments=1", "variants=false", duration=1.6)
    assert not failed(result)
    figures = result.figures
    assert not figures["without"]["stands"] and figures["with"]["stands"]
    assert figures["found_joint"] == figures["joint"] == "left_knee"
    assert figures["delay_ms"] <= 4.0


@pytest.fixture(scope="module")
def weak() -> ScenarioResult:
    """Our quadruped with half a knee, once."""
    return run("quadruped-actuator-weak", "robot=quadruped", "moments=1", "variants=false", duration=1.2)


@pytest.mark.physics
def test_our_quadrupeds_weak_knee_is_measured_and_made_good(weak: ScenarioResult) -> None:
    assert not failed(weak)
    assert weak.figures["without"]["task_rms_m"] > 5 * weak.figures["with"]["task_rms_m"]
    assert weak.figures["share_at_the_end"][0] == pytest.approx(0.5, abs=0.01)


@pytest.mark.physics
def test_the_report_shows_both_runs_and_every_decision(weak: ScenarioResult) -> None:
    made = list(weak.sections)
    titles = [section.title for section in made if section is not None]
    assert {"What was seen, and when", "Every trial"} <= set(titles)
    assert weak.called == "with an answer" and list(weak.beside) == ["without an answer"]
    (error,) = [item for item in made[0].items if isinstance(item, Plot) and item.name == "true_error"]
    assert [(curve.label, curve.run) for curve in error.curves] == [("with an answer", 0), ("without an answer", 1)]


# ---- what statics says
def by_linear_program(q: Any, joint: str) -> float:
    """min t subject to |τ_joint| <= t, forces in their cones, the base at rest, the others within their limits."""
    contacts, state = feet(HUMANOID), HUMANOID.state()
    state.update(0.0, q, np.zeros(HUMANOID.nv))
    J, g, i = np.vstack([contact.rows(state).J for contact in contacts]), state.g, HUMANOID.joint(joint)
    n = len(J)
    cone = np.zeros((32, n + 1))
    cone[:16, :6], cone[16:, 6:12] = contacts[0].cone(), contacts[1].cone()
    torque = np.hstack([-J.T[6:], np.zeros((HUMANOID.nj, 1))])
    rows, right = [cone], [np.zeros(32)]
    for sign in (1.0, -1.0):
        bound = HUMANOID.limits.tau_max - sign * g[6:]
        part = sign * torque
        part[i, -1], bound[i] = -1.0, -sign * g[6 + i]
        rows.append(part)
        right.append(bound)
    found = linprog(
        np.eye(n + 1)[-1], A_ub=np.vstack(rows), b_ub=np.concatenate(right),
        A_eq=np.hstack([J.T[:6], np.zeros((6, 1))]), b_eq=g[:6], bounds=[(None, None)] * n + [(0, None)],
    )  # fmt: skip
    return float(found.fun) if found.status == 0 else float("nan")


@pytest.mark.parametrize("joint", ["left_knee", "waist_pitch", "left_ankle_roll", "left_shoulder_pitch"])
def test_the_least_torque_is_that_of_a_linear_program(joint: str) -> None:
    for lean in (0.0, 0.05):
        q = HUMANOID.q0.copy()
        q[-HUMANOID.nj + HUMANOID.joint("waist_pitch")] += lean
        assert least_torque(HUMANOID, feet(HUMANOID), q, joint) == pytest.approx(
            by_linear_program(q, joint), abs=1e-3, nan_ok=True
        )


# ---- arms
ARM = wbc.load("arm")


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
