"""Robots that lose a motor fall without an answer and stand with one; what statics says of it is true."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog

import wbc
from tasks import feet
from tasks.scenarios import SCENARIOS
from tasks.scenarios.least_torque import least_torque
from tests.robots.examples import needs_examples
from tests.scenarios.test_standing import failed
from wbc.report.document import Plot
from wbc.sim.scenario import ScenarioResult, Settings

HUMANOID = wbc.load("humanoid", base="floating")


def run(name: str, *parameters: str, duration: float | None = None) -> ScenarioResult:
    scenario = SCENARIOS[name]
    chosen = scenario.choose(plant=None, hierarchy=None, duration=duration)
    return scenario.run(scenario.parse(parameters), Settings(**chosen))


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


@needs_examples
@pytest.mark.physics
@pytest.mark.deep
@pytest.mark.parametrize(
    "name, parameters",
    [
        ("humanoid-joint-loss", []),
        ("humanoid-joint-loss", ["noise=true", "masses=0.1", "variants=false"]),
        ("humanoid-joint-loss", ["robot=talos"]),
        ("quadruped-joint-loss", []),
        ("quadruped-actuator-weak", []),
    ],
    ids=lambda x: " ".join(x) if isinstance(x, list) else x,
)
def test_real_robots_keep_what_the_verdict_demands(name: str, parameters: list[str]) -> None:
    assert not failed(run(name, *parameters))


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
