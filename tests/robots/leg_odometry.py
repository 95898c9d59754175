"""Plain leg odometry, which the estimator is compared with, and the table of both.

The orientation is that of the start, turned by the gyroscope less its mean at rest. The velocity is the mean of what
the feet that press say, R (ω × s + J q̇) = −v for a foot at s from the base, and is held while none presses. The
position is its sum.

    python -m tests.robots.leg_odometry SCENARIO ROBOT SENSORS SEEDS DURATION [key=value ...]

runs a scenario with the estimate in the loop, once for each seed, with leg odometry looking on, and prints the medians
and the worst of what both were off.
"""

from __future__ import annotations

import sys
from typing import Any, final
from unittest.mock import patch

import numpy as np
from scipy.spatial.transform import Rotation

from tasks.scenarios import SCENARIOS
from wbc.models.model import RobotModel
from wbc.robots import sensors
from wbc.sim.scenario import Settings
from wbc.types import Vec

#: A foot that presses with more than this share of the weight stands.
STANDS = 0.05


@final
class LegOdometry:
    """What a sample says, as an estimator gets it, of a robot whose IMU is its base."""

    def __init__(self, robot: RobotModel, feet: list[str], q: Vec) -> None:
        self._state, self._feet = robot.state(), feet
        self._least = STANDS * 9.81 * robot.mass
        self.rotation, self.position, self.velocity = Rotation.from_quat(q[3:7]), q[:3].copy(), np.zeros(3)
        self._t: float | None = None
        self._at_rest: list[Vec] = []

    def update(self, sample: dict[str, Any]) -> tuple[Vec, Rotation, Vec]:
        """Position [m], rotation and velocity in the world [m/s]."""
        if "forces" not in sample:  # before the run
            self._at_rest.append(sample["gyro_in_imu"])
            return self.position, self.rotation, self.velocity
        t, gyro = sample["t"], sample["gyro_in_imu"] - np.mean(self._at_rest, axis=0)
        dt = 0.0 if self._t is None else t - self._t
        self._t = t
        self.rotation = self.rotation * Rotation.from_rotvec(dt * gyro)
        v = np.concatenate([np.zeros(3), gyro, sample["joint_v"]])
        self._state.update(t, np.concatenate([np.zeros(3), self.rotation.as_quat(), sample["joint_q"]]), v)
        said = [-(self._state.frame(f).jacobian()[:3] @ v) for f in self._feet if sample["forces"][f] > self._least]
        if said:
            self.velocity = np.mean(said, axis=0)
        self.position = self.position + dt * self.velocity
        return self.position, self.rotation, self.velocity


def run(scenario: str, robot: str, sensor_set: str, seed: int, duration: float, more: list[str]) -> dict[str, Any]:
    """One run: the verdict, and what estimator and odometry were off."""
    made: list[Any] = []
    rows: list[tuple[Vec, Rotation, Vec]] = []

    class Watched(sensors.BaseEstimator):  # type: ignore[misc]
        """The estimator, with odometry beside it."""

        def reset(self, q: Any, v: Any) -> None:
            super().reset(q, v)
            made[:] = [LegOdometry(self.robot, list(self.contacts), np.array(q))]

        def update(self, t: float, *args: Any, **sample: Any) -> tuple[Vec, Vec]:
            said = made[0].update({"t": t, **sample})
            rows.extend([said] * ("forces" in sample))
            return super().update(t, *args, **sample)

    chosen = SCENARIOS[scenario]
    settings = chosen.parse([f"robot={robot}", f"sensors={sensor_set}", f"seed={seed}", *more])
    with patch.object(sensors, "BaseEstimator", Watched):
        result = chosen.run(settings, Settings(**chosen.choose(plant=None, hierarchy=None, duration=duration)))
    truth, true_v = result.run["plant.q"], result.run["plant.v"]
    turns = Rotation.from_quat(truth[:, 3:7])
    beside = {
        "odometry_drift_m": float(np.linalg.norm(rows[-1][0] - truth[-1, :3])),
        "odometry_heading_rad": float((rows[-1][1] * turns[-1].inv()).as_rotvec()[2]),
        "odometry_lean_rms_rad": _rms(
            np.array([(a * b.inv()).as_rotvec()[:2] for (_, a, _), b in zip(rows, turns, strict=True)])
        ),
        "odometry_velocity_rms_m_s": _rms(np.array([a.inv().apply(v) for _, a, v in rows]) - true_v[:, :3]),
    }
    return {"failed": [check for check in result.verdict if not check.ok], **result.figures, **beside}


def _rms(values: Any) -> float:
    return float(np.sqrt((values**2).sum(axis=1).mean()))


def main(scenario: str, robot: str, sensor_set: str, seeds: str, duration: str, *more: str) -> None:
    """Print the table."""
    found = [run(scenario, robot, sensor_set, seed, float(duration), list(more)) for seed in range(int(seeds))]
    print(f"{scenario}, {robot}, {sensor_set}, {seeds} seeds, {duration} s")
    for seed, one in enumerate(found):
        for check in one["failed"]:
            print(f"  seed {seed}: {check.text}: {check.value:.4g}, asked {check.sign} {check.bound:.4g} {check.unit}")
    for what in ("drift_m", "heading_rad", "lean_rms_rad", "velocity_rms_m_s", "com_max_m"):
        for whose in ("estimate", "odometry"):
            if (name := f"{whose}_{what}") in found[0]:
                values = np.abs([one[name] for one in found]) * 1e3
                print(f"  {name}: median {np.median(values):.3g}, worst {values.max():.3g} (thousandths)")


if __name__ == "__main__":
    main(*sys.argv[1:])
