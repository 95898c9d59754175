"""Whatever happens, a tick gives a bounded command and says why; only programming errors raise."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

import tasks as T
import wbc
from tests.stack.conftest import moving, standing
from wbc.control.answer import distances
from wbc.errors import InvalidInput, NotSupported, WbcError
from wbc.types import Status


@pytest.fixture(scope="module")
def arm() -> Any:
    return wbc.load("arm")


@pytest.fixture(scope="module")
def humanoid() -> Any:
    return wbc.load("humanoid")


def reaching(arm: Any, **settings: Any) -> wbc.Controller:
    stack = wbc.Stack(
        [T.Position("tool", target=[0.5, 0.2, 0.4]), T.Posture(arm.q0, weight=1e-2)],
        subject_to=[T.TorqueLimits(), T.JointVelocityLimits()],
    )
    return wbc.Controller(arm, stack, level=settings.pop("level", wbc.InverseDynamics()), **settings)


# ---- what a command says
def test_next_velocity_and_configuration_follow_from_the_acceleration(humanoid: Any) -> None:
    q, v = moving(humanoid, 1)
    command = wbc.Controller(humanoid, standing(humanoid), level=wbc.InverseDynamics(), dt=0.002).tick(0.0, q, v)
    np.testing.assert_allclose(command.v, v + 0.002 * command.a)
    np.testing.assert_allclose(command.q, humanoid.integrate(q, 0.002 * (v + 0.001 * command.a)))


def test_a_command_outlives_the_next_ticks_but_its_solution_does_not(humanoid: Any) -> None:
    control = wbc.Controller(humanoid, standing(humanoid), level=wbc.InverseDynamics())
    first = control.tick(0.0, *moving(humanoid, 1))
    kept = [values.copy() for values in (first.tau, *first.f.values())]
    control.tick(1e-3, *moving(humanoid, 2))
    for values, before in zip((first.tau, *first.f.values()), kept, strict=True):
        np.testing.assert_array_equal(values, before)
    with pytest.raises(WbcError, match="before the next tick"):
        _ = first.solution


# ---- programming errors raise, numbers do not
def test_an_attribute_that_does_not_exist_is_refused_and_so_is_another_setting(arm: Any) -> None:
    control, recorder = reaching(arm), wbc.Recorder(2)
    command = recorder.tick(control, 0.0, arm.q0, np.zeros(arm.nv))
    for thing in (control, command, recorder, recorder.run(), wbc.Setpoint(control), control.stack):
        with pytest.raises(AttributeError, match="stak"):
            thing.stak = 3  # type: ignore[union-attr]
    for fixed in ("level", "hierarchy", "solver"):
        with pytest.raises(AttributeError, match=fixed):
            setattr(control, fixed, getattr(control, fixed))
    with pytest.raises(NotSupported, match=r"controller\.replace\(stack\)"):
        control.stack = wbc.Stack([T.Posture(arm.q0)])


@pytest.mark.parametrize("weight", [1e-4, 1e-2, 1.0, 30.0])
def test_what_is_left_of_a_level_is_weighted_and_called_so(arm: Any, weight: float) -> None:
    levels = wbc.Stack([[T.Position("tool", target=[0.4, 0.2, 0.5])], [T.Posture(arm.q0 + 0.3, weight=weight)]])
    control = wbc.Controller(arm, levels, level=wbc.VelocityLevel(), hierarchy=wbc.Strict())
    control.tick(0.0, arm.q0, np.zeros(7))
    said = control.explain()
    (of_level,) = re.findall(r"2\. Posture: weighted residual ([\d.e+-]+), the least possible \(optimal\)", said)
    (of_task,) = re.findall(r"  Posture: error .* residual ([\d.e+-]+) rad/s", said)
    assert float(of_level) == pytest.approx(weight**0.5 * float(of_task), rel=0.01)


def test_a_task_has_all_the_units_of_its_rows(arm: Any) -> None:
    stack = wbc.Stack(
        [T.Frame("tool", target=np.eye(4)), T.Position("elbow", target=np.zeros(3)), T.Damping(weight=1e-3)]
    )
    control = wbc.Controller(arm, stack, level=wbc.VelocityLevel())
    control.tick(0.0, arm.q0, np.zeros(7))
    units = {task.name: task.unit for task in control.qp.tasks}
    assert units["Frame[tool]"] == "m/s, rad/s" and units["Position[elbow]"] == "m/s" and units["Damping"] == "rad/s"


@pytest.mark.parametrize("level", [wbc.VelocityLevel(), wbc.AccelerationLevel(), wbc.InverseDynamics()])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_state_that_is_not_finite_gives_the_last_command_then_brakes(arm: Any, level: Any, bad: float) -> None:
    stack = wbc.Stack([T.Position("tool", target=[0.5, 0.2, 0.4]), T.Posture(arm.q0, weight=1e-2)])
    control = wbc.Controller(arm, stack, level=level, recovery=wbc.Recovery(hold_ticks=2))
    q, v = moving(arm, 3)
    good = control.tick(0.0, q, v)
    broken = q.copy()
    broken[2] = bad
    for k in range(2):
        held = control.tick(k * 1e-3, broken, v)
        assert (held.status, held.fallback_level) == (Status.INVALID_STATE, "hold")
        np.testing.assert_array_equal(held.tau, good.tau)
        np.testing.assert_array_equal(*((c.v if level.order == 1 else c.a) for c in (held, good)))
    damped = control.tick(3e-3, broken, v)
    assert damped.fallback_level == "damped"
    decided = damped.tau if level.dynamics else damped.v
    assert np.isfinite(decided).all()
    assert not damped.certificate.ok
    again = control.tick(4e-3, q, v)
    assert (again.status, again.fallback_level) == (Status.SOLVED, "solved")


def test_a_quaternion_is_normalised_or_refused(humanoid: Any) -> None:
    v = np.zeros(humanoid.nv)
    control = wbc.Controller(humanoid, standing(humanoid), level=wbc.InverseDynamics())
    q = humanoid.integrate(humanoid.q0, np.r_[0.0, 0.0, 0.0, 0.1, 0.2, 0.0, np.zeros(humanoid.nj)])
    good = control.tick(0.0, q, v)
    near = q.copy()
    near[3:7] *= 1.0005
    np.testing.assert_allclose(control.tick(0.0, near, v).tau, good.tau, atol=1e-4)
    for norm in (0.0, 1e-3, 1.05, 2.0, 1e90):
        far = q.copy()
        far[3:7] *= norm
        command = control.tick(0.0, far, v)
        assert command.status is Status.INVALID_STATE
        assert np.isfinite(np.r_[command.tau, command.a, command.q]).all()
        assert "quaternion" in control.explain()


@pytest.mark.parametrize("level", [wbc.VelocityLevel(), wbc.AccelerationLevel()])
@pytest.mark.parametrize("hold_ticks", [0, 200])
def test_what_is_commanded_without_a_solution_keeps_the_joints_limits(arm: Any, level: Any, hold_ticks: int) -> None:
    reach = T.Position("tool", target=lambda t: np.full(3, 0.6 if t < 0.05 else np.nan), rate=100.0, kp=400)
    stack = wbc.Stack(
        [reach, T.Posture(arm.q0, weight=1e-3)], subject_to=[T.JointVelocityLimits(1.0), T.JointPositionLimits()]
    )
    control = wbc.Controller(arm, stack, level=level, dt=0.01, recovery=wbc.Recovery(hold_ticks=hold_ticks))
    q, v = np.array(arm.q0), np.zeros(7)
    for k in range(150):
        command = control.tick(k * 0.01, q, v)
        q, v = command.q, command.v
        assert np.abs(v).max() <= 1.0 + 1e-9
        assert (q >= arm.limits.q_min - 1e-9).all() and (q <= arm.limits.q_max + 1e-9).all()
    assert not command.status.ok
    if hold_ticks == 0:
        assert np.abs(v).max() < 1e-3, "the robot has come to rest"


def test_a_solution_is_not_read_after_reset_and_is_nan_where_there_is_none(arm: Any) -> None:
    control = reaching(arm)
    q, v = moving(arm, 1)
    command = control.tick(0.0, q, v)
    control.reset()
    control.tick(0.0, *moving(arm, 2))
    with pytest.raises(WbcError, match="before the next tick"):
        _ = command.solution
    bad = control.tick(0.0, np.full(7, np.nan), v).solution
    assert np.isnan(np.r_[bad.x, bad.y, bad.z, bad.z_box]).all()


def test_qps_that_are_kept_stay_what_they_were(arm: Any) -> None:
    control = reaching(arm)
    kept = []
    for k in range(2):
        control.tick(0.0, *moving(arm, k))
        kept.append(control.qp)
    assert not np.array_equal(kept[0].g, kept[1].g)


def test_reset_makes_contacts_anew(humanoid: Any) -> None:
    control = wbc.Controller(humanoid, standing(humanoid), level=wbc.InverseDynamics())
    zero = np.zeros(humanoid.nv)
    start = control.tick(0.0, humanoid.q0, zero)
    moved = humanoid.integrate(humanoid.q0, np.r_[0.0, 0.0, 0.05, np.zeros(humanoid.nv - 3)])
    pulled = control.tick(0.0, moved, zero)
    assert np.abs(pulled.a).max() > np.abs(start.a).max() + 1.0
    control.reset()
    state = humanoid.state()
    state.update(0.0, moved, zero)
    control.stack.tasks[0].target = state.com + np.array([0.0, 0.02, 0.0])
    np.testing.assert_allclose(control.tick(0.0, moved, zero).tau, start.tau, atol=1e-6)


# ---- explain
def test_explain_names_tasks_rows_and_multipliers_in_units(humanoid: Any) -> None:
    stack = standing(humanoid, shift=0.3)
    control = wbc.Controller(humanoid, stack, level=wbc.InverseDynamics())
    assert control.explain() == "no tick yet"
    command = control.tick(0.0, humanoid.q0, np.zeros(humanoid.nv))
    text = control.explain()
    for words in (
        "CenterOfMass: error 0.3 m",
        "% of the cost",
        "Posture: error",
        "friction[",
        "per N",
        "regularisation",
    ):
        assert words in text, text
    shares = [float(line.split(",")[-1].split("%")[0]) for line in text.splitlines() if "% of the cost" in line]
    assert sum(shares) == pytest.approx(100.0, abs=0.3)
    active = command.solution
    assert (np.abs(active.z) > 1e-6).sum() <= text.count("multiplier")


def test_a_problem_that_there_is_not_is_not_saved(arm: Any, tmp_path: Any) -> None:
    control, file = reaching(arm), tmp_path / "problem.npz"
    with pytest.raises(InvalidInput, match="there is no problem that could be saved: there is no tick yet"):
        control.explain(save=file)
    control.tick(0.0, np.full(7, np.nan), np.zeros(7))
    with pytest.raises(InvalidInput, match=r"no problem .*: the state of the last tick is invalid: q\[0\] is nan"):
        control.explain(save=file)
    assert not file.exists() and "q[0] is nan" in control.explain()
    control.tick(0.0, arm.q0, np.zeros(7))
    control.explain(save=file)
    assert file.exists()


def test_a_tick_without_a_problem_is_not_explained_by_the_rows_of_the_tick_before(arm: Any, tmp_path: Any) -> None:
    """Two rows that contradict each other say nothing of the tick after, in which a sensor fails."""

    def high(t: float) -> list[float]:
        if t > 1.5:
            raise ValueError("camera lost")
        return [0.4, 0.2, 4.0]

    exact = T.Position("tool", target=high, kp=400.0, name="high").exactly()
    stack = wbc.Stack([T.Posture(arm.q0)], subject_to=[exact, T.JointVelocityLimits(1e-2)])
    control, q = wbc.Controller(arm, stack, level=wbc.VelocityLevel()), arm.q0
    for broken in (q, np.full(7, np.nan)):
        control.tick(1.0, q, np.zeros(7))
        assert "cannot hold together" in control.explain()
        control.tick(2.0, broken, np.zeros(7))
        text = control.explain()
        assert control.why in text and "cannot hold together" not in text and "against" not in text
        with pytest.raises(InvalidInput, match="no problem that could be saved"):
            control.explain(save=tmp_path / "none.npz")


def test_a_task_that_is_done_in_part_is_as_near_as_its_direction_and_its_share_are_proved_to_be(arm: Any) -> None:
    reach = T.Position("tool", target=[1.5, 1.2, 0.8], weight=[4.0, 9.0, 16.0])
    stack = wbc.Stack([[reach], [T.Posture(arm.q0)]], subject_to=[T.JointVelocityLimits()])
    controller = wbc.Controller(arm, stack, level=wbc.VelocityLevel(), hierarchy=wbc.Scaled())
    proof, p = controller.tick(0.0, arm.q0, np.zeros(arm.nv)).certificate, controller.plan.problem
    known = dict.fromkeys(proof.bounds, 0.0)
    direction, share = f"direction of {reach.name}", f"share of {reach.name}"
    assert proof.ok and {direction, share} <= known.keys()
    for part in (direction, share):  # both in the unit of the task, whatever its rows weigh
        assert distances(p, known | {part: 1e-3})[reach.name] == pytest.approx(1e-3)
        assert np.isnan(distances(p, {name: bound for name, bound in known.items() if name != part})[reach.name])


def test_a_controller_says_what_it_is_when_it_is_printed():
    robot = wbc.load("arm")
    stack = wbc.Stack([T.Posture(robot.q0)])
    made = wbc.Controller(robot, stack, level=wbc.VelocityLevel(), hierarchy=wbc.Weighted(), solver="daqp", dt=2e-3)
    assert repr(made) == "Controller(arm, velocity level, Weighted(), daqp, dt=0.002)"
