"""What a loaded robot knows about itself: joints, limits, shapes, feet, its reference configuration."""

from __future__ import annotations

import errno
import os
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from tests.models.builders import inertial, joint, link, origin, saved, shape
from wbc.errors import InvalidInput, ModelError, UnknownJoint
from wbc.models import load
from wbc.models.feet import Foot
from wbc.models.geometry import Box, Cylinder, Origin, Sphere
from wbc.models.loading import read_description
from wbc.models.pinocchio_ import PinocchioModel
from wbc.models.soles import Measured
from wbc.models.urdf import Joint, Link, Urdf

SANE = 'lower="-1" upper="2" effort="30" velocity="4"'


def hinge(name: str, limit: str = SANE, kind: str = "revolute", extra: str = "") -> tuple[str, str, str]:
    """Name, kind and inside of a joint of :func:`written`."""
    return name, kind, f"<limit {limit}/>{extra}"


def written(folder: Path, *joints: tuple[str, str, str], inside: str = "", masses: int = 9) -> Path:
    """A chain of links a, b, c, … with these joints in between; the first ``masses`` links have one."""
    heavy = inertial(1.5, (0.1, 0.1, 0.1), origin("0.1 0 0.2", "0.1 0.2 0.3"))
    links = [
        link(name, heavy if i < masses else inertial(0.0, (0.0, 0.0, 0.0)), inside * (name == "a"))
        for i, name in enumerate("abcdefgh"[: len(joints) + 1])
    ]
    between = [
        joint(name, *ends, kind, more) for (name, kind, more), ends in zip(joints, pairwise("abcdefgh"), strict=False)
    ]
    return saved(folder, *links, *between, name="chain")


def test_joints_have_names_units_and_limits(tmp_path: Path):
    slide = hinge("slide", 'lower="0.1" upper="0.5" effort="100" velocity="0.3"', "prismatic")
    robot = load(written(tmp_path, hinge("swing"), slide, hinge("free", 'lower="-1" upper="1"')))
    assert robot.joint_names == ("swing", "slide", "free") and robot.joint_units == ("rad", "m", "rad")
    assert robot.limits.q_min.tolist() == [-1, 0.1, -1] and robot.limits.q_max.tolist() == [2, 0.5, 1]
    assert robot.limits.v_max.tolist() == [4, 0.3, np.inf] and robot.limits.tau_max.tolist() == [30, 100, np.inf]
    assert robot.joint("slide") == 1
    assert (robot.nq, robot.nv, robot.nb, robot.nj) == (3, 3, 0, 3)


def test_a_joint_without_end_has_one_position_and_no_position_limit(tmp_path: Path):
    robot = load(written(tmp_path, ("wheel", "continuous", ""), hinge("swing")))
    assert robot.nq == robot.nv == 2
    assert robot.limits.q_min[0] == -np.inf and robot.limits.q_max[0] == np.inf
    assert robot.limits.v_max[0] == robot.limits.tau_max[0] == np.inf
    state = robot.state()
    turned, once = np.array([1.0, 0.5]), np.array([1.0 + 2 * np.pi, 0.5])
    positions = []
    for q in (turned, once):
        state.update(0.0, q, np.zeros(2))
        positions.append(state.frame("c").position.copy())
        assert state.q_joints[0] == q[0]
    assert np.allclose(*positions)
    assert robot.difference(turned, once)[0] == pytest.approx(2 * np.pi)
    assert (np.abs([robot.random_configuration(np.random.default_rng(i))[0] for i in range(99)]) <= np.pi).all()


@pytest.mark.parametrize(
    ("limit", "sentence"),
    [
        ('lower="-1" upper="1" effort="0" velocity="2"', "the effort limit of joint 'odd' is 0"),
        ('lower="-1" upper="1" effort="5" velocity="-2"', "the velocity limit of joint 'odd' is -2"),
        ('lower="-1" upper="1" effort="nan" velocity="2"', "the effort limit of joint 'odd' is nan"),
        ('lower="1" upper="-1" effort="5" velocity="2"', r"of joint 'odd' are \[1, -1\]: the lower is above the upper"),
        ('effort="5" velocity="2"', r"the position limits of joint 'odd' are \[0, 0\]: it cannot move"),
    ],
)
def test_limits_that_make_no_sense_are_kept_and_said(tmp_path: Path, limit: str, sentence: str):
    with pytest.warns(UserWarning, match=sentence) as said:
        robot = load(written(tmp_path, hinge("odd", limit)))
    assert [w.filename for w in said] == [__file__]
    assert np.isfinite(robot.q0).all() and np.isfinite(robot.random_configuration(np.random.default_rng(0))).all()


