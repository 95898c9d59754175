"""The witness beside an oracle that shares no code with it: a linear program on the forces of the corners."""

from __future__ import annotations

import numpy as np
import pinocchio
import pytest
from scipy.optimize import linprog

import wbc
from tests.motion.test_retarget import retargeted
from wbc.errors import InvalidInput
from wbc.models.along import velocities
from wbc.motion import Fault, Verdict, Witness
from wbc.motion.witness import lacking


def possible(robot, contacts, q, v, a, share: float) -> bool:
    """Whether forces at the corners, in inner pyramids, and torques within the limits give this acceleration.

    ``share`` shrinks (below 1) or widens friction, soles and torque limits.
    """
    model, data = robot.pinocchio, robot.pinocchio.createData()
    tau = pinocchio.rnea(model, data, q, v, a)
    pinocchio.computeJointJacobians(model, data, q)
    pinocchio.updateFramePlacements(model, data)
    columns, rows = [], []
    for contact in contacts:
        frame = model.getFrameId(contact.frame)
        J = pinocchio.getFrameJacobian(model, data, frame, pinocchio.LOCAL_WORLD_ALIGNED)
        R = data.oMf[frame].rotation
        for sx, sy in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
            arm = R @ (contact.origin + share * np.append([sx, sy] * contact.half_size, 0.0))
            columns.append((R.T @ (J[:3] - pinocchio.skew(arm) @ J[3:])).T)
            mu = share * contact.friction / np.sqrt(2.0)
            rows.append([[1, 0, -mu], [-1, 0, -mu], [0, 1, -mu], [0, -1, -mu], [0, 0, -1]])
    G, n = np.hstack(columns), 3 * len(columns)
    cone = np.zeros((5 * len(rows), n))
    for i, row in enumerate(rows):
        cone[5 * i : 5 * i + 5, 3 * i : 3 * i + 3] = row
    most = share * robot.limits.tau_max
    A = np.vstack([cone, -G[6:], G[6:]])
    b = np.concatenate([np.zeros(len(cone)), most - tau[6:], most + tau[6:]])
    found = linprog(np.zeros(n), A_ub=A, b_ub=b, A_eq=G[:6], b_eq=tau[:6], bounds=(None, None))
    return bool(found.status == 0)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["squat", "walk"])
def test_forces_exist_where_the_oracle_finds_some(name: str):
    found = retargeted(name)
    robot, rng = found.robot, np.random.default_rng(5)
    v, a, _ = velocities(robot, found.q, found.rate)
    state, agreed = robot.state(), {True: 0, False: 0}
    for k in rng.choice(len(found.q), 40, replace=False):
        contacts = [contact for part, contact in found.contacts.items() if found.holds[part][k]]
        pushed = a[k].copy()
        pushed[:3] += rng.normal(size=3) * rng.choice([0.0, 1.0, 4.0])
        pushed[6:] += rng.normal(size=robot.nj) * rng.choice([0.0, 5.0, 80.0])
        state.update(0.0, found.q[k], v[k])
        faults, _ = lacking(robot, state, pushed, contacts)
        # What is decided only by a hundredth of a limit is left to either.
        if possible(robot, contacts, found.q[k], v[k], pushed, 0.99):
            assert faults == []
            agreed[True] += 1
        elif not possible(robot, contacts, found.q[k], v[k], pushed, 1.01):
            assert faults != []
            agreed[False] += 1
    assert min(agreed.values()) >= 5


def test_a_torque_beyond_its_limit_is_named_with_its_amount():
    found = retargeted("squat")
    robot, state = found.robot, found.robot.state()
    joint, contacts = robot.joint_names.index("left_elbow"), list(found.contacts.values())
    state.update(0.0, found.q[0], np.zeros(robot.nv))
    a = np.zeros(robot.nv)
    tau = pinocchio.rnea(robot.pinocchio, robot.pinocchio.createData(), found.q[0], a, a)[6 + joint]
    unit = state.M[6 + joint, 6 + joint]
    a[6 + joint] = (robot.limits.tau_max[joint] + 7.0 - tau) / unit
    amounts = {fault[:2]: fault.amount for fault in lacking(robot, state, a, contacts)[0]}
    assert amounts["torque", "left_elbow"] == pytest.approx(7.0, rel=0.01)  # no contact force can change it


def test_nothing_holds_a_robot_in_the_air():
    found = retargeted("squat")
    none = {part: np.zeros(5, dtype=bool) for part in found.contacts}
    verdicts = Witness(found.robot, found.contacts, collisions=False).judge(found.q[:5], found.rate, none)
    weight = found.robot.mass * 9.81
    assert all(one.faults[0].kind == "no force" for one in verdicts)
    assert verdicts[2].faults[0].amount == pytest.approx(weight, rel=0.1)


def test_motions_that_cannot_be_judged_are_refused():
    found = retargeted("squat")
    witness = Witness(found.robot, found.contacts)
    few = {part: held[:2] for part, held in found.holds.items()}
    short = {**found.holds, "left_foot": found.holds["left_foot"][:-1]}
    for about, (q, rate, holds) in {
        "2 frames": (found.q[:2], found.rate, few), "rate is 0": (found.q, 0.0, found.holds),
        "holds is": (found.q, found.rate, None), r"holds\[left_foot\]": (found.q, found.rate, {}),
        r"holds\[left_foot\] ": (found.q, found.rate, short),
    }.items():  # fmt: skip
        with pytest.raises(InvalidInput, match=about):
            witness.judge(q, rate, holds)
    with pytest.raises(InvalidInput, match="floating"):
        Witness(wbc.load("humanoid", base="fixed"), {})
    with pytest.raises(InvalidInput, match=r"contacts\[left_foot\]"):
        Witness(found.robot, {"left_foot": "left_sole"})


def test_a_verdict_reads_as_a_sentence():
    assert str(Verdict()) == "certified"
    assert str(Verdict((Fault("slip", "left_sole", 30.0), Fault("no force", "", 12.0)))) == (
        "slip of left_sole, 30 mm; no force, 12 N"
    )
