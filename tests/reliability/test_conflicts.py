"""What contradicts itself in a stack is named: exactly where it is known, irreducibly where there are several."""

from __future__ import annotations

from itertools import takewhile

import numpy as np
import pytest

import wbc
from tasks import CenterOfMass, ContactForce, JointVelocity, JointVelocityLimits, Posture, TorqueLimits
from tests.reliability.conflicts import LEVEL, ROBOTS, Case, can_be_met, lowered, one_conflict, quiet, several_conflicts
from tests.stack.conftest import feet
from wbc.errors import Infeasible
from wbc.qp.conflict import conflict
from wbc.qp.problem import QP
from wbc.qp.solver import Solver
from wbc.qp.solvers import Osqp, Piqp

FEW, MANY = range(4), range(4, 80)


def check_one(case: Case) -> None:
    """The conflict is the one that was made, and each amount what it was made of."""
    qp, _ = lowered(case.robot, case.stack, case.q, case.v)
    found = conflict(qp)
    assert found is not None
    amounts = dict(zip(found.items, (give.amount for give in found.gives), strict=True))
    assert set(amounts) == set(case.expected), found
    assert len({qp.rows[i].owner for i in amounts}) >= 2
    for item, amount in case.expected.items():
        assert amounts[item] == pytest.approx(amount, rel=1e-4, abs=1e-6), qp.rows[item]


def check_several(case: Case) -> None:
    """The rows told cannot be met, and can without any one of them."""
    qp, _ = lowered(case.robot, case.stack, case.q, case.v)
    found = conflict(qp)
    if found is None:
        assert can_be_met(qp, range(len(qp.rows)))
        return
    assert not can_be_met(qp, found.items)
    for item in found.items:
        assert can_be_met(qp, set(found.items) - {item}), qp.rows[item]


@pytest.mark.parametrize("seed", [*FEW, *(pytest.param(seed, marks=pytest.mark.deep) for seed in MANY)])
@pytest.mark.parametrize("robot", ROBOTS)
def test_a_conflict_that_is_known_is_found_exactly(robot: str, seed: int):
    check_one(one_conflict(robot, seed))


@pytest.mark.parametrize("seed", [*FEW, *(pytest.param(seed, marks=pytest.mark.deep) for seed in MANY)])
@pytest.mark.parametrize("robot", ROBOTS)
def test_of_several_conflicts_one_is_told_irreducibly(robot: str, seed: int):
    check_several(several_conflicts(robot, seed))


@pytest.mark.parametrize("name", ROBOTS)
def test_a_conflict_is_told_in_a_symmetric_stance_whose_zeros_are_rounding(name: str):
    robot = wbc.load(name)
    for way in np.eye(3):
        far = CenterOfMass(target=robot.state().com + 5.0 * way, kp=100.0).exactly()
        contacts = feet(robot) if robot.nb else []
        stack = wbc.Stack([Posture(robot.q0)], contacts=contacts, subject_to=[TorqueLimits(), far])
        check_several(Case(robot, stack, robot.q0, np.zeros(robot.nv), {}))


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_text_is_the_same_whichever_solver_failed(robot: str):
    case = one_conflict(robot, 0)
    online = [name for name in wbc.solvers() if not wbc.qp.solvers.by_name(name).offline]
    texts = set()
    for solver in online:
        try:
            control = wbc.Controller(case.robot, case.stack, level=LEVEL, solver=solver)
        except Infeasible as refusal:  # it holds in every state
            texts.add(str(refusal))
            continue
        command = control.tick(0.0, case.q, case.v)
        assert not command.status.ok and np.isfinite(command.tau).all()
        texts.add(_why(control))
    assert len(online) >= 3 and len(texts) == 1, texts
    text = texts.pop()
    assert "demand" in text and ("enough would be" in text or "one of these changes is enough" in text)
    assert "joint limits" not in text, "a bound is called by the constraint that set it"


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_text_does_not_depend_on_what_the_solver_says_instead_of_a_proof(robot: str, monkeypatch):
    """A solver that stops at its iteration limit, where no multipliers prove that there is no answer."""
    case = next(case for case in (one_conflict(robot, seed) for seed in range(9)) if not _refused(case))
    expected = _told(case, "daqp")
    monkeypatch.setattr("wbc.qp.solver.contradiction", lambda qp, tolerance: None)
    assert "one of these changes is enough" in expected
    assert _told(case, Osqp(max_iter=3)) == _told(case, Piqp(max_iter=2)) == expected


def _refused(case: Case) -> bool:
    try:
        wbc.Controller(case.robot, case.stack, level=LEVEL)
    except Infeasible:
        return True
    return False


def _told(case: Case, solver: str | Solver) -> str:
    control = wbc.Controller(case.robot, case.stack, level=LEVEL, solver=solver)
    assert not control.tick(0.0, case.q, case.v).status.ok
    return _why(control)


def _why(control: wbc.Controller) -> str:
    """The lines about the conflict: those between the status and what was commanded instead."""
    first, *others = control.explain().splitlines()[1:]
    return "\n".join([first, *takewhile(lambda line: line.startswith("    "), others)])


def test_the_saved_problem_says_the_same(tmp_path):
    case = one_conflict("quadruped", 1)
    control = wbc.Controller(case.robot, case.stack, level=LEVEL)
    control.tick(0.0, case.q, case.v)
    text = control.explain(save=tmp_path / "failed.npz")
    saved = conflict(QP.load(tmp_path / "failed.npz"))
    assert saved is not None and len(saved.gives) > 1
    assert all(f"    {change}" in text.splitlines() for change in saved.gives)


def test_what_no_state_can_meet_is_told_while_building():
    arm = wbc.load("arm")
    too_fast = JointVelocity(np.full(arm.nj, 2.0)).exactly()
    stack = wbc.Stack([Posture(arm.q0)], subject_to=[JointVelocityLimits(1.0), too_fast])
    with pytest.raises(Infeasible, match=r"JointVelocityLimits: .* upper bound up by 1 rad/s") as refusal:
        wbc.Controller(arm, stack, level=wbc.VelocityLevel())
    assert conflict(refusal.value.qp) == refusal.value.conflict


def test_a_force_that_friction_cannot_give_is_told_while_building():
    robot = wbc.load("quadruped")
    contacts = feet(robot)
    pull = ContactForce(contacts[0].frame, target=[0.0, 0.0, -10.0], name="pull").exactly()
    with pytest.raises(Infeasible, match=r"against .*pull exactly: fz"):
        wbc.Controller(robot, wbc.Stack([], contacts=contacts, subject_to=[pull]), level=LEVEL)


def test_a_stack_that_some_state_can_meet_is_built():
    for name in ROBOTS:
        robot = wbc.load(name)
        assert wbc.Controller(robot, quiet(robot), level=LEVEL).tick(0.0, robot.q0, np.zeros(robot.nv)).status.ok
