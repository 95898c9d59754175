"""The scenarios of the methods are good, show the numbers of their exercises, and can say no."""

from __future__ import annotations

import re

import numpy as np
import pytest

from tasks.scenarios.pr_fault import FAULTS
from tests.scenarios.runs import failed, pictures, run
from wbc.report import run_report
from wbc.report.document import Plot


def test_the_first_torque_is_that_of_the_exercise_and_so_is_the_one_with_the_wrong_sign():
    result = run("pr-torque", duration=1.0)
    assert not failed(result)
    start = [result.figures["tau_start_1_N"], result.figures["tau_start_2_Nm"]]
    np.testing.assert_allclose(start, [104 / 11, -71 / 22], atol=1e-8)
    assert result.figures["task_acceleration_start"] == pytest.approx(9.0, abs=1e-8)
    assert "τ(0) for r̈ = −9 minus (−2, 5/2)" in [check.text for check in result.verdict]
    assert pictures(result) == ["pr-task", "pr-off", "pr-turn", "pr-torque"]


def test_without_damping_the_two_runs_are_the_same_and_that_is_not_good():
    assert failed(run("pr-torque", "damping=0,0", duration=0.5)) == {"fastest turn, damped over not damped"}


def test_residuals_are_those_of_the_exercise_for_every_kind_of_fault():
    result = run("pr-fault")
    assert not failed(result)
    assert result.figures["r1_at_0.1_s_K_10_N"] == pytest.approx(3.1606, abs=5e-5)
    assert result.figures["r1_at_0.1_s_K_3_N"] == pytest.approx(1.2959, abs=5e-5)
    assert result.figures["largest_r2_Nm"] < 5e-4
    assert result.figures["share_lost_joint_1"] == pytest.approx(1.0, abs=1e-3)
    assert pictures(result) == ["fault-dead", "fault-healthy", "fault-0", "fault-1", "fault-2"]


def test_a_fault_takes_the_share_that_its_name_says():
    shares = {kind: re.search(r"(\d+) %", kind) for kind in FAULTS}
    assert any(shares.values())
    for kind, share in shares.items():
        if share is not None:
            assert 100.0 * (1.0 - FAULTS[kind][0].effectiveness) == pytest.approx(float(share[1]))


def test_a_threshold_that_is_never_reached_is_not_called_a_detection():
    late = "alarm of joint 1 later than the formula says"
    assert failed(run("pr-fault", "threshold=4.9999,1", duration=0.5)) == {late}


def test_the_adaptive_law_is_the_command_from_the_first_tick_on():
    result = run("4p-adaptive", "physical=false", "m=1,1,1,1", duration=2.5)
    late = {"largest error of the last 2 s, moving", "largest error of the last 2 s, at rest"}
    assert failed(result) <= {*late, "coefficients not found, moving"}
    assert (result.figures["cartesian_inertia_x_kg"], result.figures["cartesian_inertia_y_kg"]) == (2.0, 1.0)
    assert pictures(result) == [
        "coefficients-moving", "coefficients-rest", "adaptive-error", "adaptive-lyapunov",
    ]  # fmt: skip
    (shown,) = (item for item in result.sections[1].items if isinstance(item, Plot) and item.name == "adaptive-error")
    for curve, which in zip(shown.curves, ("moving", "still"), strict=True):
        last = curve.values[shown.x >= shown.x[-1] - 2.0].max()
        assert last == pytest.approx(1e3 * result.figures[f"last_error_{which}_m"])


@pytest.mark.slow
def test_unknown_masses_are_tracked_and_found():
    result = run("4p-adaptive")
    assert not failed(result)
    assert result.figures["off_a1_still_kg"] > 0.1, "at rest nothing excites the masses that slide along x"


def test_other_solvers_give_the_same_verdict():
    assert not failed(run("pr-fault", duration=0.3, solver="proxqp"))


def test_what_a_scenario_shows_stands_behind_the_verdict():
    report = run_report(run("pr-fault", duration=0.2))
    assert [section.title for section in report.sections[:3]] == [
        "Verdict", "Total fault of actuator 1", "Other faults",
    ]  # fmt: skip
    assert report.sections[-1].title == "Limits of this run"


def test_the_step_of_the_plane_is_exact_and_limits_and_gradient_are_both_felt():
    result = run("pg-step", "robot=arm", duration=1.5)
    assert not failed(result)
    assert result.figures["alpha_star_in_plane"] == pytest.approx(1.1, abs=1e-12)
    assert 0.0 < result.figures["share_of_ticks_with_a_full_step"] < 1.0
    assert pictures(result) == ["pg-plane", "pg-alpha", "pg-climb", "pg-speed"]
    assert b"<svg" in result.sections[0].items[0].data


def test_a_task_too_fast_for_the_joints_is_not_called_good():
    assert "certified ticks" in failed(run("pg-step", "robot=arm", "speed=0.05", duration=1.5))
