"""Files that are not robots, or that want to read what is not theirs: one clear sentence each, and nothing read."""

from __future__ import annotations

import warnings
from pathlib import Path

import pytest

from wbc.errors import ModelError, PathRefused, UnknownRobot
from wbc.models import load, safe_xml
from wbc.models.folders import Folders

MASS = '<mass value="1"/>'
INERTIAL = f'<inertial>{MASS}<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
LINKS = f'<link name="base"/><link name="tip">{INERTIAL}</link>'
LIMIT = '<limit lower="-1" upper="1" effort="5" velocity="2"/>'
HINGE = (
    f'<joint name="hinge" type="revolute"><parent link="base"/><child link="tip"/><axis xyz="0 0 1"/>{LIMIT}</joint>'
)


def robot(body: str) -> str:
    return f'<robot name="r">{body}</robot>'


def joint(name: str, parent: str, child: str, inside: str = LIMIT, kind: str = "revolute") -> str:
    return f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{inside}</joint>'


def with_shape(shape: str) -> str:
    return robot(f'<link name="base"><visual><geometry>{shape}</geometry></visual></link>{LINKS[19:]}{HINGE}')


GOOD = robot(LINKS + HINGE)
BOMB = '<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">]>'

#: Links beside the robot's own.
PAIR, THIRD = '<link name="a"/><link name="b"/>', '<link name="c"/>'


def hinged(*more: str) -> str:
    """The robot with more in it."""
    return robot(LINKS + HINGE + "".join(more))


def changed(old: str, new: str) -> str:
    """The robot with a text replaced."""
    assert old in GOOD
    return GOOD.replace(old, new)


def placed(inside: str) -> str:
    """The robot whose joint has something before its limit."""
    return robot(LINKS + joint("hinge", "base", "tip", inside + LIMIT))


#: Content of the file, and what the refusal says.
HOSTILE: dict[str, tuple[str | bytes, str]] = {
    "nothing": ("", "not well-formed XML: no element found"),
    "prose": ("hello", "not well-formed XML: syntax error"),
    "cut off": (GOOD[:120], "not well-formed XML"),
    "binary": (b"\x89PNG\r\n\x1a\n\x00\xff", "not UTF-8 text: byte 0 is 0x89"),
    "another encoding": (GOOD.encode("utf-16"), "not UTF-8 text"),
    "two roots": (GOOD + GOOD, "not well-formed XML: junk after document element"),
    "MuJoCo's format without a robot": ("<mujoco><worldbody/></mujoco>", "no joint moves"),
    "Gazebo's format": ('<sdf version="1.7"/>', "(this is SDF"),
    "entity bomb": (BOMB + GOOD, "declares a document type"),
    "external entity": ('<!DOCTYPE r [<!ENTITY e SYSTEM "file:///etc/passwd">]><robot>&e;</robot>', "document type"),
    "entity without a declaration": ("<robot>&secret;</robot>", "not well-formed XML: undefined entity"),
    "nested deep": ("<robot>" + "<a>" * 200_000, "nested more than 50 deep"),
    "many elements": ("<robot>" + "<a/>" * 600_000 + "</robot>", "more than 500000 elements"),
    "empty robot": (robot(""), "no joint moves"),
    "no joints": (robot('<link name="base"/>'), "no joint moves"),
    "nothing moves": (robot(LINKS + joint("weld", "base", "tip", "", "fixed")), "no joint moves"),
    "link without a name": (hinged("<link/>"), "a <link> has no name"),
    "joint without a name": (changed('name="hinge" ', ""), "a <joint> has no name"),
    "links of one name": (hinged('<link name="tip"/>'), "2 links are called 'tip'"),
    "joints of one name": (hinged('<link name="end"/>', joint("hinge", "tip", "end")), "2 joints are called 'hinge'"),
    "two parents": (
        hinged('<link name="other"/>', joint("more", "other", "tip")), "link 'tip' has two parents: 'base' and 'other'",
    ),
    "unknown parent": (
        changed('parent link="base"', 'parent link="bass"'), "joint 'hinge' has the parent 'bass', which is not a link",
    ),
    "unknown child": (
        changed('child link="tip"', 'child link="tap"'), "joint 'hinge' has the child 'tap', which is not a link",
    ),
    "no parent": (changed('<parent link="base"/>', ""), "joint 'hinge' has no <parent>"),
    "its own parent": (hinged(joint("self", "base", "base")), "link 'base' is its own ancestor"),
    "loop": (hinged(PAIR, joint("ab", "a", "b"), joint("ba", "b", "a")), "link 'a' is its own ancestor"),
    "hanging below a loop": (  # the link that hangs there is none of its ancestors
        hinged(PAIR, THIRD, joint("bc", "b", "c"), joint("cb", "c", "b"), joint("ba", "b", "a")),
        "link 'b' is its own ancestor",
    ),
    "two trees": (hinged(PAIR, joint("ab", "a", "b")), "links 'base' and 'a' both have no parent"),
    "joint without a type": (changed(' type="revolute"', ""), "joint 'hinge' has no type"),
    "joint of another type": (
        changed("revolute", "planar"),
        "joint 'hinge' is 'planar'; joints may be fixed, revolute, continuous, prismatic, "
        "and a base that moves is load(..., base='planar')",
    ),
    "no limit": (changed(LIMIT, ""), "joint 'hinge' is revolute and has no <limit>"),
    "zero axis": (changed("0 0 1", "0 0 0"), "the axis of joint 'hinge' is zero"),
    "axis of two numbers": (changed("0 0 1", "0 1"), "xyz is '0 1'; it must be 3 finite numbers"),
    "NaN origin": (
        placed('<origin xyz="0 nan 0"/>'),
        "an origin of joint 'hinge': xyz is '0 nan 0'; it must be 3 finite numbers",
    ),
    "infinite origin": (placed('<origin rpy="0 0 1e999"/>'), "1e999"),
    "limit in words": (changed('upper="1"', 'upper="one"'), "upper is 'one'; it must be 1 number"),
    "negative mass": (changed(MASS, '<mass value="-1e-9"/>'), "link 'tip' has a mass of -1e-09 kg"),
    "NaN mass": (changed(MASS, '<mass value="nan"/>'), "the mass of link 'tip'"),
    "negative inertia": (changed('ixx="1"', 'ixx="-1"'), "link 'tip' has a principal inertia of -1 kg m²"),
    "inertia without mass": (changed(MASS, ""), "link 'tip' has an <inertial> without <mass> or <inertia>"),
    "ball of negative size": (with_shape('<sphere radius="-1"/>'), "radius is '-1'; it must not be negative"),
    "mesh without a file": (with_shape("<mesh/>"), "a visual of link 'base' has no filename"),
}  # fmt: skip


