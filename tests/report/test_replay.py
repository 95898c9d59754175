"""The motion in space: what the page's script draws."""

from __future__ import annotations

import base64
import json
from typing import Any

import numpy as np

from wbc.models import load
from wbc.report.replay import replay
from wbc.report.shapes import parts
from wbc.report.stills import stills

from .conftest import reaching_run, standing_run


def read(text: str, *shape: int) -> Any:
    return np.frombuffer(base64.b64decode(text), dtype="<f4").reshape(-1, *shape)


def test_a_scene_shows_the_run_from_its_first_to_its_last_tick():
    run, robot = standing_run(), load("humanoid")
    scene = replay(run, robot, parts(robot)).content
    times = read(scene["times"])
    assert times[0] == 0.0 and times[-1] == np.float32(run["t"][-1])
    assert all(len(read(link["pose"], 7)) == len(times) for link in scene["links"])
    pose = read(scene["links"][0]["pose"], 7)
    assert np.allclose(np.linalg.norm(pose[:, 3:], axis=1), 1.0, atol=1e-6)
    assert json.loads(json.dumps(scene)) is not None


def test_a_scene_has_forces_push_centre_of_mass_and_support_of_a_robot_that_stands():
    run, robot = standing_run(), load("humanoid")
    scene = replay(run, robot, parts(robot)).content
    assert [(arrows["label"], arrows["count"]) for arrows in scene["arrows"]] == [
        ("contact forces", 2), ("commanded forces", 2), ("push", 1),
    ]  # fmt: skip
    assert [point["label"] for point in scene["points"]] == ["centre of mass"]
    loop, *cones = scene["loops"]
    assert [(cone["group"], cone["hidden"]) for cone in cones] == 2 * [("friction cones", True)]
    corners = read(loop["corners"], loop["count"], 3)[0]
    centre = read(scene["points"][0]["path"], 3)[0]
    assert np.all(corners[:, :2].min(axis=0) < centre[:2]) and np.all(centre[:2] < corners[:, :2].max(axis=0))


def test_targets_of_tasks_are_where_the_task_says_they_are():
    run, robot = reaching_run(), load("arm")
    run.meta["tasks"]["Position[tool]"] |= {"labels": ["x", "y", "z"], "point": "tool"}
    scene = replay(run, robot, parts(robot)).content
    (target,) = scene["points"]
    state = robot.state()
    state.update(0.0, run["q"][0], np.zeros(robot.nv))
    assert np.allclose(read(target["path"], 3)[0], state.frame("tool").position + 1e-3, atol=1e-6)


def test_a_link_whose_joint_is_at_a_limit_is_said_to_be_strained():
    run, robot = standing_run(), load("humanoid")
    joint = run.meta["joint_names"].index("left_knee")
    run.columns["plant.q"][20:30, 7 + joint] = robot.limits.q_max[joint]
    scene = replay(run, robot, parts(robot)).content
    spans = [link["strained"] for link in scene["links"] if link["strained"]]
    assert [[round(x, 2) for x in span] for span in spans[0]] == [[0.2, 0.3]] and len(spans) == 1


def test_stills_are_one_picture_of_some_moments():
    robot = load("arm")
    figure = stills(reaching_run(), robot, parts(robot), moments=3)
    assert figure.kind == "png" and figure.data.startswith(b"\x89PNG") and len(figure.data) > 5000
    assert figure.caption == "The robot at the start, at the end and between."


def test_stills_count_time_from_the_first_tick_as_the_page_does():
    run, robot = reaching_run(), load("arm")
    later = type(run)({**run.columns, "t": run["t"] + 1000.0}, run.meta)
    same, other = (stills(one, robot, parts(robot), moments=3).data for one in (run, later))
    assert same == other


def test_stills_of_a_run_with_a_push_say_so():
    robot = load("humanoid")
    assert "at the ends of pushes" in stills(standing_run(), robot, parts(robot), moments=3).caption
