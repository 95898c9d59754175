"""Retargeted motions: what holds does not move, limits hold, and size does not matter."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio
import pytest

import wbc
from tests.models.builders import joint, link, origin
from tests.robots.examples import needs_examples
from wbc.errors import InvalidInput, UnknownMapping, UnknownName
from wbc.models.along import velocities
from wbc.models.catalogue import OWN_ROBOTS
from wbc.models.feet import Foot
from wbc.motion import Motion, Retargeted, Table, made
from wbc.motion.targets import targets
from wbc.report.measure import spans


@cache
def retargeted(name: str, robot: str = "humanoid") -> Retargeted:
    """A motion of our own on one of the robots."""
    return wbc.retarget(made(name), wbc.load(robot, base="floating"))


def soles(found: Retargeted, part: str) -> np.ndarray:
    """Position and rotation (N, 12) of a foot, by Pinocchio's own kinematics."""
    model = found.robot.pinocchio
    data, frame = model.createData(), model.getFrameId(found.contacts[part].frame)
    rows = []
    for q in found.q:
        pinocchio.framesForwardKinematics(model, data, q)
        rows.append(np.append(data.oMf[frame].translation, data.oMf[frame].rotation))
    return np.array(rows)


@pytest.mark.parametrize("name", ["walk", "turn"])
def test_feet_that_stand_do_not_move_and_lie_on_the_floor(name: str):
    found = retargeted(name)
    assert found.unsolved == ()
    for part in ("left_foot", "right_foot"):
        poses = soles(found, part)
        assert len(spans(found.holds[part])) == 4
        for start, stop in spans(found.holds[part]):
            np.testing.assert_allclose(poses[start:stop], poses[start : start + 1].repeat(stop - start, 0), atol=1e-4)
            np.testing.assert_allclose(poses[start:stop, 2], 0.0, atol=1e-4)
        assert poses[:, 2].min() > -1e-3 and poses[:, 2].max() > 0.03  # steps are taken, not dragged


@pytest.mark.parametrize("name", ["squat", "walk", "dance"])
def test_limits_hold_and_arms_and_pelvis_follow(name: str):
    found = retargeted(name)
    limits, joints = found.robot.limits, found.q[:, 7:]
    assert (joints >= limits.q_min - 1e-6).all() and (joints <= limits.q_max + 1e-6).all()
    _, _, steps = velocities(found.robot, found.q, found.rate)
    assert (np.abs(steps[:, 6:]) * found.rate <= limits.v_max + 1e-6).all()
    assert np.abs(np.diff(steps[:, 6:], axis=0)).max() * found.rate**2 <= 200.0 + 1e-3
    far = found.distances()
    assert max(np.median(far[part]) for part in ("pelvis", "left_wrist", "right_wrist")) < 0.005


def outline(targets: Motion, foot: Foot, part: str, k: int) -> np.ndarray:
    """Points (n, 2), a millimetre or two apart, of the edges of a sole on the floor."""
    (X, Y), along = foot.half_size, np.linspace(-1.0, 1.0, 151)
    edges = [(along, s + 0.0 * along) for s in (-1.0, 1.0)] + [(s + 0.0 * along, along) for s in (-1.0, 1.0)]
    points = np.vstack([np.column_stack([X * x, Y * y, 0.0 * x]) for x, y in edges]) + foot.origin
    return (targets.positions[part][k] + points @ targets.rotations[part][k].T)[:, :2]


