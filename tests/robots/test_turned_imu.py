"""An IMU may be mounted turned: the estimate of the base is the same."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import wbc
from tests.robots.motions import POINTS, ROBOT, errors, stepping
from tests.seeds import generator
from wbc.robots import BaseEstimator, ImuNoise

QUIET = ImuNoise(1e-5, 1e-5, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.filterwarnings("ignore::wbc.models.feet.Guessed")
@pytest.mark.parametrize("seed", range(3))
def test_an_imu_may_be_mounted_turned(seed: int, tmp_path: Path) -> None:
    angles = generator("a turned IMU", seed).uniform(-np.pi, np.pi, 3)
    mount = Rotation.from_euler("xyz", angles).as_matrix()
    turn = f'<origin xyz="0 0 0" rpy="{" ".join(map(repr, angles.tolist()))}"/>'
    joint = f'<joint name="mount" type="fixed"><parent link="trunk"/><child link="imu"/>{turn}</joint>'
    path = tmp_path / "quadruped.urdf"
    written = (Path(wbc.__file__).parent / "models/robots/quadruped.urdf").read_text(encoding="utf-8")
    path.write_text(written.replace("</robot>", f'<link name="imu"/>{joint}</robot>'), encoding="utf-8")
    robot, motion = wbc.load(path, base="floating", q0=ROBOT.q0), stepping()
    one = BaseEstimator(robot, POINTS, noise=QUIET, settle=0.0, imu_frame="imu")
    in_imu = replace(motion, gyro=motion.gyro @ mount, force=motion.force @ mount)
    one.reset(motion.q[0], motion.v[0])
    for k in range(len(motion.t)):
        assert np.abs(errors(*one.update(**in_imu.sample(k)), motion.q[k], motion.v[k])).max() < 1e-9
