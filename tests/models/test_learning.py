"""A state computes what is read from it and nothing else, and the order of reading does not show in the answers."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wbc.models import RobotState, load

HUMANOID = load("humanoid")
READS: dict[str, Callable[[RobotState], np.ndarray]] = {
    "M": lambda s: s.M,
    "h": lambda s: s.h,
    "g": lambda s: s.g,
    "coriolis": lambda s: s.coriolis,
    "com": lambda s: s.com,
    "com_jacobian": lambda s: s.com_jacobian,
    "com_drift": lambda s: s.com_drift,
    "centroidal_map": lambda s: s.centroidal_map,
    "centroidal_drift": lambda s: s.centroidal_drift,
    "position": lambda s: s.frame("left_hand").position,
    "rotation": lambda s: s.frame("left_sole").rotation,
    "placement": lambda s: s.frame("torso").placement.homogeneous,
    "jacobian": lambda s: s.frame("left_hand").jacobian(),
    "jacobian_local": lambda s: s.frame("left_sole").jacobian_local(),
    "drift": lambda s: s.frame("left_hand").drift(),
    "drift_local": lambda s: s.frame("left_sole").drift_local(),
}
DYNAMICS = (
    "crba", "nonLinearEffects", "centerOfMass", "forwardKinematics", "computeGeneralizedGravity",
    "computeCoriolisMatrix", "ccrba", "computeCentroidalMomentumTimeVariation",
)  # fmt: skip


def moments(seed: int, number: int) -> list[tuple[np.ndarray, np.ndarray]]:
    rng = np.random.default_rng(seed)
    return [(HUMANOID.random_configuration(rng), rng.normal(size=HUMANOID.nv)) for _ in range(number)]


def fresh(read: str, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """What a state says that was never asked for anything else."""
    state = HUMANOID.state()
    state.update(0.0, q, v)
    return np.array(READS[read](state))


@given(
    rounds=st.lists(st.lists(st.sampled_from(sorted(READS)), max_size=8), min_size=1, max_size=4),
    seed=st.integers(0, 999),
)
def test_any_order_of_reading_gives_the_bits_of_a_fresh_state(rounds: list[list[str]], seed: int):
    state = HUMANOID.state()
    for (q, v), reads in zip(moments(seed, len(rounds)), rounds, strict=True):
        state.update(0.0, q, v)
        for read in reads:
            assert np.array_equal(READS[read](state), fresh(read, q, v)), read


@given(order=st.permutations(sorted(READS)), seed=st.integers(0, 999))
def test_reading_one_thing_more_does_not_move_what_was_read(order: list[str], seed: int):
    state = HUMANOID.state()
    state.update(0.0, *moments(seed, 1)[0])
    first = {read: np.array(READS[read](state)) for read in order}
    assert all(np.array_equal(READS[read](state), first[read]) for read in order)


def test_nothing_is_computed_that_nobody_reads():
    state = HUMANOID.state()
    state.update(0.0, *moments(0, 1)[0])
    assert state.calls == ()


def test_a_velocity_controller_computes_no_dynamics(monkeypatch: pytest.MonkeyPatch):
    for name in DYNAMICS:
        monkeypatch.setattr(pin, name, lambda *_, name=name: pytest.fail(f"{name} was called"))
    state = HUMANOID.state()
    for q, v in moments(1, 3):
        state.update(0.0, q, v)
        for read in ("position", "rotation", "placement", "jacobian", "jacobian_local", "com", "com_jacobian"):
            READS[read](state)
    assert state.calls[0] == "jacobianCenterOfMass"
    assert [call.partition("[")[0] for call in state.calls[1:]] == ["updateFramePlacement"] * 3


@pytest.mark.parametrize(
    ("reads", "calls"),
    [
        (["position"], ["computeJointJacobians"]),
        (["jacobian", "com"], ["jacobianCenterOfMass"]),
        (["jacobian", "drift"], ["forwardKinematics", "computeJointJacobians"]),
        (["M", "h", "drift"], ["crba", "nonLinearEffects", "gravity", "accelerations"]),
        (
            ["M", "h", "drift", "com", "com_jacobian", "com_drift"],
            ["crba", "nonLinearEffects", "gravity", "accelerations", "centerOfMass", "jacobianCenterOfMass"],
        ),
        (
            ["drift", "centroidal_map", "centroidal_drift"],
            ["ccrba", "forwardKinematics", "computeCentroidalMomentumTimeVariation", "computeJointJacobians"],
        ),
    ],
)
def test_needs_are_learnt_and_met_with_the_fewest_calls(reads: list[str], calls: list[str]):
    state = HUMANOID.state()
    for read in reads:
        READS[read](state)
    assert [call for call in state.calls if not call.startswith("updateFramePlacement")] == calls


@pytest.mark.parametrize("drifts", [True, False])
def test_the_halves_of_a_drift_are_the_drift_and_nothing_that_was_not_computed_can_be_written(drifts: bool):
    state = HUMANOID.state(drifts=drifts)
    state.update(0.0, *moments(3, 1)[0])
    hand = state.frame("left_hand")
    halves = np.concatenate([hand.linear_drift(), hand.angular_drift()])
    assert np.array_equal(halves, hand.drift(), equal_nan=True) and np.isnan(halves).all() != drifts
    if not drifts:
        for shared in (hand.drift(), hand.linear_drift(), hand.angular_drift(), hand.drift_local(), state.com_drift):
            with pytest.raises(ValueError, match="read-only"):
                shared[0] = 0.0


def test_a_frame_follows_the_state():
    state = HUMANOID.state()
    hand = state.frame("left_hand")
    position, rotation, placement = hand.position, hand.rotation, hand.placement
    for q, v in moments(2, 3):
        state.update(0.0, q, v)
        assert np.array_equal(position, fresh("position", q, v))
        assert np.array_equal(placement.translation, position) and np.array_equal(placement.rotation, rotation)
        assert np.array_equal(hand.jacobian(), fresh("jacobian", q, v))
        assert np.array_equal(hand.drift(), fresh("drift", q, v))
    assert state.frame("left_hand") is hand


def test_views_taken_once_stay_right():
    state = HUMANOID.state()
    kept = ("M", "h", "g", "coriolis", "com", "com_jacobian", "com_drift", "centroidal_map", "centroidal_drift")
    views = {read: READS[read](state) for read in kept}
    q, v = moments(3, 1)[0]
    state.update(0.0, q, v)
    assert all(np.array_equal(view, fresh(read, q, v)) for read, view in views.items())


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
    other = duplicate(state)
    state.update(2.5, *there)
    assert other.t == 1.5
    assert all(np.array_equal(READS[read](other), fresh(read, *here)) for read in READS)
    assert all(np.array_equal(READS[read](state), fresh(read, *there)) for read in READS)


def test_a_copied_frame_belongs_to_a_copied_state():
    state = HUMANOID.state()
    here, there = moments(5, 2)
    state.update(0.0, *here)
    twin = pickle.loads(pickle.dumps(state.frame("left_hand")))
    state.update(0.0, *there)
    assert np.array_equal(twin.position, fresh("position", *here))


def test_states_of_one_robot_do_not_share_memory():
    one, other = HUMANOID.state(), HUMANOID.state()
    here, there = moments(6, 2)
    one.update(0.0, *here)
    other.update(0.0, *there)
    assert np.array_equal(one.M, fresh("M", *here)) and np.array_equal(other.M, fresh("M", *there))


def test_a_robot_is_a_value():
    assert copy.deepcopy(HUMANOID) is HUMANOID
    twin = pickle.loads(pickle.dumps(HUMANOID))
    assert twin.joint_names == HUMANOID.joint_names and np.array_equal(twin.q0, HUMANOID.q0)
    assert np.array_equal(twin.state().M, HUMANOID.state().M)
