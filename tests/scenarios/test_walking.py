"""Our own robots make and break contacts as their verdicts demand."""

from __future__ import annotations

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from tasks.scenarios import SCENARIOS
from tasks.scenarios.humanoid_stand import STANCES
from tasks.scenarios.judge import stance_slid
from tasks.scenarios.quadruped_trot import LANDING, SWING, swinging, swings, timeline
from tasks.scenarios.walking import Gait, walk
from tests.scenarios.runs import failed, parameters, run, trial
from wbc.report import measure
from wbc.sim.scenario import ScenarioResult

HUMANOID = wbc.load("humanoid")


def test_a_foot_slides_from_where_it_stood_once_the_robot_has_settled() -> None:
    t = np.arange(0.0, 2.0, 0.1)
    path = np.column_stack([0.01 * t, np.zeros(len(t))])  # 10 mm/s all the time
    run = wbc.Run({"t": t, "plant.slip.foot": path})
    slid = stance_slid(run, "foot", [(-np.inf, 1.0), (1.5, np.inf)])
    stands = ((t > measure.SETTLED - 0.05) & (t < 0.95)) | (t > 1.45)
    start = np.where(t < 1.2, t[np.argmax(t > measure.SETTLED - 0.05)], 1.5)
    np.testing.assert_allclose(slid, np.where(stands, 0.01 * (t - start), 0.0), atol=1e-12)


@pytest.fixture(scope="module")
def step() -> ScenarioResult:
    return run("humanoid-step", "robot=humanoid", "steps=1", duration=3.0)


@pytest.mark.physics
def test_our_own_humanoid_takes_a_step(step: ScenarioResult) -> None:
    result = step
    assert not failed(result)
    assert result.figures["steps"] == 1 and not result.figures["fell"]
    open_ticks = [result.run[f"f.{name}"][:, 2] == 0.0 for name in result.run.meta["contacts"]]
    assert [int(ticks.sum()) for ticks in open_ticks] == [800, 0]
    assert 0.0 < result.figures["plan_torque_step_Nm"] <= 1.0


@pytest.mark.physics
@pytest.mark.parametrize("sensors", ["truth", "mti-300"])
def test_our_own_quadruped_trots_in_place(sensors: str) -> None:
    result = run("quadruped-trot-in-place", "robot=quadruped", f"sensors={sensors}", duration=2.2)
    assert not failed(result)
    assert result.figures["steps"] == 2 and not result.figures["fell"]
    for name in (name for name in result.run.columns if name.startswith("error.Position")):
        assert np.abs(result.run[name]).max() < 2e-3, "no target goes on into the ground"


@given(height=st.floats(-1e-3, 1e-3), lifted=st.floats(0.5, 20.0))
def test_a_foot_that_trots_does_not_brake_where_the_ground_may_be(height: float, lifted: float) -> None:
    # Whenever it meets a ground that is 1 mm higher or lower: contacts bring no step of the acceleration that is asked.
    place = np.array([0.2, 0.1, 0.02])
    motion = swinging(place, [lifted])
    meets = lifted + SWING - height / LANDING
    x, rate, acceleration = (np.array(one) for one in motion(meets))
    np.testing.assert_allclose(x - place, [0.0, 0.0, height], atol=1e-9)
    np.testing.assert_allclose(rate, [0.0, 0.0, -LANDING], atol=1e-9)
    np.testing.assert_allclose(acceleration, 0.0, atol=1e-6)


@given(duration=st.floats(0.0, 12.0))
def test_a_trot_lifts_pairs_across_in_turn_and_ends_on_four_feet(duration: float) -> None:
    feet = ["front left", "front right", "rear left", "rear right"]
    trot = swings(feet, duration)
    (begin, standing), *entries = timeline(feet, trot)
    assert begin == 0.0 and standing == feet
    assert [t for t, _ in entries] == sorted(t for swing in trot for t in (swing.lifted, swing.down))
    for k, (t, names) in enumerate(entries):
        up = set(feet) - set(names)
        assert t <= duration and up == (set(trot[k // 2].feet) if k % 2 == 0 else set())
    for swing, after in pairwise(trot):
        assert swing.down < after.lifted and set(swing.feet) | set(after.feet) == set(feet)
    for front, rear in (sorted(swing.feet) for swing in trot):
        assert front.split()[0] == "front" and rear.split()[0] == "rear" and front.split()[1] != rear.split()[1]


@pytest.mark.physics
def test_a_foot_that_is_not_where_it_was_to_be_is_no_step(step: ScenarioResult) -> None:
    robot = STANCES["humanoid"].robot("humanoid")
    gait = Gait(length=0.1, lift=0.04, shift=1.2, swing=0.8, inset=0.01)  # two centimetres longer than it was
    scenario, plant = SCENARIOS["humanoid-step"], SimpleNamespace(model=robot)
    longer = trial(plant, walk(robot.state(), robot.feet, gait, 1), step.run)
    judged = scenario.judge(iter([longer]), parameters(scenario, "robot=humanoid", duration=3.0))
    assert {"steps taken", "placement of a foot"} <= failed(judged)
    assert judged.figures["placement_m"] == pytest.approx(0.02, abs=2e-3)


@given(
    length=st.floats(0.01, 0.2), lift=st.floats(0.0, 0.1), shift=st.floats(0.5, 2.0), swing=st.floats(0.3, 2.0),
    steps=st.integers(1, 4),
)  # fmt: skip
def test_every_target_of_a_walk_goes_on_where_it_was(
    length: float, lift: float, shift: float, swing: float, steps: int
) -> None:
    way = walk(HUMANOID.state(), HUMANOID.feet, Gait(length, lift, shift, swing, 0.01), steps)
    times = [t for t, _ in way.timeline[1:]]
    for t in times:
        assert np.abs(way.com(t - 1e-9)[0] - way.com(t + 1e-9)[0]).max() < 1e-7
        for foot in way.feet.values():
            before, after = foot(t - 1e-9)[0], foot(t + 1e-9)[0]
            assert np.abs(before.homogeneous - after.homogeneous).max() < 1e-7
    for step in way.steps:
        for t in np.linspace(step.lifted, step.down, 5):
            assert not way.com(t)[1].any(), "the weight rests while a foot is up"
        np.testing.assert_allclose(way.feet[step.frame](step.down)[0].translation, step.position, atol=1e-12)
        assert [names for t, names in way.timeline if t == step.lifted] == [
            [n for n in HUMANOID.feet if n != step.frame]
        ]
    assert way.steps[-1].position[0] - HUMANOID.state().frame(way.steps[-1].frame).position[0] == pytest.approx(
        steps * length
    )
