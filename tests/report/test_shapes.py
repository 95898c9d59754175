"""A robot as triangles: whole, within budget, and there even when the model shows nothing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wbc.models import PlanarPR, load
from wbc.models.pinocchio_ import PinocchioModel
from wbc.report import shapes
from wbc.report.meshes import read_mesh
from wbc.types import Mat


@pytest.mark.parametrize("name", ["arm", "quadruped", "humanoid"])
def test_our_robots_show_every_part_in_a_frame_they_have(name: str):
    robot = load(name)
    parts = shapes.parts(robot)
    assert {part.link for part in parts} == {visual.link for visual in robot.visuals}
    assert {part.link for part in parts} <= set(robot.frame_names)
    for part in parts:
        assert np.isfinite(part.vertices).all() and part.faces.min() >= 0 and part.faces.max() < len(part.vertices)


@pytest.mark.parametrize("name", ["arm", "quadruped", "humanoid"])
def test_a_robot_without_shapes_gets_bones_from_joint_to_joint(name: str):
    full = load(name)
    bare = PinocchioModel(replace(full.urdf, visuals=(), collisions=()), base="fixed")
    bones = shapes.parts(bare)
    moving = [joint for joint in full.urdf.joints if np.linalg.norm(joint.origin.xyz) > 0.05]
    assert len(bones) >= len(moving) > 0
    assert {bone.link for bone in bones} <= set(bare.frame_names)
    for bone, joint in zip(
        shapes.parts(bare), (j for j in full.urdf.joints if j.parent == bones[0].link), strict=False
    ):
        reach = np.linalg.norm(bone.vertices - np.array(joint.origin.xyz), axis=1).min()
        assert reach <= np.linalg.norm(joint.origin.xyz)


@given(budget=st.integers(200, 4000))
def test_thinning_ends_within_the_budget_and_keeps_the_outline(budget: int):
    parts = shapes.parts(load("arm"))
    thin = shapes.thinned(parts, budget)
    assert sum(len(part.faces) for part in thin) <= budget
    for before, after in zip(parts, thin, strict=True):
        assert np.all(after.vertices.min(axis=0) >= before.vertices.min(axis=0) - 1e-9)
        assert np.all(after.vertices.max(axis=0) <= before.vertices.max(axis=0) + 1e-9)


def test_a_planar_chain_has_a_rod_for_a_link_that_turns_and_a_block_on_a_rail_for_one_that_slides():
    robot = PlanarPR(m1=1.0, m2=1.0, l2=0.6, d2=0.3, I2=0.1)
    drawn = shapes.parts(robot)
    assert [part.link for part in drawn] == ["base", "link1", "link2"]
    rod = drawn[-1].vertices
    assert np.allclose([rod[:, 0].min(), rod[:, 0].max()], [-0.03, 0.63]) and np.ptp(rod[:, 2]) < 0.1
    assert {part.link for part in drawn} <= set(robot.frame_names)


# ---- mesh files: the same box in every format has the same volume; what cannot be read is left out
#: A box of 0.2 × 0.4 × 0.6, two triangles for each side (a, b, c, d): (a, b, c) and (a, c, d).
VERTICES = np.array([[x, y, z] for x in (-0.1, 0.1) for y in (-0.2, 0.2) for z in (-0.3, 0.3)])
SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
FACES = np.array([triangle for a, b, c, d in SIDES for triangle in ((a, b, c), (a, c, d))])

COLLADA = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
 <asset><unit meter="{unit}"/><up_axis>Y_UP</up_axis></asset>
 <library_effects><effect id="e"><profile_COMMON><technique sid="t"><phong><diffuse><color>1 0.5 0 1</color></diffuse>
 </phong></technique></profile_COMMON></effect></library_effects>
 <library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
 <library_geometries><geometry id="g"><mesh>
  <source id="p"><float_array id="a" count="{count}">{positions}</float_array><technique_common>
   <accessor source="#a" count="8" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
   <param name="Z" type="float"/></accessor></technique_common></source>
  <source id="n"><float_array id="b" count="3">0 0 1</float_array><technique_common>
   <accessor source="#b" count="1" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
   <param name="Z" type="float"/></accessor></technique_common></source>
  <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
  {primitive}
 </mesh></geometry></library_geometries>
 <library_visual_scenes><visual_scene id="s">
  <node><node><translate>{shift}</translate><rotate>0 0 1 {turn}</rotate><instance_geometry url="#g"><bind_material>
   <technique_common><instance_material symbol="sym" target="#m"/></technique_common></bind_material>
  </instance_geometry></node></node>
  <node><matrix>-1 0 0 9 0 1 0 0 0 0 1 0 0 0 0 1</matrix><instance_geometry url="#g"/></node>
 </visual_scene></library_visual_scenes>
 <scene><instance_visual_scene url="#s"/></scene>
</COLLADA>"""


def numbers(values: object) -> str:
    """Numbers with spaces between them."""
    return " ".join(f"{x!r}" for x in np.asarray(values).ravel().tolist())