def write(folder: Path, content: str | bytes) -> Path:
    path = folder / "robot.urdf"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def test_the_file_that_the_others_are_made_from_is_a_robot(tmp_path: Path):
    assert load(write(tmp_path, GOOD)).joint_names == ("hinge",)


@pytest.mark.parametrize(("content", "sentence"), HOSTILE.values(), ids=HOSTILE)
def test_a_bad_file_is_refused_in_one_sentence(content: str | bytes, sentence: str, tmp_path: Path):
    path = write(tmp_path, content)
    with pytest.raises(ModelError) as refusal:
        load(path)
    message = str(refusal.value)
    assert sentence in message
    assert message.startswith(f"{path}: ") and "\n" not in message


@pytest.mark.parametrize(
    ("spoil", "sentences"),
    [
        (lambda i: joint(f"j{i}", f"l{i}", f"l{i + 1}", ""), "joint 'j{}' is revolute and has no <limit>"),
        (lambda i: joint(f"j{i}", f"l{i}", f"l{i + 1}", LIMIT, "ball"), "joint 'j{}' is 'ball'"),
        (lambda i: joint(f"j{i}", f"l{i}", f"m{i}"), "joint 'j{}' has the child 'm{}', which is not a link"),
        (
            lambda i: joint(f"j{i}", f"l{i}", f"l{i + 1}", '<origin xyz="0 1e20 0"/>' + LIMIT),
            "an origin of joint 'j{}' has 1e+20 m",
        ),
    ],
)
def test_all_that_is_wrong_with_joints_is_said_at_once(spoil, sentences: str, tmp_path: Path):
    bad = (1, 3, 4)
    links = "".join(f'<link name="l{i}"/>' for i in range(7))
    joints = "".join(spoil(i) if i in bad else joint(f"j{i}", f"l{i}", f"l{i + 1}") for i in range(6))
    with pytest.raises(ModelError) as refusal:
        load(write(tmp_path, robot(links + joints)))
    for i in bad:
        assert sentences.format(i, i) in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_file_that_is_too_large_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(safe_xml, "MAX_BYTES", 1_000_000)
    with pytest.raises(ModelError, match="larger than 1 MB"):
        load(write(tmp_path, GOOD + " " * 1_000_000))


def test_what_is_not_a_plain_file_is_not_opened(tmp_path: Path):
    with pytest.raises(ModelError, match="this is not a file"):
        load(tmp_path)
    with pytest.raises(ModelError, match="this is not a file"):
        load("/dev/zero")
    with pytest.raises(ModelError, match="there is no such file"):
        load(tmp_path / "missing.urdf")
    with pytest.raises(UnknownRobot, match=r"no robot 'robot'.*or give the path of a URDF or MJCF file"):
        load("robot")
    with pytest.raises(ModelError, match="text of a description is no path"):
        load(f"\n{GOOD}")