@pytest.mark.parametrize("name", ["humanoid", pytest.param("talos", marks=needs_examples)])
@pytest.mark.parametrize("seed", range(6))
def test_soles_that_stand_are_beside_each_other(name: str, seed: int):
    robot = wbc.load(name, base="floating")
    table, motion = Table.of(robot), made("turn", seed=seed)
    # With narrower legs the soles of the person's steps lie in each other.
    narrow = Motion(motion.rate, {part: p * [1.0, 0.6, 1.0] for part, p in motion.positions.items()})
    asked, _ = targets(narrow, robot, table)
    feet = {part: robot.feet[table.followers[part].frame] for part in ("left_foot", "right_foot")}
    both = np.flatnonzero(asked.contacts["left_foot"] & asked.contacts["right_foot"])
    for k in (both[0], both[len(both) // 2], both[-1]):
        left, right = (outline(asked, foot, part, k) for part, foot in feet.items())
        assert np.linalg.norm(left[:, None] - right[None], axis=2).min() > 0.018


#: Axes of frames on the humanoid, as programs for drawing leave them; those of a sole keep its z.
AXES = {
    "pelvis": (0.0, 0.0, 3.0), "torso": (0.3, 1.2, -2.0), "head": (3.0, 0.0, 0.0), "left_sole": (0.0, 0.0, np.pi / 2),
    "right_sole": (0.0, 0.0, np.pi),
}  # fmt: skip


@pytest.mark.parametrize("heading", [0.0, 2.4])
@pytest.mark.parametrize("name", ["squat", "turn"])
def test_the_axes_of_a_robots_frames_do_not_matter(name: str, heading: float, tmp_path: Path):
    plain = retargeted(name)
    text = (OWN_ROBOTS / "humanoid.urdf").read_text(encoding="utf-8")
    turned = "".join(
        link(f"{frame}_cad") + joint(f"{frame}_axes", frame, f"{frame}_cad", "fixed", origin(rpy=angles))
        for frame, angles in AXES.items()
    )
    (tmp_path / "cad.urdf").write_text(text.replace("</robot>", f"{turned}</robot>"), encoding="utf-8")
    left, right = (plain.robot.feet[sole] for sole in ("left_sole", "right_sole"))
    assert left.half_size is not None
    feet = [
        replace(left, frame="left_sole_cad", half_size=left.half_size[::-1]),
        replace(right, frame="right_sole_cad"),
    ]
    q0 = np.array(plain.robot.q0)
    q0[3:7] = 0.0, 0.0, np.sin(heading / 2), np.cos(heading / 2)
    robot = wbc.load(tmp_path / "cad.urdf", base="floating", feet=feet, q0=q0)
    followers = {
        part: one._replace(frame=f"{one.frame}_cad") if one.frame in AXES else one
        for part, one in plain.table.followers.items()
    }
    found = wbc.retarget(made(name), robot, Table(followers))
    np.testing.assert_allclose(found.q, plain.q, atol=1e-9)


def test_a_table_of_ones_own_is_checked_as_a_file_is():
    motion, robot = made("squat"), retargeted("squat").robot
    table = Table.of(robot)
    pelvis = table.followers["pelvis"]

    def other(part: str, **changed) -> Table:
        return table._replace(followers={**table.followers, part: pelvis._replace(**changed)})

    for about, wrong in {
        "names no frame for pelvis, chest": table._replace(followers={}),
        "scale is 0": table._replace(scale=0.0),
        "scale is nan": table._replace(scale=np.nan),
        "pelvis.offset": other("pelvis", offset=(0.0, 0.0)),
        "pelvis.position is -1": other("pelvis", position=-1.0),
        "tail": other("tail"),
        "only pelvis, chest, head and feet have an orientation": other("left_wrist", orientation=1.0),
    }.items():
        with pytest.raises(InvalidInput, match=about):
            wbc.retarget(motion, robot, wrong)


def test_contacts_and_rotations_of_parts_that_no_body_has_are_refused():
    motion, robot = made("squat"), retargeted("squat").robot
    for part, told in {
        "left_foot": {"contacts": {"left_foot": np.ones(motion.frames)}},  # its ankle and its toes are parts
        "hips": {"rotations": {"hips": np.tile(np.eye(3), (motion.frames, 1, 1))}},
    }.items():
        with pytest.raises(UnknownName, match=part):
            wbc.retarget(Motion(motion.rate, motion.positions, **told), robot)


def test_the_size_of_the_person_does_not_matter():
    motion, first = made("squat"), retargeted("squat")
    tall = Motion(motion.rate, {part: 1.2 * p for part, p in motion.positions.items()})
    again = wbc.retarget(tall, first.robot)
    np.testing.assert_allclose(again.q, first.q, atol=1e-3)


def test_a_hand_that_holds_stays_where_it_is():
    motion = made("reach")
    held = (np.arange(motion.frames) > 90) & (np.arange(motion.frames) < 130)
    told = Motion(motion.rate, motion.positions, contacts={"left_wrist": held})
    found = wbc.retarget(told, retargeted("squat").robot)
    wrist = soles(found, "left_wrist")[:, :3]
    assert np.ptp(wrist[held], axis=0).max() < 1e-4 < np.ptp(wrist, axis=0).max()


def test_a_quiet_motion_is_certified_and_said_so():
    found = retargeted("squat")
    assert found.certified == 1.0 and found.faults() == {} and str(found) == "100.0 % of 240 frames certified"


def test_what_is_saved_is_what_there_is(tmp_path):
    found = retargeted("squat")
    found.save(tmp_path / "m.npz")
    with np.load(tmp_path / "m.npz", allow_pickle=False) as file:
        np.testing.assert_array_equal(file["q"], found.q)
        assert list(file["joint_names"]) == list(found.robot.joint_names) and file["certified"].all()
    joints = list(reversed(found.robot.joint_names))
    found.to_csv(tmp_path / "m.csv", joints=joints)
    heads = (tmp_path / "m.csv").read_text(encoding="utf-8").splitlines()[0].split(",")
    assert [head for head in heads if head.startswith("q.")][7:] == [f"q.{joint} [rad]" for joint in joints]
    table = np.loadtxt(tmp_path / "m.csv", delimiter=",", skiprows=1)
    np.testing.assert_array_equal(table[:, heads.index(f"q.{joints[0]} [rad]")], found.q[:, -1])


def test_robots_that_have_no_feet_or_no_mapping_are_refused():
    with pytest.raises(InvalidInput, match="floating"):
        wbc.retarget(made("squat"), wbc.load("humanoid", base="fixed"))
    with pytest.raises(UnknownMapping, match="there is no mapping for 'quadruped'; there are: g1, humanoid, talos"):
        wbc.retarget(made("squat"), wbc.load("quadruped", base="floating"))
