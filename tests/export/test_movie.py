"""Moving pictures: files open with another reader, pictures show a robot that moves, times are those of the run."""

from __future__ import annotations

import subprocess
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from tests.report.conftest import reaching_run, standing_run
from wbc.control.recorder import Run
from wbc.errors import InvalidInput, NotSupported
from wbc.export import Camera, movie
from wbc.export.movie import _rows
from wbc.export.stage import _described, _opengl
from wbc.models import load
from wbc.models.collision import Obstacle
from wbc.models.geometry import Sphere
from wbc.report.shapes import parts

Image = pytest.importorskip("PIL.Image", reason="the extra `export`")

SIZE = (160, 120)


@pytest.fixture(scope="module", autouse=True)
def _opengl_there() -> None:
    """Skip where nothing can be drawn without a window."""
    try:
        _opengl(16, 16).free()
    except NotSupported as without:
        pytest.skip(str(without))


def read(path: Path) -> tuple[list[np.ndarray], list[int]]:
    """Every picture of a file and how long it is shown [ms]."""
    with Image.open(path) as file:
        frames, durations = [], []
        for k in range(file.n_frames):
            file.seek(k)
            file.load()
            frames.append(np.asarray(file.convert("RGB")).astype(int))
            durations.append(int(file.info.get("duration", 0)))
    return frames, durations


def moving_run() -> Run:
    run = reaching_run()
    run.columns["q"] = run["q"] + np.linspace(0.0, 1.0, run.rows)[:, None]
    return run


@pytest.mark.parametrize("ending", [".gif", ".webp"])
def test_pictures_show_an_arm_that_moves_for_as_long_as_the_run(tmp_path: Path, ending: str):
    run = moving_run()
    frames, durations = read(movie(run, load("arm"), tmp_path / f"arm{ending}", size=SIZE, fps=20.0))
    assert len(frames) == 12 and sum(durations) == pytest.approx(600, abs=50)
    assert all(frame.shape == (120, 160, 3) and frame.std() > 10 for frame in frames)
    changed = [(np.abs(after - before).max(axis=2) > 40).mean() for before, after in pairwise(frames[::3])]
    assert all(0.005 < share < 0.25 for share in changed), changed  # the arm, not the floor
    assert not list(tmp_path.glob(".*"))


def test_half_the_speed_takes_twice_as_long(tmp_path: Path):
    _, durations = read(movie(moving_run(), load("arm"), tmp_path / "slow.webp", size=SIZE, fps=10, speed=0.5, end=0.3))
    assert sum(durations) == pytest.approx(700, abs=50)


def test_a_video_has_the_pictures_of_the_run(tmp_path: Path):
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg")
    path = movie(moving_run(), load("arm"), tmp_path / "arm.mp4", size=(161, 121), fps=20.0)
    words = [imageio_ffmpeg.get_ffmpeg_exe(), "-i", path, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    read_back = subprocess.run(words, check=True, capture_output=True)
    frames = np.frombuffer(read_back.stdout, np.uint8).astype(int).reshape(12, 120, 160, 3)
    assert b"160x120" in read_back.stderr and b"20 fps" in read_back.stderr
    assert all(frame.std() > 10 for frame in frames) and np.abs(frames[0] - frames[-1]).max() > 60


def test_forces_and_pushes_are_seen_and_the_camera_turns(tmp_path: Path):
    run, robot = standing_run(), load("humanoid")
    frames, _ = read(movie(run, robot, tmp_path / "a.webp", size=(320, 240), fps=5.0, start=0.2, end=0.45))
    apart = [frame[60:, 60:, 0] - np.maximum(frame[60:, 60:, 1], frame[60:, 60:, 2]) for frame in frames]
    red = [int((more > 60).sum()) for more in apart]
    assert red[1] > red[0] + 40  # pushed from 0.3 s on
    behind, _ = read(movie(run, robot, tmp_path / "b.webp", size=(320, 240), fps=5.0, end=0.1, camera=Camera(0, -60)))
    assert np.abs(behind[0] - frames[0]).mean() > 5


def test_obstacles_are_seen_where_they_are(tmp_path: Path):
    def rises(t: float) -> pin.SE3:
        return pin.SE3(np.eye(3), np.array([0.3, 0.3, t]))

    run, robot, ball = reaching_run(), load("arm"), Obstacle("ball", Sphere(0.15), rises)
    frames, _ = read(movie(run, robot, tmp_path / "a.webp", size=SIZE, fps=10.0, obstacles=[ball]))
    red = [np.argwhere(frame[:, :, 0] - np.maximum(frame[:, :, 1], frame[:, :, 2]) > 60) for frame in frames]
    assert len(red[0]) > 40 and red[-1][:, 0].mean() < red[0][:, 0].mean() - 10


def test_what_is_seen_may_be_called_world():
    mujoco = pytest.importorskip("mujoco")
    solid = [replace(part, link="world") for part in parts(load("arm"))[:2]]
    stage = _described(mujoco, solid, (64, 64), 1.0).compile()
    assert (stage.nbody, stage.nmocap) == (2, 1)


def test_each_picture_is_the_tick_nearest_to_its_time():
    run = standing_run()
    assert _rows(run, 25.0, 0.1, 0.3, 1.0).tolist() == [10, 14, 18, 22, 26, 30]
    assert _rows(run, 25.0, 0.0, 0.1, 0.5).tolist() == [0, 2, 4, 6, 8, 10]


@pytest.mark.parametrize(
    ("words", "about"),
    [({"fps": 0.0}, "between 0 and 240, 0 excluded"),
     ({"speed": -1.0}, "speed"), ({"start": 2.0}, "from"), ({"end": -0.5}, "to"),
     ({"size": (8, 8)}, "size"), ({"size": 640}, "size"),
     ({"camera": Camera(0.0, 0.0, -3.0)}, "distance of the camera"),
     ({"camera": (0.0, 0.0)}, "camera"), ({"camera": Camera(np.nan)}, "azimuth"),
     ({"fps": 240.0, "speed": 1e-4}, "too many")],
)  # fmt: skip
def test_what_makes_no_sense_is_refused_by_name(tmp_path: Path, words: dict, about: str):
    with pytest.raises(InvalidInput, match=about):
        movie(reaching_run(), load("arm"), tmp_path / "no.gif", **words)
    assert not list(tmp_path.iterdir())


def test_another_format_is_refused(tmp_path: Path):
    with pytest.raises(InvalidInput, match=r"\.gif, \.webp, \.mp4"):
        movie(reaching_run(), load("arm"), tmp_path / "no.avi")


def test_a_machine_without_opengl_is_told_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr("wbc.export.stage._offered", list)
    with pytest.raises(NotSupported, match=r"no EGL.*apt install libegl1"):
        movie(reaching_run(), load("arm"), tmp_path / "no.gif", size=SIZE)
    assert not list(tmp_path.iterdir())
