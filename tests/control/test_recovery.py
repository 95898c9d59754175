"""A tick that is not solved gets a command in the same tick, within limits: that of the first fallback level."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tasks as T
import wbc
from tests.families.oracle import Constraints, least_squares
from tests.reliability.faults import A_MAX, FAULTS, V_MAX, Saboteur, Script, excess, limited, sabotaged
from wbc.qp.certificate import TOLERANCE
from wbc.types import Status

LEVELS = (wbc.VelocityLevel(), wbc.AccelerationLevel(), wbc.InverseDynamics())
ARM = wbc.load("arm")
STILL = np.zeros(ARM.nv)


def named(level: Any) -> str:
    return str(level.name)


@pytest.mark.parametrize("level", LEVELS, ids=named)
@pytest.mark.parametrize("fault", FAULTS)
def test_another_solver_answers_what_the_one_asked_for_does_not(level: Any, fault: str):
    control, script = sabotaged(ARM, level)
    good = control.tick(0.0, ARM.q0, STILL)
    script.fault = fault
    command = control.tick(1e-3, ARM.q0, STILL)
    assert command.status is Status.SOLVED and command.certificate.ok
    assert command.fallback_level == ("solved" if fault == "late" else "other solver")
    decided, before = ((c.v if level.order == 1 else c.a) for c in (command, good))
    np.testing.assert_allclose(decided, before, atol=1e-4)


@pytest.mark.parametrize("level", LEVELS, ids=named)
@pytest.mark.parametrize("limits", [T.JointVelocityLimits(0.5), T.JointPositionLimits()], ids=str)
def test_another_solver_decides_all_along_what_the_one_asked_for_decides(level: Any, limits: Any):
    """A target out of reach: what the ticks before left of it damps the joints, and motors have to be able to stop."""

    def control(**settings: Any) -> wbc.Controller:
        tasks = [T.Position("tool", target=[0.4, 0.2, 5.5], kp=2000.0), T.Posture(ARM.q0, weight=1e-3)]
        torque = [T.TorqueLimits()] if level.dynamics else []
        return wbc.Controller(ARM, wbc.Stack(tasks, subject_to=[limits, *torque]), level=level, **settings)

    sound, broken = control(), control(solver=Saboteur(script=Script("raises")))
    q, v = ARM.q0, STILL
    for k in range(150):
        expected, command = sound.tick(1e-3 * k, q, v), broken.tick(1e-3 * k, q, v)
        assert (command.status, command.fallback_level) == (expected.status, "other solver")
        np.testing.assert_allclose(command.v, expected.v, atol=1e-9)
        q, v = expected.q, expected.v


@pytest.mark.parametrize("level", LEVELS, ids=named)
@pytest.mark.parametrize(
    "faults", [("iterations", "unproved"), ("unproved", "iterations"), ("unproved", "unproved")], ids="/".join
)
def test_an_answer_within_the_limits_that_is_not_proved_best_serves_whichever_solver_found_it(
    level: Any, faults: tuple[str, str]
):
    control, script = sabotaged(ARM, level)
    second = Saboteur()
    control.mode.second = wbc.Weighted().open(control.plan.problem, second)
    control.tick(0.0, ARM.q0, STILL)
    script.fault, second.script.fault = faults
    command = control.tick(1e-3, ARM.q0, STILL)
    assert (command.status, command.fallback_level) == (Status.INACCURATE, "not certified")
    assert not command.certificate.ok and command.certificate.primal <= TOLERANCE
    assert control.why and control.why in control.explain()
    assert excess(control, command) <= 1e-9


@pytest.mark.parametrize("level", LEVELS, ids=named)
def test_a_tick_without_an_answer_leaves_its_problem_as_it_was(level: Any):
    """``explain`` reads it afterwards: bounds of another state would show a conflict that there is not, or hide one."""
    control = wbc.Controller(ARM, limited(ARM, level), level=level, recovery=wbc.Recovery(hold_ticks=1))
    control.tick(0.0, ARM.q0, np.full(ARM.nv, 0.3))
    asked = control.plan.problem.lb.copy(), control.plan.problem.ub.copy()
    for k in range(1, 5):
        command = control.tick(1e-3 * k, np.full(ARM.nq, np.nan), STILL)
    assert command.fallback_level == "damped"
    np.testing.assert_array_equal((control.plan.problem.lb, control.plan.problem.ub), asked)


def test_a_reset_forgets_what_the_other_solver_knows_too(monkeypatch: pytest.MonkeyPatch) -> None:
    control, script = sabotaged(ARM, wbc.VelocityLevel())
    script.fault = "iterations"
    assert control.tick(0.0, ARM.q0, STILL).fallback_level == "other solver"
    asked, other = list[object](), control.mode.second
    monkeypatch.setattr(type(other), "reset", lambda self: asked.append(self))
    control.reset()
    assert any(one is other for one in asked)


def test_what_a_back_end_raises_is_said():
    control, script = sabotaged(ARM, wbc.VelocityLevel(), other=False)
    script.fault = "raises"
    assert control.tick(0.0, ARM.q0, STILL).status is Status.FAILED
    assert "'saboteur' raised Breakdown: the back end broke down" in control.explain()


@pytest.mark.parametrize("level", LEVELS, ids=named)
def test_fallback_levels_follow_one_another_down_to_a_stop_and_back(level: Any):
    control, script = sabotaged(ARM, level, other=False, recovery=wbc.Recovery(hold_ticks=3, resume_after=2))
    control.tick(0.0, ARM.q0, STILL)
    script.fault = "iterations"
    levels = [control.tick(1e-3 * k, ARM.q0, STILL).fallback_level for k in range(1, 6)]
    assert levels == ["closed form"] * 3 + ["damped"] * 2
    script.fault = ""
    levels = [control.tick(1e-3 * k, ARM.q0, STILL).fallback_level for k in range(6, 9)]
    assert levels == ["damped", "solved", "solved"]
    assert [event.fallback_level for event in control.fallbacks.log] == ["closed form"] * 3 + ["damped"] * 3 + [
        "solved"
    ]
    assert control.fallbacks.log[-1].why == "solved again after 5 failures"
    assert control.fallbacks.counts["damped"] == 3


@pytest.mark.parametrize("level", LEVELS, ids=named)
@pytest.mark.parametrize("answer", ["solved", "other solver", "relaxed"])
@pytest.mark.parametrize("wait", [1, 3])
def test_a_stop_ends_after_as_many_answers_in_a_row_as_were_asked_for_and_none_before_is_ok(
    level: Any, answer: str, wait: int
):
    up = T.Position("tool", target=[0.5, 0.2, 5.0], kp=1e4, name="up").exactly()
    stack = limited(ARM, level, extra=(up,) if answer == "relaxed" else ())
    control, script = sabotaged(ARM, level, stack=stack, recovery=wbc.Recovery(hold_ticks=0, resume_after=wait))
    lost = np.full(ARM.nq, np.nan)
    for start in (0, 10):
        assert control.tick(1e-3 * start, lost, STILL).fallback_level == "damped"
        script.fault = "iterations" if answer == "other solver" else ""
        for k in range(1, wait + 1):
            command = control.tick(1e-3 * (start + k), ARM.q0, STILL)
            assert command.fallback_level == ("damped" if k < wait else answer)
            assert command.status.ok == (k == wait and answer != "relaxed")
            assert command.certificate.ok == (k == wait)
            assert bool(control.why) != command.status.ok


@pytest.mark.parametrize("level", LEVELS, ids=named)
@pytest.mark.parametrize("torques_alone", [False, True])
def test_relaxed_constraints_are_declared(level: Any, torques_alone: bool):
    """Limits on torques alone bound what is commanded, too."""
    up = T.Position("tool", target=[0.5, 0.2, 5.0], kp=1e4, name="up").exactly()
    stack = limited(ARM, level, extra=(up,))
    if torques_alone and level.dynamics:
        stack = wbc.Stack([T.Posture(ARM.q0)], subject_to=[up, T.TorqueLimits(1.0)])
    for relax, expected in ((("constraints",), "relaxed"), (("contacts",), "closed form"), ((), "closed form")):
        control = wbc.Controller(ARM, stack, level=level, recovery=wbc.Recovery(relax=relax))
        command = control.tick(0.0, ARM.q0, STILL)
        assert (command.status, command.fallback_level) == (Status.INFEASIBLE, expected)
        assert command.certificate.ok == (expected == "relaxed"), "of the relaxed problem"
        assert excess(control, command) <= 1e-9
        text = control.explain()
        assert all(words in text for words in ("infeasible", "up exactly", "Limits", "instead: ")), text


@pytest.mark.parametrize("seed", range(4))
def test_the_three_rows_relaxed_most_are_named_the_largest_first(seed: int):
    """Joint i is asked to move faster than it may, by ``beyond`` of its own: that is what its row is relaxed by."""
    beyond = np.random.default_rng(seed).permutation(np.arange(1.0, 8.0)) / 8.0
    posture = T.Posture(ARM.q0 + 0.2 * (1.0 + beyond), rate=5.0).exactly()
    stack = wbc.Stack([T.Posture(ARM.q0, name="rest")], subject_to=[posture, T.JointVelocityLimits(1.0)])
    control = wbc.Controller(ARM, stack, level=wbc.VelocityLevel())
    assert control.tick(0.0, ARM.q0, STILL).fallback_level == "relaxed"
    said = [part.rsplit(" by ", 1) for part in control.why.removeprefix("relaxed: ").split(", ")]
    most = np.argsort(-beyond)[:3]
    assert [name.split()[-1] for name, _ in said] == [ARM.joint_names[i] for i in most]
    assert [float(amount.split()[0]) for _, amount in said] == pytest.approx(beyond[most], abs=1e-3)


@pytest.mark.parametrize("free", [(2,), (0, 3, 4, 6)])
def test_nothing_is_relaxed_where_a_joint_has_no_limits_and_the_reason_names_it(free: tuple[int, ...]):
    v_max = np.ones(ARM.nj)
    v_max[list(free)] = np.inf
    posture = T.Posture(ARM.q0 + 1.0, rate=5.0).exactly()
    stack = wbc.Stack([T.Posture(ARM.q0, name="rest")], subject_to=[posture, T.JointVelocityLimits(v_max)])
    control = wbc.Controller(ARM, stack, level=wbc.VelocityLevel())
    command = control.tick(0.0, ARM.q0, STILL)
    assert command.status is Status.INFEASIBLE and command.fallback_level not in ("relaxed", "closed form")
    named = [name for name in ARM.joint_names if name in control.why]
    assert named == [ARM.joint_names[joint] for joint in free[:3]]
    assert ("1 more" in control.why) == (len(free) > 3)
    assert control.why in control.explain()


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("neither", [False, True])
@pytest.mark.parametrize("fault", ["contradiction", "no answer"])
def test_limits_on_the_motion_of_some_joints_and_the_torque_of_the_others_bound_all(
    seed: int, neither: bool, fault: str
):
    rng = np.random.default_rng(seed)
    of_torque = rng.random(ARM.nj) < 0.5
    a_max, tau_max = np.where(of_torque, np.inf, 20.0), np.where(of_torque, 60.0, np.inf)
    free = int(rng.integers(ARM.nj))
    if neither:
        a_max[free] = tau_max[free] = np.inf
    exact = [T.Posture(ARM.q0 + 1.0, rate=50.0).exactly()] if fault == "contradiction" else []
    stack = wbc.Stack(
        [T.Posture(ARM.q0 + rng.uniform(-1.0, 1.0, ARM.nj), rate=50.0, name="rest")],
        subject_to=[*exact, T.JointAccelerationLimits(a_max), T.TorqueLimits(tau_max)],
    )
    control, script = sabotaged(ARM, wbc.InverseDynamics(), other=False, stack=stack)
    script.fault = "iterations" if fault == "no answer" else ""
    command = control.tick(0.0, ARM.q0, STILL)
    if neither:
        assert command.fallback_level not in ("relaxed", "closed form")
        assert [name for name in ARM.joint_names if name in control.why] == (
            [ARM.joint_names[free]] if fault == "contradiction" else []
        )
        return
    assert command.fallback_level == "relaxed" if fault == "contradiction" else command.fallback_level != "relaxed"
    assert command.certificate.ok == (fault == "contradiction")
    assert (np.abs(command.tau) <= tau_max).all() and np.abs(command.tau).max() < 1e3
    a = np.linalg.solve(control.state.M, command.tau - control.state.h)
    assert (np.abs(a) <= a_max + 1e-6).all()


@pytest.mark.parametrize("kp", [1.0, 100.0, 1e4, 1e6])
@pytest.mark.parametrize("seed", range(3))
def test_limits_are_relaxed_as_little_as_can_be_however_hard_targets_pull(kp: float, seed: int):
    rng = np.random.default_rng(seed)
    q = np.clip(ARM.q0 + rng.uniform(-0.5, 0.5, ARM.nj), ARM.limits.q_min, ARM.limits.q_max)
    state = ARM.state()
    state.update(0.0, q, STILL)
    weak = T.TorqueLimits(0.5 * np.abs(state.h) + 0.1)
    stack = wbc.Stack(
        [T.Posture(q + rng.uniform(-2.0, 2.0, ARM.nj), kp=kp)], subject_to=[T.JointAccelerationLimits(1.0), weak]
    )
    control = wbc.Controller(ARM, stack, level=wbc.InverseDynamics())
    command = control.tick(0.0, q, STILL)
    assert command.fallback_level == "relaxed" and command.certificate.ok
    qp, n = control.qp, control.qp.n
    slack = np.maximum(np.abs(command.a) - 1.0, 0.0)
    # the oracle: x and the slacks of the bounds on x, of which nothing but the slacks counts
    rows = np.block([[qp.C, np.zeros((len(qp.C), n))], [np.eye(n), -np.eye(n)]])
    within = Constraints(
        np.hstack([qp.A, np.zeros((len(qp.A), n))]), qp.b, rows,
        np.concatenate([qp.cl, qp.lb]), np.concatenate([qp.cu, qp.ub]),
    )  # fmt: skip
    slacks = np.hstack([np.zeros((n, n)), np.eye(n)])
    least = least_squares(slacks, np.zeros(n), within, np.ones(2 * n))
    assert least is not None and slack.max() > 1.0
    assert slack @ slack == pytest.approx(least.x[n:] @ least.x[n:], rel=1e-2)


@pytest.mark.parametrize("dt", [1e-3, 0.2])
def test_without_limits_nothing_but_the_problem_itself_is_solved_and_braking_is_stable(dt: float):
    up, down = (T.Position("tool", target=[0.5, 0.2, z], kp=20.0, name=f"to {z:g}") for z in (5.0, -5.0))
    stack = wbc.Stack([T.Posture(ARM.q0, kp=20.0)], subject_to=[up.exactly(), down.exactly()])
    control = wbc.Controller(ARM, stack, level=wbc.AccelerationLevel(), dt=dt)
    q, v = ARM.q0, np.full(ARM.nv, 0.1)
    for k in range(10):
        command = control.tick(k * dt, q, v)
        assert command.fallback_level == "damped"
        q, v = command.q, command.v
    assert np.abs(v).max() <= 0.1


def real_step(level: Any, command: wbc.Command, q: Any, v: Any, dt: float) -> tuple[Any, Any]:
    """What the robot does: torques through its dynamics, else what was decided."""
    if not level.dynamics:
        return command.q, command.v
    state = ARM.state()
    state.update(0.0, q, v)
    a = np.linalg.solve(state.M, command.tau - state.h)
    return ARM.integrate(q, dt * (v + 0.5 * dt * a)), v + dt * a


@pytest.mark.parametrize("level", LEVELS, ids=named)
@pytest.mark.parametrize("fault", ["iterations", "nan state"])
def test_failures_in_a_row_end_in_a_stop_in_time(level: Any, fault: str):
    """At rest v_max / a_max and two ticks after the last fallback level above the last, limits kept on the way."""
    dt, hold = 1e-3, 3
    for seed in range(4):
        rng = np.random.default_rng(seed)
        q, v = np.array(ARM.q0), rng.choice([-1.0, 1.0], ARM.nj) * rng.uniform(0.5, 1.0, ARM.nj) * V_MAX
        v[np.argmax(np.abs(v))] *= V_MAX / np.abs(v).max()
        stack = limited(ARM, level)
        control, script = sabotaged(ARM, level, other=False, stack=stack, recovery=wbc.Recovery(hold_ticks=hold))
        control.tick(0.0, q, v)
        script.fault = fault if fault in FAULTS else ""
        for k in range(1, hold + 1 + round(V_MAX / A_MAX / dt) + 2):
            seen = np.full(ARM.nq, np.nan) if fault == "nan state" else q
            command = control.tick(k * dt, seen, v)
            assert excess(control, command) <= 1e-9
            q, v = real_step(level, command, q, v, dt)
            assert np.abs(v).max() <= V_MAX + 1e-6
        assert command.fallback_level == "damped"
        # Torques without a state follow what is expected, and drift from it: a twentieth of the speed is left.
        blind = level.dynamics and fault == "nan state"
        assert np.abs(v).max() <= (V_MAX / 20.0 if blind else 1e-6)


def test_the_budget_ends_the_search_for_other_answers():
    up = T.Position("tool", target=[0.5, 0.2, 5.0], kp=1e4, name="up").exactly()
    stack = limited(ARM, wbc.VelocityLevel(), extra=(up,))
    recovery = wbc.Recovery(budget=0.0, hold_ticks=0)
    assert wbc.Controller(ARM, stack, level=wbc.VelocityLevel(), recovery=recovery).tick(
        0.0, ARM.q0, STILL
    ).fallback_level == ("damped")


def test_a_robot_that_held_as_long_as_it_may_is_not_stopped_yet():
    control, script = sabotaged(ARM, wbc.VelocityLevel(), other=False,
                                recovery=wbc.Recovery(hold_ticks=2, resume_after=3))  # fmt: skip
    control.tick(0.0, ARM.q0, STILL)
    script.fault = "iterations"
    assert [control.tick(1e-3 * k, ARM.q0, STILL).fallback_level for k in (1, 2)] == ["closed form"] * 2
    script.fault = ""
    assert control.tick(3e-3, ARM.q0, STILL).fallback_level == "solved"


@pytest.mark.parametrize("away", [0.0, 1.0])
def test_on_legs_a_closed_form_is_commanded_only_where_feet_can_carry_it(away: float):
    """A robot that pushes itself off with forces that its feet cannot give falls; holding on is better."""
    robot = wbc.load("quadruped")
    goal = T.CenterOfMass(target=robot.state().com + away * np.eye(3)[0], kp=100.0)
    stack = wbc.Stack([goal, T.Posture(robot.q0, weight=1e-2)], contacts=T.feet(robot), subject_to=[T.TorqueLimits()])
    control, script = sabotaged(robot, wbc.InverseDynamics(), other=False, stack=stack)
    good = control.tick(0.0, robot.q0, np.zeros(robot.nv))
    script.fault = "iterations"
    command = control.tick(1e-3, robot.q0, np.zeros(robot.nv))
    assert good.fallback_level == "solved" and command.fallback_level == ("hold" if away else "closed form")
    np.testing.assert_allclose(command.tau, good.tau, rtol=0, atol=1e-4)


# ---- contacts that hold more than the legs can move: the tick is relaxed, and says why
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
    contacts = [T.Point(f"foot_{leg}", friction=0.5) for leg in range(4)]
    limits = [T.JointVelocityLimits(), T.JointAccelerationLimits(20.0)]
    stack = wbc.Stack([T.Posture(robot.q0)], contacts=contacts, subject_to=limits)
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
