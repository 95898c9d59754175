"""What is called the loss of a joint, and from when on a residual is a fault, as docs/adaptive.md says."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from tasks import Thresholds
from tasks.components.diagnosis import Diagnoser, Diagnosis
from wbc.errors import InvalidInput

NAMES = ("hip", "knee", "ankle")


def diagnosed(share: float, command: np.ndarray, joint: int, ticks: int = 80) -> Diagnosis | None:
    """What is said of a joint that loses ``share`` of every command, the others nothing, without noise."""
    watcher = Diagnoser(
        NAMES, noise=np.zeros(3), lockout=0.0, settle=0.1, recheck=0.5, dominance=3.0, start=0.0
    )  # fmt: skip
    missing = np.zeros(3)
    missing[joint] = share * command[joint]
    observer = SimpleNamespace(
        command=command, known=np.zeros(3), missing=missing, residual=missing, threshold=np.full(3, 1e-3),
        alarm=np.abs(missing) > 1e-3, dt=1e-3, rows=None,
    )  # fmt: skip
    for tick in range(ticks):
        said = watcher.tick(SimpleNamespace(t=1e-3 * tick), observer)  # type: ignore[arg-type]
        if said is not None:
            return said
    return None


@given(
    share=st.one_of(st.floats(0.02, 2.0), st.sampled_from([0.14, 0.16, 0.79, 0.81, 1.29, 1.31])),
    command=st.floats(1.0, 100.0), sign=st.sampled_from([-1.0, 1.0]), joint=st.integers(0, 2),
)  # fmt: skip
def test_a_share_between_015_and_13_is_a_loss_total_above_08_and_any_other_is_a_bias(
    share: float, command: float, sign: float, joint: int
):
    said = diagnosed(share, sign * command * np.array([1.0, 2.0, 0.5]), joint)
    assert said is not None and said.joint == joint
    if 0.15 < share < 1.3:
        assert said.kind == ("total" if share > 0.8 else "partial")
        assert said.share == pytest.approx(min(share, 1.0), rel=1e-9)
    else:
        assert said.kind == "bias"


@pytest.mark.parametrize(
    ("joint", "left", "wait"), [(0, True, 0.1), (0, False, 0.1), (1, True, 0.3), (1, False, 0.3)],
    ids=["the same, left alone", "the same", "another, first left alone", "another"],
)  # fmt: skip
def test_the_same_joint_is_judged_again_once_it_has_settled_and_another_after_the_lockout(
    joint: int, left: bool, wait: float
):
    watcher = Diagnoser(
        NAMES, noise=np.zeros(3), lockout=0.3, settle=0.1, recheck=5.0, dominance=3.0, start=0.0
    )  # fmt: skip
    command, decided = np.full(3, 10.0), list[tuple[float, int]]()
    for tick in range(500):
        missing = np.zeros(3)
        if not decided:
            missing[0] = 4.0
        elif tick > round(1e3 * decided[0][0]) + 1:  # the first alarm has fallen
            missing[joint] = 4.0
        observer = SimpleNamespace(
            command=command, known=np.zeros(3), missing=missing, residual=missing, threshold=np.full(3, 1e-3),
            alarm=missing > 1e-3, dt=1e-3, rows=None,
        )  # fmt: skip
        said = watcher.tick(SimpleNamespace(t=1e-3 * tick), observer)  # type: ignore[arg-type]
        if said is not None:
            decided.append((said.t, said.joint))
            if left:
                watcher.leave(said)
    assert [who for _, who in decided[:2]] == [0, joint]
    assert decided[1][0] - decided[0][0] == pytest.approx(wait, abs=3e-3)


@given(
    deviation=st.lists(st.floats(1e-3, 1e2), min_size=3, max_size=3),
    mean=st.lists(st.floats(-10.0, 10.0), min_size=3, max_size=3), floor=st.sampled_from([0.0, 1.0]),
)  # fmt: skip
def test_thresholds_are_seven_standard_deviations_and_one_and_a_half_times_the_largest_mean(
    deviation: list[float], mean: list[float], floor: float
):
    noise = np.tile([[1.0], [-1.0]], (500, 1))  # of standard deviation 1 and mean 0 in every window
    residual = np.asarray(mean) + noise * deviation
    learnt = Thresholds.learnt(residual, gain=100.0, dt=1e-3, floor=floor)
    expected = np.maximum(7.0 * np.asarray(deviation) + 1.5 * np.abs(mean), floor)
    np.testing.assert_allclose(learnt.value, expected, rtol=1e-9)


@pytest.mark.parametrize(("dt", "ticks"), [(1e-3, 200), (2e-3, 100), (0.2, 1), (1.0, 1)])
def test_two_windows_of_a_fifth_of_a_second_or_of_a_tick_are_enough_for_thresholds(dt: float, ticks: int):
    residual = np.repeat([[1.0], [-3.0]], ticks, axis=0)
    learnt = Thresholds.learnt(residual, gain=100.0, dt=dt)
    assert learnt.deviation == 0.0 and learnt.value == pytest.approx(1.5 * 3.0)
    with pytest.raises(InvalidInput, match=f"at least two windows of {ticks}"):
        Thresholds.learnt(residual[1:], gain=100.0, dt=dt)


def test_predicted_thresholds_are_seven_of_the_deviations_that_noise_of_the_velocity_gives():
    state = wbc.load("arm").state()
    predicted = Thresholds.predicted(state, velocity=0.01, gain=100.0, dt=1e-3)
    momentum = state.M @ (0.01 * np.random.default_rng(0).normal(size=(7, 20_000)))
    missing = np.diff(momentum) / 1e-3
    share, filtered, values = -np.expm1(-0.1), np.zeros(7), []
    for sample in missing.T:  # the observer's first-order lag
        filtered = filtered + share * (sample - filtered)
        values.append(filtered)
    np.testing.assert_allclose(predicted.value, 7.0 * np.std(values[200:], axis=0), rtol=0.05)
    np.testing.assert_allclose(predicted.noise, missing.std(axis=1), rtol=0.05)
