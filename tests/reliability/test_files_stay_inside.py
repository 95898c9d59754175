"""While a description is read that points elsewhere, no file there is opened."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.models.test_hostile_files import with_shape
from tests.reliability.forked import forked
from wbc.errors import PathRefused
from wbc.models import load

WAYS_OUT = ("../../elsewhere/secret.stl", "file://{outside}/secret.stl", "package://my_robot/../elsewhere/secret.stl",
            "link.stl")  # fmt: skip


@pytest.mark.parametrize("way", WAYS_OUT)
def test_nothing_outside_is_opened(way: str, tmp_path: Path):
    home, outside = tmp_path / "my_robot" / "urdf", tmp_path / "elsewhere"
    home.mkdir(parents=True)
    outside.mkdir()
    (outside / "secret.stl").write_text("solid secret")
    (home / "link.stl").symlink_to(outside / "secret.stl")
    path = home / "robot.urdf"
    path.write_text(with_shape(f'<mesh filename="{way.format(outside=outside)}"/>'))

    def opened() -> list[str]:
        places: list[str] = []
        sys.addaudithook(lambda event, words: places.append(str(words[0])) if event == "open" else None)
        with pytest.raises(PathRefused):
            load(path, packages=[tmp_path / "my_robot"])
        assert any(place.endswith("robot.urdf") for place in places), "the hook sees what is opened"
        return [place for place in places if "elsewhere" in place or place.endswith("link.stl")]

    assert forked(opened) == ("answered", "[]")
