"""Other people's MJCF files: the robot that MuJoCo makes of them, or a refusal that says why.

Set ``WBC_MJCF`` to a folder with packages (unpacked wheels of PyPI, a clone of a collection) to run it on theirs.
"""

from __future__ import annotations

import os
import warnings
from pathlib import Path

import pytest

import wbc
from tests.models.mjcf_oracle import compare
from wbc.errors import ModelError

mujoco = pytest.importorskip("mujoco", reason="the extra `sim`")
pytestmark = pytest.mark.physics

GIVEN = os.environ.get("WBC_MJCF", "")
OWN = Path(mujoco.__file__).parent / "testdata"
PACKAGES = sorted(path for path in Path(GIVEN).iterdir() if path.is_dir()) if GIVEN else [OWN]


def files(package: Path) -> list[Path]:
    """Those with a robot's root element."""
    return [path for path in sorted(package.rglob("*.xml")) if "<mujoco" in path.read_text(errors="replace")]


@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: path.name)
def test_every_file_is_the_robot_that_mujoco_makes_of_it_or_is_refused(package: Path) -> None:
    loaded = refused = 0
    for path in files(package):
        try:
            physics = mujoco.MjModel.from_xml_path(str(path))
        except ValueError:
            continue  # a part of something, or not for this version of MuJoCo
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                robot = wbc.load(path, packages=[package])
        except ModelError:
            refused += 1
            continue
        loaded += 1
        for seed in range(2):
            compare(robot, physics, seed, tolerance=1e-9)
    print(f"{package.name}: {loaded} loaded, {refused} refused")
    if not loaded + refused:
        pytest.skip("nothing in here compiles by itself")