def primitive(kind: str) -> str:
    """The box as triangles, as quadrilaterals by counts, or as polygons one by one; indices between others."""
    normals = '<input semantic="NORMAL" source="#n" offset="0"/>'
    mesh = f'material="sym"><input semantic="VERTEX" source="#v" offset="1"/>{normals}'
    with_normals = np.stack([np.zeros_like(FACES), FACES], axis=-1)
    if kind == "triangles":
        return f"<triangles {mesh}<p>{numbers(with_normals)}</p></triangles>"
    quads = [[a, b, c, d] for (a, b, c), (_, _, d) in zip(FACES[::2], FACES[1::2], strict=True)]
    runs = [numbers([[0, corner] for corner in quad]) for quad in quads]
    if kind == "polylist":
        return f"<polylist {mesh}<vcount>4 4 4 4 4 4</vcount><p>{' '.join(runs)}</p></polylist>"
    return f"<polygons {mesh}{''.join(f'<p>{run}</p>' for run in runs)}</polygons>"


def volume(vertices: Mat, faces: np.ndarray) -> float:
    """Volume inside a closed surface whose triangles turn outwards."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Somewhere to write."""
    return tmp_path_factory.mktemp("meshes")


@pytest.mark.parametrize("beginning", [b"anything", b"solid but binary"])
def test_a_binary_stl_is_told_by_its_size_not_by_its_first_word(folder: Path, beginning: bytes):
    record = np.zeros(len(FACES), np.dtype([("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")]))
    record["c"] = VERTICES[FACES]
    path = folder / "box.STL"
    path.write_bytes(beginning.ljust(80) + len(FACES).to_bytes(4, "little") + record.tobytes())
    (surface,) = read_mesh(path)
    assert len(surface.vertices) == 8 and volume(surface.vertices, surface.faces) == pytest.approx(0.048)


def test_a_text_stl_is_read(folder: Path):
    corners = ["\n".join(f"vertex {numbers(v)}" for v in VERTICES[face]) for face in FACES]
    path = folder / "text.stl"
    path.write_text(
        "solid x\n" + "\n".join(f"facet\nouter loop\n{c}\nendloop\nendfacet" for c in corners) + "\nendsolid"
    )
    (surface,) = read_mesh(path)
    assert volume(surface.vertices, surface.faces) == pytest.approx(0.048)


def test_an_obj_counts_from_one_or_from_the_end_and_has_polygons(folder: Path):
    quads = [[a, b, c, d] for (a, b, c), (_, _, d) in zip(FACES[::2], FACES[1::2], strict=True)]
    lines = [f"v {numbers(v)}" for v in VERTICES] + ["vn 0 0 1", "# a comment", ""]
    lines += ["f " + " ".join(f"{i + 1}/2/1" for i in quad) for quad in quads[:3]]
    lines += ["f " + " ".join(f"{i - 8}//1" for i in quad) for quad in quads[3:]]
    path = folder / "box.obj"
    path.write_text("\n".join(lines))
    (surface,) = read_mesh(path)
    assert len(surface.faces) == 12 and volume(surface.vertices, surface.faces) == pytest.approx(0.048)


@given(
    kind=st.sampled_from(["triangles", "polylist", "polygons"]), unit=st.sampled_from([1.0, 0.01, 0.001]),
    shift=st.tuples(*[st.floats(-3, 3)] * 3), turn=st.floats(-180, 180),
)  # fmt: skip
def test_collada_is_placed_scaled_and_coloured(folder: Path, kind: str, unit: float, shift: tuple, turn: float):
    path = folder / "box.dae"
    text = COLLADA.format(
        unit=unit, count=24, positions=numbers(VERTICES), primitive=primitive(kind), shift=numbers(shift), turn=turn
    )
    path.write_text(text)
    placed, mirrored = read_mesh(path)
    assert placed.color == pytest.approx((1.0, 0.5, 0.0), abs=1 / 255) and mirrored.color is None
    # pycollada keeps single precision
    assert np.allclose(placed.vertices.mean(axis=0), unit * np.array(shift), atol=1e-6)
    assert np.allclose(mirrored.vertices.mean(axis=0), [9 * unit, 0, 0], atol=1e-6)
    for surface in (placed, mirrored):
        assert len(surface.faces) == 12
        assert volume(surface.vertices, surface.faces) == pytest.approx(0.048 * unit**3)


BROKEN = {
    "empty.stl": "", "words.stl": "vertex a b c", "two.stl": "vertex 0 0 0 vertex 1 0 0", "far.obj": "v 0 0 0\nf 1 2 3",
    "half.obj": "v 1 2", "plain.dae": "not xml", "other.dae": "<robot/>", "bare.dae": "<COLLADA/>",
    "entity.dae": '<!DOCTYPE x [<!ENTITY y "z">]><COLLADA/>', "kind.xyz": "0 0 0", "nan.obj": "v nan 0 0\nf 1 1 1",
    "lost.dae": COLLADA.replace("{primitive}", "").replace('url="#g"', 'url="#nowhere"'),
}  # fmt: skip


@pytest.mark.parametrize("name", BROKEN)
def test_a_file_that_cannot_be_read_is_left_out(folder: Path, name: str):
    (folder / name).write_text(BROKEN[name])
    assert read_mesh(folder / name) == []


def test_a_file_that_is_not_there_is_left_out(folder: Path):
    assert read_mesh(folder / "nothing.stl") == []


def test_nodes_in_a_circle_end(folder: Path):
    nodes = '<node id="n"><instance_node url="#n"/></node>'
    (folder / "circle.dae").write_text(f'<COLLADA><visual_scene id="s">{nodes}</visual_scene></COLLADA>')
    assert read_mesh(folder / "circle.dae") == []
