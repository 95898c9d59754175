"""Why the robot moved as it did, read from a record."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable
from typing import Any

import numpy as np

from wbc.control.recorder import Run
from wbc.models import load
from wbc.report.document import Plot
from wbc.report.replay import replay
from wbc.report.sections import limits
from wbc.report.shapes import parts
from wbc.report.stills import stills
from wbc.report.why import held, row_names, shares, why

from .conftest import reaching_run, result_of, standing_run


def test_rows_are_named_with_their_side_where_they_do_not_say_it():
    assert row_names(standing_run()) == ["TorqueLimits: left_knee, upper bound", "friction[left_sole]: fy <= mu fz"]


def test_a_task_without_a_target_has_no_error(changed: Callable[..., Run]):
    run = standing_run()
    found = why(changed(run, **{"error.Posture": np.zeros_like(run["error.Posture"])}))
    assert found is not None
    assert {part.task: list(part.error) for part in found.parts} == {
        "CenterOfMass": ["m"], "Frame[left_hand]": ["m", "rad"], "Posture": [],
    }  # fmt: skip


def test_shares_of_the_cost_are_those_of_the_ticks_that_cost_something():
    found = shares(standing_run())
    assert {task: share[40] for task, share in found.items()} == {
        "CenterOfMass": 25.0, "Frame[left_hand]": 50.0, "Posture": 25.0,
    }  # fmt: skip
    assert np.isnan(found["Posture"][0])


def test_a_strip_covers_the_ticks_on_which_its_row_was_active():
    run = standing_run()
    assert all(np.array_equal(mask, run["push"][:, 1] > 0) for mask in held(run).values())
    section = limits.section(result_of(run, None))
    assert section is not None
    strips, costs = (item for item in section.items if isinstance(item, Plot))
    assert [[round(x, 9) for x in span] for span in strips.strips[0].intervals] == [[0.3, 0.5]]
    assert [curve.label for curve in costs.curves] == ["CenterOfMass", "Frame[left_hand]", "Posture"]


def test_more_rows_than_can_be_told_apart_are_one_strip():
    run = standing_run()
    run.meta["active_rows"] = [
        {"owner": "TorqueLimits", "label": f"joint {k}", "unit": "N m", "side": "upper"} for k in range(20)
    ]
    run.columns["active.row"][:20, 0] = np.arange(20)
    section = limits.section(result_of(run, None))
    assert section is not None and isinstance(section.items[0], Plot)
    assert section.items[0].strips[-1].label == "6 other rows" and len(section.items[0].strips) == limits.MOST + 1


def test_an_older_record_says_nothing_of_its_reasons():
    run = reaching_run()
    assert why(run) is None and limits.section(result_of(run, None)) is None


# ---- the motion in space: what the page's script draws
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
