"""Motions in files: read as they were written, and refused by name where they are none."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given

from tests.reliability.test_fuzz_files import FOLDER, spoilt
from wbc.errors import InvalidInput, UnknownName, WbcError
from wbc.motion import Motion, Table, made
from wbc.motion.clip import PARTS, known_parts

CHAIN = """HIERARCHY
ROOT Hips
{
  OFFSET 1 2 3
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Spine
  {
    OFFSET 0 10 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    End Site
    {
      OFFSET 0 5 0
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.01
4 5 6 0 0 0 0 0 0
4 5 6 90 0 0 0 90 0
"""
#: What files of four makers call the parts that are needed, and the collar bones, which are none of them.
COLLARS = {"mixamo": "Shoulder", "xsens": "Shoulder", "smpl": "Collar", "acclaim": "Shoulder"}
NAMES = {
    "mixamo": {
        "hip": "UpLeg", "knee": "Leg", "ankle": "Foot", "toe": "ToeBase", "shoulder": "Arm", "elbow": "ForeArm",
        "wrist": "Hand",
    },
    "xsens": {
        "hip": "UpperLeg", "knee": "LowerLeg", "ankle": "Foot", "toe": "Toe", "shoulder": "UpperArm",
        "elbow": "ForeArm", "wrist": "Hand",
    },
    "smpl": {part: part for part in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")} | {"toe": "foot"},
    "acclaim": {
        "hip": "UpLeg", "knee": "LowLeg", "ankle": "Foot", "toe": "Toe", "shoulder": "UpArm", "elbow": "LowArm",
        "wrist": "Hand",
    },
}  # fmt: skip


def as_bvh(motion: Motion) -> str:
    """A motion as joints that are placed and not turned, in centimetres, y up."""
    parts = list(motion.positions)
    root, others = parts[0], parts[1:]
    places = {part: 100.0 * p[:, [1, 2, 0]] for part, p in motion.positions.items()}
    position = "CHANNELS 3 Xposition Yposition Zposition"
    joints = [f"JOINT {part} {{ OFFSET 0 0 0 {position} End Site {{ OFFSET 0 1 0 }} }}" for part in others]
    rows = np.hstack([places[root], *(places[part] - places[root] for part in others)])
    lines = "\n".join(" ".join(f"{x:.9g}" for x in row) for row in rows)
    header = f"HIERARCHY ROOT {root} {{ OFFSET 0 0 0 {position} {' '.join(joints)} }}"
    return f"{header}\nMOTION\nFrames: {motion.frames}\nFrame Time: {1 / motion.rate!r}\n{lines}\n"


def as_table(motion: Motion) -> tuple[list[str], list[list[float]]]:
    """The heading and the rows of a motion in columns."""
    heads = ["time", *(f"{part}.{axis}" for part, axis in product(motion.positions, "xyz"))]
    return heads, np.column_stack([motion.times, *motion.positions.values()]).tolist()


def as_csv(heads: list[str], rows: list[list[float]], gap: str = "\n") -> str:
    """Columns as text."""
    return gap.join(",".join(map(str, row)) for row in (heads, *rows))


def test_a_joint_is_placed_by_the_turns_of_those_above_it(tmp_path: Path):
    from wbc.motion.bvh import read_bvh

    (tmp_path / "chain.bvh").write_text(CHAIN)
    rate, found = read_bvh(tmp_path / "chain.bvh")
    positions, rotations = found["positions"], found["rotations"]
    assert rate == pytest.approx(100.0)
    # Axes of the file are y up and z ahead; of the world x ahead, y to the left, z up.
    up = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]])
    # Frame 0: as it stands. Frame 1: Rz(90°) takes y to −x; Rz(90°) Rx(90°) takes y to z.
    np.testing.assert_allclose(positions["Spine"], [up @ [4, 15, 6], up @ [-6, 5, 6]], atol=1e-12)
    np.testing.assert_allclose(positions["Spine end"], [up @ [4, 20, 6], up @ [-6, 5, 11]], atol=1e-12)
    np.testing.assert_allclose(rotations["Spine"][1], up @ [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=1e-12)


@pytest.mark.parametrize(
    ("name", "encoding", "gap"), [("walk", "utf-8", "\n"), ("dance", "utf-8", "\n"), ("squat", "utf-8-sig", "\n\n")]
)
def test_what_is_written_is_read(name: str, encoding: str, gap: str, tmp_path: Path):
    """Also behind a mark at the start, and between empty lines."""
    motion = made(name, seed=2)
    motion.save(tmp_path / "m.npz")
    (tmp_path / "m.bvh").write_text(as_bvh(motion), encoding)
    (tmp_path / "m.csv").write_text(as_csv(*as_table(motion), gap) + gap, encoding)
    for path in sorted(tmp_path.iterdir()):
        read = Motion.read(path)
        assert read.rate == pytest.approx(motion.rate) and read.frames == motion.frames
        for part, places in motion.positions.items():
            np.testing.assert_allclose(read.positions[part], places, atol=1e-7)


@pytest.mark.parametrize("metres", [1.0, 0.01, 0.0254, 0.001])
@pytest.mark.parametrize("size", [0.7, 1.0, 1.15])  # a child, and a person of two metres
def test_the_unit_of_a_file_is_told_by_the_size_of_the_body(metres: float, size: float, tmp_path: Path):
    motion = made("squat")
    tall = {part: size * p for part, p in motion.positions.items()}
    units = np.stack([*tall.values()], axis=1) / metres
    np.savez(tmp_path / "m.npz", names=[*tall], rate=motion.rate, positions=units)
    for part, places in Motion.read(tmp_path / "m.npz").positions.items():
        np.testing.assert_allclose(places, tall[part], atol=1e-9)


def test_two_columns_of_one_name_are_refused(tmp_path: Path):
    motion = made("squat")
    names = ["left_hip", *motion.positions]
    places = np.zeros((motion.frames, len(names), 3))
    np.savez(tmp_path / "m.npz", names=names, rate=60.0, positions=places)
    (tmp_path / "m.csv").write_text("time,left_hip.x,left_hip.y,left_hip.z,left_hip.x\n0,1,2,3,4\n1,1,2,3,4\n")
    for path in sorted(tmp_path.iterdir()):
        with pytest.raises(InvalidInput, match=r"two columns called 'left_hip"):
            Motion.read(path)


@pytest.mark.parametrize("cut", [lambda row: row[:-1], lambda row: [*row, 0.0], lambda row: row[: len(row) // 2]])
def test_a_row_that_is_no_row_of_the_heading_is_refused_by_its_line(
    cut: Callable[[list[float]], list[float]], tmp_path: Path
):
    """Rows of half the length would be one row in two, though every number is read."""
    heads, rows = as_table(made("squat"))
    for spoilt_rows, line in (([*rows[:7], cut(rows[7]), *rows[8:]], 9), ([cut(row) for row in rows], 2)):
        (tmp_path / "m.csv").write_text(as_csv(heads, spoilt_rows))
        with pytest.raises(InvalidInput, match=f"line {line} has {len(cut(rows[0]))} cells, the heading {len(heads)}"):
            Motion.read(tmp_path / "m.csv")


def test_rotations_and_contacts_are_kept(tmp_path: Path):
    plain = made("squat")
    turned = np.tile(np.eye(3), (plain.frames, 1, 1))
    motion = Motion(plain.rate, plain.positions, {"pelvis": turned}, {"left_wrist": np.arange(plain.frames) > 9})
    motion.save(tmp_path / "m.npz")
    read = Motion.read(tmp_path / "m.npz")
    assert set(read.rotations) == {"pelvis"} and set(read.contacts) == {"left_wrist"}
    np.testing.assert_array_equal(read.contacts["left_wrist"], motion.contacts["left_wrist"])


def test_motions_that_make_no_sense_are_refused():
    motion = made("squat")
    for about, wrong in (("positions", [None]), ("rotations", [motion.positions, None]),
                         ("contacts", [motion.positions, {}, 1])):  # fmt: skip
        with pytest.raises(InvalidInput, match=f"{about} is"):
            Motion(60.0, *wrong)
    for moments in ([0.0, 1.0, motion.frames], [-1.0, 0.0, 1.0], [[0.0]], [0.0, np.nan, 1.0]):
        with pytest.raises(InvalidInput, match="moments"):
            motion.at(moments)


@pytest.mark.parametrize("maker", NAMES)
def test_the_names_of_other_makers_are_known(maker: str):
    given = [f"{side}{part}" for side in ("Left", "Right") for part in (COLLARS[maker], *NAMES[maker].values())]
    found = known_parts("clip", ["Hips", "LeftHandThumb1", *given])
    for part, called in NAMES[maker].items():
        assert found[f"left_{part}"] == f"Left{called}", part


def test_a_part_that_lacks_is_named():
    with pytest.raises(UnknownName, match="left_toe"):
        known_parts("clip", [part for part in PARTS if part != "left_toe"])


@pytest.mark.parametrize(
    ("change", "about"),
    [
        (("ROOT", "ROUTE"), "at 'HIERARCHY ROUTE Hips"), (("Frames: 2", "Frames: 3"), "are promised"),
        (("Frames: 2", "Frames: 1e300"), "at 'MOTION Frames: 1e300"), (("0.01", "0"), "Frame Time is 0"),
        (("0 0 0 0 0 0\n", "0 0 0 x 0 0\n"), "in the motion"),
        (("Xrotation Yrotation\n    End", "Wrotation\n    End"), "Wrotation"),
        (("OFFSET 0 5 0", "OFFSET 0 nan 0"), "at 'End Site { OFFSET 0"), (("JOINT Spine", "JOINT Hips"), "one name"),
        (("0 10 0", "0 x 0"), "at 'JOINT Spine"), (("CHANNELS 3", "CHANNELS 4"), "at 'JOINT Spine"),
        (("MOTION", ""), "at 'Frames: 2 Frame Time"), ((CHAIN[CHAIN.index("Site") + 4 :], ""), "at 'End Site'"),
    ],
)  # fmt: skip
def test_a_bad_bvh_file_is_refused_by_name(change, about: str, tmp_path: Path):
    path = tmp_path / "bad.bvh"
    path.write_text(CHAIN.replace(*change))
    with pytest.raises(InvalidInput, match=r"bad\.bvh") as refused:
        Motion.read(path)
    assert about in str(refused.value)


@given(spoilt(as_bvh(made("squat")).encode()[:6000]))
def test_any_bytes_are_read_or_refused(content: bytes):
    path = FOLDER / "any.bvh"
    path.write_bytes(content)
    with suppress(WbcError):
        Motion.read(path)


def test_other_files_are_refused(tmp_path: Path):
    bad = {"a.txt": b"", "b.npz": b"no", "c.csv": b"time,x\n1,2", "d.csv": b"\xff", "e.bvh": b"\xff"}
    for name, content in bad.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InvalidInput, match=name):
            Motion.read(tmp_path / name)
    with pytest.raises(InvalidInput, match="nowhere"):
        Motion.read(tmp_path / "nowhere.bvh")
    np.savez(tmp_path / "f.npz", names=np.array([1, 2]), positions=np.zeros((3, 2, 3)), rate=60.0)
    with pytest.raises(InvalidInput, match="names must be text"):
        Motion.read(tmp_path / "f.npz")


def test_a_mapping_says_what_is_wrong_with_it(tmp_path: Path):
    path = tmp_path / "map.toml"
    for text, about in {
        "frames = 3": r"\[frames\]", "[frames]\npelviss = 'a'": "pelviss",
        "[frames]\npelvis = 'a'": "names no frame for",
        "[frames]\npelvis = {frame = 'a', weight = 3}": "pelvis is", "x": "cannot be read",
        "[frames]\npelvis = {frame = 'a', position = -1}": "position",
    }.items():  # fmt: skip
        path.write_text(text)
        with pytest.raises(InvalidInput, match=about):
            Table.read(path)