def test_meshes_that_are_missing_are_counted_in_one_sentence(tmp_path: Path):
    meshes = "".join(shape(f'<mesh filename="{k}.stl"/>', kind="visual") for k in range(7))
    with pytest.warns(UserWarning, match=r"there is no mesh '0.stl' and 6 more are missing$"):
        load(written(tmp_path, hinge("swing"), inside=meshes))


@pytest.mark.parametrize("huge", ["1.1e8", "1e16", "3.4e38", "1.8e308"])
def test_limits_that_no_state_can_reach_are_none(tmp_path: Path, huge: str):
    """Gazebo writes 1e16: random configurations and searches would begin there."""
    limit = f'lower="-{huge}" upper="{huge}" effort="{huge}" velocity="{huge}"'
    robot = load(written(tmp_path, hinge("swing", limit), hinge("knee")))
    for values in vars(robot.limits).values():
        assert np.isinf(values[0]) and np.isfinite(values[1])
    q = [robot.random_configuration(np.random.default_rng(seed)) for seed in range(20)]
    assert 1.0 < np.abs(q).max() <= np.pi


def test_mimic_joints_move_by_themselves_and_this_is_said(tmp_path: Path):
    joints = [hinge("first"), hinge("second", extra='<mimic joint="first"/>')]
    with pytest.warns(UserWarning, match=r"'second' mimics 'first'; here each moves on its own until .*mimic_joints"):
        robot = load(written(tmp_path, *joints))
    assert robot.nj == 2
    third = hinge("third", extra='<mimic joint="first"/>')
    with pytest.warns(UserWarning, match="'second' mimics 'first' and 1 more mimic others; here") as said:
        load(written(tmp_path, *joints, third))
    assert len(said) == 1
    rigid = hinge("second", kind="fixed", extra='<mimic joint="first"/>')
    assert load(written(tmp_path, joints[0], rigid)).nj == 1  # a warning would be an error here


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("first", range(1, 7))
def test_all_joints_without_mass_are_named_at_once(tmp_path: Path, first: int):
    path = written(tmp_path, *(hinge(f"j{i}", 'effort="1" velocity="0"') for i in range(6)), masses=first)
    lightest = tuple(f"joint 'j{i}'" for i in range(first - 1, 6))
    with pytest.warns(UserWarning) as said:
        robot = load(path)
    assert robot.weightless == lightest and robot.state().frame("g").jacobian().shape == (6, 6)
    more = f", and {len(lightest) - 5} more" if len(lightest) > 5 else ""
    begins = f"chain: no inertia moves with {', '.join(lightest[:5])}{more}, so there is kinematics and no dynamics; "
    assert str(said[0].message).startswith(begins), "before six other sentences, of which the last are cut"


def test_a_robot_of_one_joint_has_matrices_of_one_column(tmp_path: Path):
    state = load(written(tmp_path, hinge("swing"))).state()
    frame = state.frame("b")
    assert frame.jacobian().shape == frame.jacobian_local().shape == (6, 1)
    assert state.M.shape == (1, 1) and state.com_jacobian.shape == (3, 1)
    assert state.h.shape == state.g.shape == (1,) and frame.drift().shape == (6,)
    q = np.array([0.3])
    assert state.model.integrate(q, q).shape == state.model.difference(q, q).shape == (1,)
    state.update(0.0, q, q)
    assert state.M[0, 0] > 0 and np.array_equal(frame.jacobian()[3:], [[0], [1], [0]])


def test_the_reference_is_zero_or_the_middle_of_limits_without_zero(tmp_path: Path):
    limits = ['lower="{}" upper="{}" effort="1" velocity="1"'.format(*pair) for pair in [(-1, 3), (0, 1), (-3, -1)]]
    robot = load(written(tmp_path, *(hinge(f"j{i}", limit) for i, limit in enumerate(limits))))
    assert robot.q0.tolist() == [0.0, 0.5, -2.0]