# ---- meshes
@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A folder with urdf/, meshes/base.stl, and a secret beside it."""
    for folder in ("my_robot/urdf", "my_robot/meshes", "elsewhere"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "my_robot/meshes/base.stl").write_text("solid base")
    (tmp_path / "my_robot/urdf/own.stl").write_text("solid own")
    (tmp_path / "elsewhere/secret.stl").write_text("solid secret")
    return tmp_path / "my_robot"


def mesh(package: Path, reference: str) -> Path:
    return write(package / "urdf", with_shape(f'<mesh filename="{reference}"/>'))


OUTSIDE = [
    "../../elsewhere/secret.stl", "../meshes/base.stl", "meshes/../../../elsewhere/secret.stl", "/etc/passwd",
    "file:///etc/passwd", "file:///%2e%2e/etc/passwd", "/dev/zero", "link.stl", "loop.stl", "x" * 5000,
    "http://example.org/base.stl", "data://text/base.stl",
]  # fmt: skip
#: Those that are outside the package too.
NO_WAY_OUT = [
    "package://my_robot/../elsewhere/secret.stl", "package:///my_robot/../elsewhere/secret.stl",
    "package://../elsewhere/secret.stl", "../../elsewhere/secret.stl",
]  # fmt: skip


@pytest.mark.parametrize(
    ("reference", "packages"), [(one, False) for one in OUTSIDE] + [(one, True) for one in NO_WAY_OUT]
)
def test_a_mesh_outside_the_folder_or_package_is_refused(package: Path, reference: str, packages: bool):
    (package / "urdf/link.stl").symlink_to(package.parent / "elsewhere/secret.stl")
    (package / "urdf/loop.stl").symlink_to(package / "urdf/loop.stl")
    with pytest.raises(PathRefused) as refusal:
        load(mesh(package, reference), packages=[package] * packages)
    assert reference[:50] in str(refusal.value)


def test_a_refusal_names_the_path_and_the_folders(package: Path):
    with pytest.raises(PathRefused, match=f"'../meshes/base.stl' is outside the folders .*: {package / 'urdf'}"):
        load(mesh(package, "../meshes/base.stl"))


@pytest.mark.parametrize(
    "reference", ["package://my_robot/meshes/base.stl", "../meshes/base.stl", "own.stl", "file://{}/urdf/own.stl"]
)
def test_meshes_inside_the_folders_are_found(package: Path, reference: str):
    reference = reference.format(package)
    given = load(mesh(package, reference), packages=[package])
    inside = load(mesh(package, reference), packages=[package.parent])
    (package / "package.xml").write_text("<package/>")
    own = load(mesh(package, reference))
    for found in (given, inside, own):
        (visual,) = found.visuals
        assert visual.shape.path.is_file() and visual.shape.path.is_relative_to(package)


def test_a_file_of_macros_says_how_to_expand_them(tmp_path: Path):
    path = write(tmp_path, robot('<x:include xmlns:x="http://www.ros.org/wiki/xacro" filename="arm"/>' + LINKS + HINGE))
    assert load(path).nj == 1  # what is left over in a file that was expanded
    path = path.rename(tmp_path / "arm.urdf.xacro")
    with pytest.raises(ModelError, match=r"run xacro arm\.urdf\.xacro > arm\.urdf"):
        load(path)


@pytest.mark.parametrize("where", ["{}", "src/{}", "src/robots-main/{}", "a/b/c/{}"])
@pytest.mark.parametrize("folder", ["clone-of-my-arm", "my_arm"])
def test_a_workspace_finds_its_packages_by_their_own_names(where: str, folder: str, tmp_path: Path):
    place = tmp_path / "workspace" / where.format(folder)
    place.mkdir(parents=True)
    (place / "package.xml").write_text("<package><name>my_arm</name></package>")
    (place / "link.stl").write_text("a mesh")
    found = Folders.around(tmp_path, [tmp_path / "workspace"]).find("package://my_arm/link.stl")
    is_far = where.startswith("a/")
    assert found == (None if is_far else place / "link.stl")


def test_a_package_has_the_name_in_its_package_xml_wherever_it_was_unpacked(package: Path):
    (package / "package.xml").write_text("<package><name> my_arm </name></package>")
    (visual,) = load(mesh(package, "package://my_arm/meshes/base.stl")).visuals
    assert visual.shape.path == package / "meshes/base.stl"


@pytest.mark.parametrize("reference", ["gone.stl", "package://unknown/base.stl", "package://my_robot/gone.stl"])
def test_a_missing_mesh_is_a_warning(package: Path, reference: str):
    with pytest.warns(UserWarning, match=f"there is no mesh '{reference}'"):
        robot = load(mesh(package, reference), packages=[package])
    assert robot.visuals == ()


def test_nothing_of_a_file_reaches_other_libraries_that_was_not_read(tmp_path: Path):
    extra = '<gazebo><plugin filename="/lib/evil.so"/></gazebo><mujoco><compiler meshdir="/"/></mujoco><link2/>'
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        text = load(write(tmp_path, robot(extra + LINKS + HINGE))).urdf.text()
    assert not any(word in text for word in ("gazebo", "plugin", "mujoco", "link2"))
