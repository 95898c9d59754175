"""A state computes what is read from it and nothing else; the order of reading does not show in the bits."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from operator import attrgetter
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.models.builders import at, inertial, joint, link, origin, saved
from wbc.models import RobotState, load
from wbc.models.pinocchio_ import Base

HUMANOID = load("humanoid")
OF_THE_STATE = (
    "M", "h", "g", "coriolis", "com", "com_jacobian", "com_drift", "centroidal_map", "centroidal_drift",
)  # fmt: skip
READS: dict[str, Callable[[RobotState], np.ndarray]] = {name: attrgetter(name) for name in OF_THE_STATE} | {
    "position": lambda s: s.frame("left_hand").position,
    "rotation": lambda s: s.frame("left_sole").rotation,
    "placement": lambda s: s.frame("torso").placement.homogeneous,
    "jacobian": lambda s: s.frame("left_hand").jacobian(),
    "jacobian_local": lambda s: s.frame("left_sole").jacobian_local(),
    "drift": lambda s: s.frame("left_hand").drift(),
    "drift_local": lambda s: s.frame("left_sole").drift_local(),
}
KINDS = ("revolute", "prismatic", "continuous")


def moments(seed: int, number: int) -> list[tuple[np.ndarray, np.ndarray]]:
    rng = np.random.default_rng(seed)
    return [(HUMANOID.random_configuration(rng), rng.normal(size=HUMANOID.nv)) for _ in range(number)]


def near(value: np.ndarray, other: np.ndarray) -> bool:
    """Whether two ways of computing one thing agree to their rounding."""
    return bool(np.abs(value - other).max() <= 1e-13 * (1.0 + np.abs(other).max()))


def fresh(read: str, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """What a state says that was never asked for anything else."""
    return np.array(READS[read](at(HUMANOID, q, v)))


@given(
    rounds=st.lists(st.lists(st.sampled_from(sorted(READS)), max_size=8), min_size=1, max_size=4),
    seed=st.integers(0, 999),
)
def test_any_reading_gives_what_a_fresh_state_gives(rounds: list[list[str]], seed: int):
    state = HUMANOID.state()
    for (q, v), reads in zip(moments(seed, len(rounds)), rounds, strict=True):
        state.update(0.0, q, v)
        for read in reads:
            assert near(READS[read](state), fresh(read, q, v)), read


@given(data=st.data(), reads=st.sets(st.sampled_from(sorted(READS))), seed=st.integers(0, 999))
def test_the_order_of_reading_does_not_show_in_the_bits(data: st.DataObject, reads: set[str], seed: int):
    states, moment = (HUMANOID.state(), HUMANOID.state()), moments(seed, 1)[0]
    for state in states:
        state.update(0.0, *moment)
        first = {read: np.array(READS[read](state)) for read in data.draw(st.permutations(sorted(reads)))}
        assert all(near(READS[read](state), first[read]) for read in reads)
    assert all(np.array_equal(READS[read](states[0]), READS[read](states[1])) for read in reads)


CENTRES = ("com", "com_jacobian", "com_drift", "centroidal_map")
MOMENTUM = ["ccrba", "forwardKinematics", "computeCentroidalMomentumTimeVariation", "computeJointJacobians"]


@pytest.mark.parametrize(
    ("reads", "calls"),
    [
        ([], []),
        (["position"], ["computeJointJacobians"]),
        (["position", "rotation", "placement", "jacobian_local", "com", "com_jacobian"], ["jacobianCenterOfMass"]),
        (["jacobian", "com"], ["jacobianCenterOfMass"]),
        (["jacobian", "drift"], ["forwardKinematics", "computeJointJacobians"]),
        (["M", "h", "drift"], ["crba", "nonLinearEffects", "complete"]),
        (["M", "h", "drift", *CENTRES], ["crba", "nonLinearEffects", "complete"]),
        (["M", "com"], ["crba", "complete"]),
        (["drift", "centroidal_map", "centroidal_drift"], MOMENTUM),
    ],
)
def test_needs_are_learnt_and_met_with_the_fewest_calls(reads: list[str], calls: list[str]):
    state = at(HUMANOID, *moments(0, 1)[0])
    for read in reads:
        READS[read](state)
    assert [call for call in state.calls if not call.startswith("updateFramePlacement")] == calls


def bush(folder: Path, rng: np.random.Generator, joints: int) -> Path:
    """A file whose joints begin at the base or at any link before."""

    def heavy(name: str) -> str:
        mass = rng.uniform(0.5, 3.0)
        return link(name, inertial(mass, (mass, 1.2 * mass, 0.9 * mass), origin(*rng.uniform(-1.0, 1.0, (2, 3)))))

    parts = [heavy("base")]
    for i in range(joints):
        parent, kind = rng.choice(["base", *(f"l{k}" for k in range(i))]), rng.choice(KINDS)
        place, turn, (a, b, c) = rng.uniform(-1.0, 1.0, (3, 3))
        parts += [heavy(f"l{i}"), joint(f"j{i}", parent, f"l{i}", kind, origin(place, turn), axis=f"{a} {b} {c}")]
    return saved(folder, *parts)


@given(joints=st.integers(1, 6), base=st.sampled_from(["fixed", "floating", "planar"]), seed=st.integers(0, 999))
def test_what_several_calls_share_is_what_pinocchio_says_of_each(
    tmp_path_factory: pytest.TempPathFactory, joints: int, base: Base, seed: int
):
    rng = np.random.default_rng(seed)
    robot = load(bush(tmp_path_factory.mktemp("bush"), rng, joints), base=base, feet=[])
    model, state, v = robot.pinocchio, robot.state(), rng.normal(size=robot.nv)
    data, q, still = model.createData(), robot.random_configuration(rng), np.zeros(robot.nv)
    read = {name: getattr(state, name) for name in ("M", "h", "com", "com_jacobian", "com_drift", "centroidal_map")}
    drift = state.frame(f"l{joints - 1}").drift
    state.update(0.0, q, v)
    pin.centerOfMass(model, data, q, v, still)
    said = {"com": np.array(data.com[0]), "com_drift": np.array(data.acom[0])}
    pin.forwardKinematics(model, data, q, v, still)
    frame = model.getFrameId(f"l{joints - 1}")
    assert near(drift(), pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL_WORLD_ALIGNED).vector)
    said["com_jacobian"] = np.array(pin.jacobianCenterOfMass(model, data, q)).reshape(3, -1)
    said["centroidal_map"] = np.array(pin.ccrba(model, data, q, v)).reshape(6, -1)
    said["h"] = np.array(pin.nonLinearEffects(model, data, q, v))
    said["M"] = np.array(pin.crba(model, data, q)).reshape(robot.nv, -1)
    assert all(near(read[name], value) for name, value in said.items())


@pytest.mark.parametrize("drifts", [True, False])
def test_the_halves_of_a_drift_are_the_drift_and_nothing_that_was_not_computed_can_be_written(drifts: bool):
    state = at(HUMANOID, *moments(3, 1)[0], drifts=drifts)
    hand = state.frame("left_hand")
    halves = np.concatenate([hand.linear_drift(), hand.angular_drift()])
    assert np.array_equal(halves, hand.drift(), equal_nan=True) and np.isnan(halves).all() != drifts
    if not drifts:
        for shared in (hand.drift(), hand.linear_drift(), hand.angular_drift(), hand.drift_local(), state.com_drift):
            with pytest.raises(ValueError, match="read-only"):
                shared[0] = 0.0


def test_views_taken_once_stay_right():
    state = HUMANOID.state()
    views = {read: READS[read](state) for read in (*OF_THE_STATE, "position", "rotation")}
    hand = state.frame("left_hand")
    q, v = moments(3, 1)[0]
    state.update(0.0, q, v)
    assert all(near(view, fresh(read, q, v)) for read, view in views.items())
    assert state.frame("left_hand") is hand


@pytest.mark.parametrize("read", READS)
def test_what_was_read_outlives_the_state(read: str):
    q, v = moments(7, 1)[0]
    kept = [READS[read](at) for at in (HUMANOID.state() for _ in range(20)) if at.update(0.0, q, v) is None]
    others = [HUMANOID.state().M for _ in range(20)]
    assert others and all(np.array_equal(value, fresh(read, q, v)) for value in kept)


@pytest.mark.parametrize("duplicate", [copy.copy, copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))])
def test_a_copy_is_a_state_of_its_own(duplicate: Callable[[RobotState], RobotState]):
    state = HUMANOID.state()
    here, there = moments(4, 2)
    state.update(1.5, *here)
    READS["M"](state), READS["drift"](state)
    other, hand = duplicate(state), duplicate(state.frame("left_hand")) if duplicate is not copy.copy else None
    state.update(2.5, *there)
    assert other.t == 1.5
    assert all(near(READS[read](other), fresh(read, *here)) for read in READS)
    assert all(near(READS[read](state), fresh(read, *there)) for read in READS)
    assert hand is None or np.array_equal(hand.position, fresh("position", *here))


def test_a_robot_is_a_value():
    assert copy.deepcopy(HUMANOID) is HUMANOID
    twin = pickle.loads(pickle.dumps(HUMANOID))
    assert twin.joint_names == HUMANOID.joint_names and np.array_equal(twin.q0, HUMANOID.q0)
    assert np.array_equal(twin.state().M, HUMANOID.state().M)