@pytest.mark.parametrize("locked", [0.5, -2.0])
def test_a_locked_joint_is_where_it_is_locked(tmp_path: Path, locked: float):
    path = written(tmp_path, hinge("swing", f'lower="{locked}" upper="{locked}" effort="1" velocity="1"'))
    with pytest.warns(UserWarning, match="it cannot move"):
        robot = load(path)
    assert robot.q0.tolist() == robot.random_configuration(np.random.default_rng(0)).tolist() == [locked]
    assert robot.configuration({}).tolist() == [locked]


def test_a_configuration_is_made_from_joint_names(tmp_path: Path):
    robot = load("humanoid")
    q = robot.configuration({"left_knee": 0.3, "right_knee": 0.4})
    assert q[7 + robot.joint("left_knee")] == 0.3 and q[7 + robot.joint("right_knee")] == 0.4
    with pytest.raises(UnknownJoint, match="'left_nee'; did you mean 'left_knee'"):
        robot.configuration({"left_nee": 0.3})
    with pytest.raises(InvalidInput, match=r"joints\['left_knee'\] is nan"):
        robot.configuration({"left_knee": float("nan")})
    for given in ("home", [1.0, 2.0], None):
        with pytest.raises(InvalidInput, match=r"^joints is .*; it must be positions by name; .* robot.configurations"):
            robot.configuration(given)


def test_what_pinocchio_is_given_is_what_the_file_says(tmp_path: Path):
    path = written(tmp_path, hinge("swing", extra='<origin xyz="0.1 0.2 0.3" rpy="1 -0.5 0.25"/>'), hinge("up"))
    ours, theirs = load(path).pinocchio, pin.buildModelFromUrdf(str(path))
    assert all(a == b for a, b in zip(ours.inertias, theirs.inertias, strict=True))
    assert all(a == b for a, b in zip(ours.jointPlacements, theirs.jointPlacements, strict=True))


def test_a_written_robot_reads_back_the_same(tmp_path: Path):
    for name in ("arm", "humanoid"):
        robot = load(name).urdf
        path = tmp_path / f"{name}.urdf"
        path.write_text(robot.text())
        again = read_description(path)
        bare = {"path": None, "folders": None, "visuals": (), "collisions": ()}
        assert replace(again, **bare) == replace(robot, **bare)


def test_numbers_are_written_in_full_and_without_infinities():
    joint = Joint("j", "revolute", "a", "b", Origin((0.1 + 0.2, 0, 0)), lower=-np.inf, upper=1 / 3, effort=np.nan)
    robot = Urdf("r", (Link("a"), Link("b")), (joint,))
    text = robot.text()
    assert 'xyz="0.30000000000000004 0 0"' in text and f'upper="{1 / 3}"' in text
    assert 'lower="-1e+30"' in text and 'velocity="1e+30"' in text and 'effort="0.0"' in text


def test_joints_can_be_made_rigid():
    urdf = load("arm").urdf
    robot = PinocchioModel(urdf.with_rigid(["wrist_roll", "elbow"]))
    assert robot.nj == 5 and "elbow" not in robot.joint_names and "tool" in robot.frame_names
    with pytest.raises(UnknownJoint, match="'elbo'; did you mean 'elbow'"):
        urdf.with_rigid(["elbo"])


def test_shapes_carry_place_size_and_colour(tmp_path: Path):
    """A colour that a shape names is that of others, and of the robot; its own is before that."""
    colour = '<color rgba="0 1 2 0.5"/>'
    seen = [
        ('<box size="1 2 3"/>', origin("1 2 3", "0 0 1"), '<material name="red"/>'),
        ('<cylinder radius="0.1" length="2"/>', "", f'<material name="own">{colour}</material>'),
        ('<sphere radius="1"/>', "", '<material name="own"/>'),
        ('<sphere radius="2"/>', "", '<material name="own"><color rgba="0 0 1 1"/></material>'),
        ('<sphere radius="3"/>', "", '<material name="none"/>'),
    ]
    drawn = "".join(shape(form, place + paint, "visual") for form, place, paint in seen) + "<visual/>"
    path = written(tmp_path, hinge("swing"), inside=drawn + shape('<sphere radius="0.2"/>'))
    red = '<material name="red"><color rgba="1 0 0 1"/></material></robot>'
    path.write_text(path.read_text().replace("</robot>", red))
    robot = load(path)
    assert [(one.link, one.shape, one.color) for one in robot.visuals] == [
        ("a", Box((1, 2, 3)), (1, 0, 0, 1)), ("a", Cylinder(0.1, 2), (0, 1, 1, 0.5)), ("a", Sphere(1), (0, 1, 1, 0.5)),
        ("a", Sphere(2), (0, 0, 1, 1)), ("a", Sphere(3), None),
    ]  # fmt: skip
    assert robot.visuals[0].origin == Origin((1, 2, 3), (0, 0, 1))
    assert [g.shape for g in robot.collisions] == [Sphere(0.2)] and robot.collisions[0].color is None


