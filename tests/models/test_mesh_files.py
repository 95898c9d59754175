"""Mesh files that are missing, empty, cut off or spoilt: one typed error with the path, where shapes are read."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import wbc
from tasks import CollisionAvoidance, Posture
from tests.models.builders import inertial, joint, link, saved, shape
from wbc.errors import ModelError, WbcError
from wbc.models.coal_ import coal_shape, mesh_points
from wbc.models.collision import Obstacle
from wbc.models.geometry import Mesh
from wbc.report.meshes import read_mesh

CORNERS = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
FACES = [(0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)]
COLLADA = """<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="1"/></asset><library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="a" count="12">
{corners}</float_array><technique_common><accessor source="#a" count="4" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source><vertices id="v">
<input semantic="POSITION" source="#p"/></vertices><triangles count="4">
<input semantic="VERTEX" source="#v" offset="0"/><p>{faces}</p></triangles></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node>
<instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


def sound() -> dict[str, bytes]:
    """The same tetrahedron in each format, by the name of the file."""
    triangles = np.array([[CORNERS[i] for i in face] for face in FACES], dtype="<f4")
    text = "".join(
        "facet normal 0 0 1\nouter loop\n" + "".join(f"vertex {x} {y} {z}\n" for x, y, z in t) + "endloop\nendfacet\n"
        for t in triangles.tolist()
    )
    each = b"".join(bytes(12) + t.tobytes() + b"\0\0" for t in triangles)
    words = {
        "corners": " ".join(str(x) for corner in CORNERS for x in corner),
        "faces": " ".join(str(i) for face in FACES for i in face),
    }
    lines = [f"v {x} {y} {z}" for x, y, z in CORNERS] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in FACES]
    return {
        "text.stl": f"solid x\n{text}endsolid x\n".encode(),
        "binary.stl": bytes(80) + len(FACES).to_bytes(4, "little") + each,
        "mesh.obj": "\n".join(lines).encode(),
        "mesh.dae": COLLADA.format(**words).encode(),
    }


SPOILT = {
    "empty": lambda content: b"",
    "words": lambda content: b"hello",
    "zeros": lambda content: bytes(1000),
    "noise": lambda content: random.Random(1).randbytes(4000),
    "a third": lambda content: content[: len(content) // 3],
    "half": lambda content: content[: len(content) // 2],
    "many faces": lambda content: content[:80] + b"\xff\xff\xff\xff" + content[84:],
}


@pytest.mark.parametrize("name", sound())
def test_a_sound_file_is_read(tmp_path: Path, name: str):
    path = tmp_path / name
    path.write_bytes(sound()[name])
    shape, middle = coal_shape(Mesh(path, (2.0, 1.0, 1.0)))
    assert shape.num_points == 4 and middle.translation.tolist() == [1.0, 0.5, 0.5]


@pytest.mark.parametrize("unit", ["1", "0.0254", "1e-3", " .01 "])
@pytest.mark.parametrize("words", ['meter="{}"', 'name="inch" meter="{}"', "meter = '{}' name='inch'"])
def test_what_collides_is_as_large_as_what_is_drawn(tmp_path: Path, unit: str, words: str):
    path = tmp_path / "mesh.dae"
    path.write_bytes(sound()["mesh.dae"].replace(b'meter="1"', words.format(unit).encode()))
    (drawn,) = read_mesh(path)
    np.testing.assert_allclose(mesh_points(Mesh(path)).max(axis=0), drawn.vertices.max(axis=0), rtol=1e-12)
    np.testing.assert_allclose(mesh_points(Mesh(path, (2.0, 1.0, 3.0))).max(axis=0), float(unit) * np.array([2, 1, 3]))


@pytest.mark.parametrize("spoilt", SPOILT)
@pytest.mark.parametrize("name", sound())
def test_a_spoilt_file_is_refused_by_its_path(tmp_path: Path, name: str, spoilt: str):
    path = tmp_path / name
    path.write_bytes(SPOILT[spoilt](sound()[name]))
    with pytest.raises(WbcError) as refusal:
        coal_shape(Mesh(path))
    assert str(path) in str(refusal.value) and "\n" not in str(refusal.value)
    assert isinstance(refusal.value, ModelError)
    read_mesh(path)


@pytest.mark.parametrize("seed", range(200))
def test_any_bytes_give_a_shape_or_a_typed_error(tmp_path: Path, seed: int):
    rng = random.Random(seed)
    name, content = rng.choice(list(sound().items()))
    path, data = tmp_path / name, bytearray(content)
    for _ in range(rng.randint(1, 6)):
        data[rng.randrange(len(data))] = rng.randrange(256)
    path.write_bytes(bytes(data))
    try:
        assert coal_shape(Mesh(path))[0].num_points >= 4
    except WbcError as refusal:
        assert str(path) in str(refusal)


def test_a_file_that_is_too_large_is_not_read(tmp_path: Path):
    path = tmp_path / "large.stl"
    with path.open("wb") as file:
        file.truncate(10**12)
    with pytest.raises(ModelError, match=r"large\.stl cannot be read: it is larger than 200 MB"):
        coal_shape(Mesh(path))


@pytest.mark.parametrize("gone", [False, True])
def test_a_controller_that_needs_the_mesh_is_not_made(tmp_path: Path, gone: bool):
    mesh = tmp_path / "part.stl"
    mesh.write_bytes(b"")
    links = [link(name, inertial(), shape('<mesh filename="part.stl"/>')) for name in "ab"]
    robot = wbc.load(saved(tmp_path, *links, joint("j", "a", "b")))
    if gone:
        mesh.unlink()
    stack = wbc.Stack([Posture(robot.q0)], subject_to=[CollisionAvoidance(margin=0.01)])
    with pytest.raises(ModelError, match=r"part\.stl cannot be read" + (": No such file" if gone else "")):
        wbc.Controller(robot, stack, level=wbc.VelocityLevel(), dt=1e-3)


def test_an_obstacle_whose_mesh_is_missing_is_refused(tmp_path: Path):
    robot = wbc.load("arm")
    obstacle = Obstacle("vase", Mesh(tmp_path / "vase.obj"), pin.SE3.Identity())
    stack = wbc.Stack([Posture(robot.q0)], subject_to=[CollisionAvoidance(margin=0.01, obstacles=[obstacle])])
    with pytest.raises(ModelError, match=r"vase\.obj cannot be read: No such file"):
        wbc.Controller(robot, stack, level=wbc.VelocityLevel(), dt=1e-3)


@pytest.mark.physics
@pytest.mark.parametrize("spoilt", ["empty", "words", "zeros", "noise", "a third"])
@pytest.mark.parametrize("name", ["binary.stl", "mesh.obj"])
def test_a_spoilt_mesh_of_an_mjcf_file_is_refused_by_its_path(tmp_path: Path, name: str, spoilt: str):
    pytest.importorskip("mujoco")
    (tmp_path / name).write_bytes(SPOILT[spoilt](sound()[name]))
    path = tmp_path / "robot.xml"
    path.write_text(
        f'<mujoco><asset><mesh name="m" file="{name}"/></asset><worldbody><body><joint axis="0 0 1"/>'
        '<geom type="mesh" mesh="m"/></body></worldbody></mujoco>'
    )
    with pytest.raises(ModelError) as refusal:
        wbc.load(path)
    assert str(tmp_path / name) in str(refusal.value)
