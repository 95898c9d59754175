"""Sensors in a simulation: exact ones give the truth, others what their data sheets say; the loop closes over them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tasks import feet
from tasks.scenarios import SCENARIOS
from tests.robots.motions import ROBOT
from wbc.errors import UnknownName
from wbc.robots import SENSORS, EstimatedBase, ImuNoise, Sensors
from wbc.sim.mujoco_ import MujocoPlant
from wbc.sim.plant import IntegratorPlant
from wbc.sim.scenario import ScenarioResult, Settings
from wbc.types import Vec


class Drive:
    """Constant accelerations, and torques that nobody reads."""

    def __init__(self, a: Vec) -> None:
        self.a, self.v, self.q, self.tau = a, a, a, np.zeros(12)


def flown(sensors: Sensors, seed: int = 0, ticks: int = 200) -> tuple[Any, list[dict[str, Any]], IntegratorPlant]:
    """A trunk that accelerates and turns in the air; the effect, its samples, the plant."""
    plant = IntegratorPlant(ROBOT)
    effect: Any = EstimatedBase(replace(sensors, feet="torques"), seed=seed).begin(plant)
    samples, a = [], np.array([0.5, -0.3, 0.2, 0.4, 0.6, -0.5, *np.full(12, 0.1)])
    for _ in range(ticks):
        effect.measure(plant.q, plant.v)
        samples.append(effect.sample)
        plant.step(Drive(a))
    return effect, samples, plant


def test_exact_sensors_in_the_air_give_the_truth_by_the_imu_alone() -> None:
    effect, _, plant = flown(SENSORS["exact"])
    q, v = effect.measure(plant.q, plant.v)
    assert np.abs(ROBOT.difference(plant.q, q)).max() < 1e-6
    assert np.abs(v - plant.v)[:3].max() < 1e-5
    assert not any(effect.estimator.contacts.values())


def test_noise_and_biases_are_those_of_the_data_sheet() -> None:
    sensors = Sensors(ImuNoise(1e-3, 1e-2, 0.02, 0.3, 0.0, 0.0), joint_position=1e-3, joint_velocity=0.02)
    exact = flown(SENSORS["exact"])[1]
    starts = []
    for seed in range(20):
        effect, samples, _ = flown(sensors, seed)
        for part, size, bias in (
            ("gyro_in_imu", 1e-3 / 1e-3**0.5, effect.bias[:3]), ("joint_q", 1e-3, 0.0),
            ("acceleration_in_imu", 1e-2 / 1e-3**0.5, effect.bias[3:]), ("joint_v", 0.02, 0.0),
        ):  # fmt: skip
            off = np.array([noisy[part] - clean[part] for noisy, clean in zip(samples, exact, strict=True)]) - bias
            count = off.size
            assert abs(off.mean()) < 5.0 * size / count**0.5
            assert off.std() == pytest.approx(size, rel=5.0 / (2.0 * count) ** 0.5)
        starts.append(effect.bias / [*[0.02] * 3, *[0.3] * 3])
    assert np.std(starts) == pytest.approx(1.0, rel=0.35)


def test_a_seed_repeats_a_run_and_a_delay_hands_out_old_samples() -> None:
    one, again, other = (flown(SENSORS["bmi055"], seed)[1] for seed in (3, 3, 4))
    assert all(np.array_equal(a["gyro_in_imu"], b["gyro_in_imu"]) for a, b in zip(one, again, strict=True))
    assert not np.array_equal(one[5]["gyro_in_imu"], other[5]["gyro_in_imu"])
    late = flown(replace(SENSORS["exact"], delay=3e-3))[1]
    assert [round(1e3 * sample["t"]) for sample in late[:6]] == [0, 0, 0, 0, 1, 2]


@pytest.mark.physics
def test_a_robot_is_told_where_its_feet_stand_and_not_how_it_leans() -> None:
    sensors = replace(SENSORS["exact"], tilt=0.02)
    plant = MujocoPlant(ROBOT, contacts=feet(ROBOT))
    q, _ = EstimatedBase(sensors, seed=1).begin(plant).measure(plant.q, plant.v)
    state, middles = ROBOT.state(), []
    for one in (plant.q, q):
        state.update(0.0, one, np.zeros(ROBOT.nv))
        middles.append(np.mean([np.array(state.frame(name).position) for name in ROBOT.feet], axis=0))
    assert np.abs(ROBOT.difference(plant.q, q))[3:5].max() > 5e-3, "it was told how it leans"
    assert np.abs(middles[1] - middles[0]).max() < 1e-4


# ---- in the loop
STANDING = (("quadruped-stand", ["robot=quadruped"], 2.5), ("humanoid-stand", ["robot=humanoid"], 2.5))
#: They stand too, before and after: exact sensors in the others' loops are for `make deep`.
WALKING = (
    ("quadruped-trot-in-place", ["robot=quadruped"], 2.6), ("humanoid-step", ["robot=humanoid", "steps=1"], 4.0),
)  # fmt: skip


def played(name: str, *settings: str, duration: float) -> ScenarioResult:
    scenario = SCENARIOS[name]
    chosen = scenario.choose(plant=None, hierarchy=None, duration=duration)
    return scenario.run(scenario.parse(settings), Settings(**chosen))


@pytest.mark.physics
@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "settings", "duration", "sensors"),
    [pytest.param(*row, sensors, marks=[pytest.mark.deep] * (sensors == "exact" and row in STANDING))
     for row in (*STANDING, *WALKING) for sensors in ("exact", "bmi055")],
    ids=lambda x: x if isinstance(x, str) else "",
)  # fmt: skip
def test_scenarios_stand_and_walk_with_the_estimate_in_the_loop(
    name: str, settings: list[str], duration: float, sensors: str
) -> None:
    result = played(name, *settings, f"sensors={sensors}", duration=duration)
    exact = sensors == "exact"
    assert not [check.text for check in result.verdict if not check.ok]
    assert result.figures["estimate_drift_m"] < (5e-4 if exact else 2e-3)
    assert result.figures["estimate_velocity_rms_m_s"] < (5e-4 if exact else 5e-3)
    assert result.figures["estimate_lean_rms_rad"] < (1e-4 if exact else 2e-3)
    assert result.figures["estimate_com_max_m"] < (1e-3 if exact else 5e-3)
    assert not np.array_equal(result.run["q"], result.run["plant.q"]), "the truth was in the loop"


@pytest.mark.physics
@pytest.mark.slow
def test_torques_serve_where_feet_have_no_sensors(monkeypatch: pytest.MonkeyPatch) -> None:
    by_torques = {name: replace(sensors, feet="torques") for name, sensors in SENSORS.items()}
    monkeypatch.setattr("tasks.scenarios.estimated.SENSORS", by_torques)
    result = played("quadruped-trot-in-place", "robot=quadruped", "sensors=mti-300", duration=2.6)
    assert not [check.text for check in result.verdict if not check.ok]
    assert result.figures["estimate_drift_m"] < 5e-3


def test_sensors_that_are_not_there_are_refused_by_name() -> None:
    with pytest.raises(UnknownName, match="mti-300"):
        played("quadruped-stand", "robot=quadruped", "sensors=mti-30", duration=0.1)


@pytest.mark.physics
def test_a_plant_without_drift_of_the_truth_is_left_alone() -> None:
    plant = MujocoPlant(ROBOT, contacts=feet(ROBOT))
    before = plant.q.copy()
    effect: Any = EstimatedBase(SENSORS["bmi055"], seed=1).begin(plant)
    q, _ = effect.measure(plant.q, plant.v)
    assert np.array_equal(plant.q, before)
    assert 0.0 < np.abs(ROBOT.difference(before, q))[3:5].max() < 0.1
    assert effect.deliver(Drive(np.zeros(18))).tau.shape == (12,)