def test_origins_turn_about_fixed_axes():
    rpy = (0.3, -0.8, 2.1)
    turned = Origin((1, 2, 3), rpy)
    assert np.allclose(turned.rotation, pin.rpy.rpyToMatrix(*rpy), atol=1e-15)
    assert np.array_equal(turned.matrix[:3, 3], [1, 2, 3]) and np.array_equal(turned.matrix[3], [0, 0, 0, 1])


def test_links_are_frames_and_so_are_joints(tmp_path: Path):
    path = written(tmp_path, hinge("b"), hinge("swing"))
    frames = load(path).frame_names
    assert frames.count("b") == 1 and {"a", "b", "c", "swing"} == set(frames)


@pytest.mark.parametrize("base", ["fixed", "floating", "planar"])
@pytest.mark.parametrize("kind", ["fixed", "revolute"])
def test_a_robot_is_the_same_whatever_a_joint_is_called(tmp_path: Path, kind: str, base: Any):
    """Pinocchio has names of its own, and takes frames of one name for one."""
    limit = 'lower="-1" upper="1" effort="3" velocity="1"'

    def robot(name: str) -> PinocchioModel:
        return load(written(tmp_path, hinge(name, limit, kind), hinge("swing")), base=base, feet=[])

    known = robot("other")
    q, v = known.random_configuration(np.random.default_rng(0)), np.arange(known.nv) + 1.0
    for name in ("root_joint", "root_joint_", "world", "a", "b"):
        states = [one.state() for one in (known, robot(name))]
        for state in states:
            state.update(0.0, q, v)
        for read in (lambda s: s.M, lambda s: s.h, lambda s: s.frame("b").position, lambda s: s.frame("c").rotation):
            assert np.array_equal(*map(read, states)), name
        assert load(written(tmp_path, hinge(name, limit, kind), hinge("swing")), base=base).mass == known.mass
    with pytest.raises(ModelError, match="a joint is called 'universe', which is Pinocchio's name"):
        robot("universe")


def test_a_link_may_be_called_as_pinocchio_calls_the_world(tmp_path: Path):
    path = written(tmp_path, hinge("swing"))
    path.write_text(path.read_text().replace('"a"', '"universe"').replace('"b"', '"root_joint"'))
    for base in ("fixed", "floating"):
        assert {"universe", "root_joint"} <= set(load(path, base=base).frame_names)


def test_shapes_that_are_not_read_are_said(tmp_path: Path):
    with pytest.warns(UserWarning, match="a collision of link 'a' is left out: it is a <capsule>, not a box"):
        load(written(tmp_path, hinge("swing"), inside=shape('<capsule radius="1" length="1"/>')))


def test_a_base_is_fixed_or_floating(tmp_path: Path):
    path = written(tmp_path, hinge("swing"))
    fixed, floating = load(path), load(path, base="floating")
    assert (fixed.nq, fixed.nb) == (1, 0) and (floating.nq, floating.nv, floating.nb) == (8, 7, 6)
    assert fixed.mass == pytest.approx(1.5) and floating.mass == pytest.approx(3.0)
    assert floating.q0.tolist() == [0, 0, 0, 0, 0, 0, 1, 0]
    with pytest.raises(InvalidInput, match="base is 'free'; it must be one of fixed, floating, planar"):
        load(path, base="free")  # type: ignore[arg-type]


def test_a_robot_is_changed_by_making_another():
    robot = load("arm")
    slow = robot.replace(limits=replace(robot.limits, v_max=0.5 * robot.limits.v_max), q0=np.zeros(7))
    assert np.array_equal(slow.limits.v_max, 0.5 * robot.limits.v_max) and not slow.q0.any() and robot.q0.any()
    assert slow.state().model is slow
    with pytest.raises(InvalidInput, match=r"q0 must have shape \(7,\)"):
        robot.replace(q0=np.zeros(6))
    with pytest.raises(InvalidInput, match=r"limits.tau_max\[0\] is nan"):
        robot.replace(limits=replace(robot.limits, tau_max=np.full(7, np.nan)))


@pytest.mark.parametrize("length", [0.0, 0.5, 1.001])
def test_a_configuration_whose_quaternion_is_none_is_refused(length: float):
    """Its rotation would be none either, and M and the height of the feet with it."""
    robot = load("quadruped")
    q = np.array(robot.q0)
    q[3:7] *= length
    for give in (
        lambda: load("quadruped", q0=q),
        lambda: robot.replace(q0=q),
        lambda: robot.replace(configurations={"odd": q}),
        lambda: robot.on_ground(q),
    ):
        with pytest.raises(InvalidInput, match=rf"\[3:7\] is a quaternion of length {length:g}; it must be 1"):
            give()


def test_a_robot_of_a_package_that_is_missing_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(pin, "__file__", "/nowhere/pinocchio/__init__.py")
    monkeypatch.setattr("sys.path", [])
    with pytest.raises(ModelError, match=r"robot 'talos': .*pip install example-robot-data"):
        load("talos")


# ---- feet
def test_a_sole_of_balls_is_the_rectangle_inside_them():
    urdf = load("arm").urdf
    centres = [(-0.05, 0.025, -0.03), (-0.05, -0.025, -0.03), (0.12, 0.03, -0.03), (0.12, -0.03, -0.03)]
    balls = tuple(replace(urdf.collisions[0], shape=Sphere(0.005), origin=Origin(xyz)) for xyz in centres)
    robot = PinocchioModel(replace(urdf, collisions=balls))
    measured = Measured(robot, robot.q0)
    measured.add(Foot("base", "sole", 0.4))
    (foot,) = measured.feet
    assert (foot.frame, foot.friction, measured.added, measured.guessed) == ("base", 0.4, [], [])
    assert foot.half_size == pytest.approx((0.085, 0.025)) and foot.origin == pytest.approx((0.035, 0.0, -0.035))
    assert foot.radius == 0.005 and set(foot.balls) == set(centres)


def test_a_robot_with_other_masses_differs_in_its_dynamics_alone():
    robot = load("arm")
    heavy = robot.with_masses(np.linspace(1.0, 1.6, 7))
    mine, other = robot.state(), heavy.state()
    v = np.ones(7)
    for state in (mine, other):
        state.update(0.0, robot.q0, v)
    assert robot.mass < heavy.mass < 1.6 * robot.mass
    assert np.linalg.eigvalsh(np.array(other.M) - np.array(mine.M)).min() > -1e-12
    np.testing.assert_array_equal(other.frame("tool").jacobian(), mine.frame("tool").jacobian())
    doubled = robot.with_masses(2.0).state()
    doubled.update(0.0, robot.q0, v)
    np.testing.assert_allclose(doubled.h, 2.0 * mine.h, rtol=1e-12)
    for wrong, said in ((0.0, "> 0"), ([1.0, 2.0], "shape")):
        with pytest.raises(InvalidInput, match=said):
            robot.with_masses(wrong)


def test_a_folder_is_searched_past_what_cannot_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder and a scene of somebody else beside the robot's own file, which may be of either kind."""
    secret, locked = tmp_path / "secret", tmp_path / "locked.xml"
    secret.mkdir()
    for file in (secret / "file", locked):
        file.write_text("<mujoco/>")
    stat, open_ = os.stat, Path.open

    def denied(path: Any) -> None:
        raise PermissionError(errno.EACCES, "Permission denied", str(path))

    def guarded_stat(path: Any, *arguments: Any, **more: Any) -> Any:
        return denied(path) if str(path).startswith(f"{secret}{os.sep}") else stat(path, *arguments, **more)

    def guarded_open(path: Path, *arguments: Any, **more: Any) -> Any:
        return denied(path) if path == locked else open_(path, *arguments, **more)

    monkeypatch.setattr(os, "stat", guarded_stat)
    monkeypatch.setattr(Path, "open", guarded_open)
    with pytest.raises(ModelError):
        load(tmp_path)
    written(tmp_path, hinge("one"))
    assert load(tmp_path).joint_names == ("one",)
