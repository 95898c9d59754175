"""``load``: a robot by its name, from a URDF or MJCF file, or from a model in memory."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, final

import numpy as np

from wbc import checks
from wbc.arguments import tells_arguments
from wbc.errors import InvalidInput, ModelError, UnknownConfiguration, UnknownRobot, warn
from wbc.files import located
from wbc.models import plausible
from wbc.models.catalogue import EXAMPLES, OWN, OWN_ROBOTS, Entry, example_robots
from wbc.models.feet import Foot, Guessed
from wbc.models.mjcf_reader import read_compiled, read_mjcf
from wbc.models.poses import BASE, NamedPose, configuration, read_poses, srdf_beside, standing
from wbc.models.safe_xml import read_xml
from wbc.models.urdf import Joint, Urdf
from wbc.models.urdf_reader import read_urdf
from wbc.types import Vec

if TYPE_CHECKING:
    from wbc.models.pinocchio_ import Base, PinocchioModel


#: How far into a file its root element is looked for [bytes], and how many folders deep a robot's file.
_HEAD, _DEPTH = 4096, 4
#: Soles that lean by less are the rounding of a file, by more no soles in this configuration [rad].
_LEANS, _FALLS = np.radians(0.5), np.radians(30.0)


@tells_arguments
def load(
    robot: str | Path | Any,
    *,
    base: Base | None = None,
    feet: Iterable[str | Foot] | None = None,
    srdf: str | Path | Mapping[str, Mapping[str, float]] | None = None,
    q0: str | Mapping[str, float] | Vec | None = None,
    packages: Iterable[str | Path] = (),
) -> PinocchioModel:
    """A robot by its name, from a URDF or MJCF file, or from a model in memory.

    ``robot``: a name; the path of a file, or of a folder with one robot file in it; a ``pinocchio.Model`` or
    ``RobotWrapper``, a ``mujoco.MjModel`` or ``MjSpec``; a module with ``URDF_PATH`` or ``MJCF_PATH``, as the package
    robot_descriptions has them. A model in memory is read once: what is changed in it later changes no robot.

    Our own robots are "arm", "quadruped" and "humanoid"; "panda", "go2", "g1", "talos" and others need the package
    example-robot-data. ``base`` says how the robot's first link moves: not at all ("fixed", the default for arms and
    files), six velocities ("floating", the default for robots with legs and for an MJCF body with a free joint), or
    three joints ``base_x``, ``base_y`` [m] and ``base_yaw`` [rad] without limits, in world axes ("planar", the default
    for a ``pinocchio.Model`` with a planar joint). What an MJCF draws with a
    free joint is fixed where it is drawn, or drives at that height.

    ``feet``: what the robot stands on: frames, or :class:`~wbc.models.feet.Foot` with its size and friction. A foot
    given by its frame alone is measured on the robot's shapes, a sole or a ball. Default, where the base floats: the
    ends of its limbs that are lowest in the reference configuration. ``[]``: none.

    ``srdf``: a file whose group states are the robot's named configurations, or these themselves, {name: {joint:
    position}}. Default: the SRDF beside the file or in a folder ``srdf`` next to it; keyframes of an MJCF are there
    too. ``robot.configurations`` has them all.

    ``q0``: the reference configuration: one of these names, positions by joint (the other joints at rest), or all of it
    (nq,). Default, where the base floats: the one called half_sitting, standing, stand, home or default. The base is
    put where the lowest foot touches z = 0, unless all of ``q0`` is given. One warning lists what was guessed:
    :class:`~wbc.models.feet.Guessed`.

    MJCF (root element ``<mujoco>``) is compiled by MuJoCo, the extra ``sim``, after the checks that URDF passes: trees
    of hinges and slides with at most one free joint; bodies and named sites are frames (a site named as a body is
    ``<name>_site``), armature is part of M, equal joints are mimic joints, and bodies that are joined are loops
    (``wbc.tasks.mimic_joints``, ``loop_closures``). Springs, tendons and another gravity than 9.81 m/s² along −z are
    left out with a warning. Other options and what stands still or lies about in the world are not the robot's. Joints
    are in the order of ``joint_names``, limb by limb, limbs of one link in the alphabetical order of their joints: not
    as in ``qpos`` (:class:`~wbc.sim.bridge.Bridge` converts).

    ``packages`` are further folders that ``package://`` and ``../`` in a file may lead to; meshes, and what an MJCF
    file includes, are taken from the file's own folder, its ROS package and these, never from elsewhere. Meshes that
    are missing, limits that make no sense, mimic joints, soles that do not look up, inertias that no body has
    (:class:`~wbc.models.plausible.ImplausibleInertia`), and a ``q0`` that looks like degrees
    (:class:`~wbc.models.plausible.ImplausibleUnit`) are warned about.

    Raises:
        UnknownRobot: no such name and no such file; with the names that are near.
        UnknownConfiguration, UnknownJoint, UnknownFrame: what ``q0`` or ``feet`` name does not exist.
        ModelError: the file is not a robot, or the package with the robot is not installed.
        PathRefused: a mesh outside the allowed folders.
        InvalidInput: ``robot`` is nothing of these, or another argument makes no sense.

    Example:
        >>> from wbc.models import load
        >>> load("humanoid")
        humanoid (30 joints, floating base, 63.1 kg)
        >>> load("humanoyd")
        Traceback (most recent call last):
        wbc.errors.UnknownRobot: there is no robot 'humanoyd'; did you mean 'humanoid'...
    """
    if base is not None:
        checks.one_of("base", base, ("fixed", "floating", "planar"))
    folders = [located(folder) for folder in _listed("packages", packages, str | Path, "the path of a folder")]
    entry, name, urdf, built = _described(robot, folders)
    own: Base = entry.base if urdf.base is None else "floating"
    wanted = _Wanted(base or own, name, entry)
    if feet is not None:
        wanted.feet = _listed("feet", feet, str | Foot, "a frame or a Foot")
    loaded = wanted.robot(urdf, None if built is None else built(wanted.base), srdf, q0)
    is_whole = q0 is not None and not isinstance(q0, str | Mapping)
    oddities = urdf.oddities() + ([] if is_whole else _fallen(loaded))
    if loaded.weightless:
        oddities.insert(0, f"no inertia moves with {_few(loaded.weightless)}, so there is kinematics and no dynamics")
    guessed = wanted.guessed if name is None else []  # of robots that are known by name it is known
    if guessed:
        guessed = [f"{'; '.join(guessed)} (load(..., feet=, srdf=, q0=) says otherwise)"]
    for found, kind in (
        (oddities, UserWarning), (plausible.inertias(loaded), plausible.ImplausibleInertia), (guessed, Guessed)
    ):  # fmt: skip
        if found:
            warn(f"{loaded.name}: {_few(found, '; ')}", kind)
    return loaded


def _few(found: Sequence[str], between: str = ", ") -> str:
    """The first five, and how many more there are."""
    more = [f"and {len(found) - 5} more"] if len(found) > 5 else []
    return between.join([*found[:5], *more])


def _described(robot: Any, folders: list[Path]) -> tuple[Entry, str | None, Urdf, Any]:
    """What is known of a robot, its name if it is known by it, its description, its models by base if it is one."""
    for attribute in ("URDF_PATH", "MJCF_PATH") if isinstance(robot, ModuleType) else ():
        if hasattr(robot, attribute):
            around = [getattr(robot, f"{key}_PATH", None) for key in ("PACKAGE", "REPOSITORY")]
            folders = [*(Path(folder) for folder in around if folder), *folders]
            robot = Path(getattr(robot, attribute))
            break
    if isinstance(robot, str | Path):
        text = str(robot)
        if text.lstrip().startswith("<"):
            raise ModelError("the text of a description is no path; write it to a file, and give the path of that")
        if isinstance(robot, Path) or os.sep in text or "." in text:
            path = _robot_file(located(robot, ModelError))
            return Entry(str(path)), None, read_description(path, packages=folders), None
        entry, folder = _entry(text)
        folders = [folder.parent, *folders] if text in EXAMPLES else folders
        urdf = read_description(folder / entry.urdf, packages=folders)
        return entry, text, urdf.with_rigid(entry.rigid), None
    if "mujoco" in sys.modules and type(robot).__name__ in ("MjModel", "MjSpec"):
        return Entry(""), None, read_compiled(robot), None
    import pinocchio as pin

    from wbc.models.pinocchio_source import read_pinocchio

    model = getattr(robot, "model", robot)
    if not isinstance(model, pin.Model):
        raise InvalidInput(
            f"a robot is loaded by name or path, or from a model of Pinocchio or MuJoCo, not by {type(robot).__name__}"
        )
    shapes = (getattr(robot, f"{kind}_model", None) for kind in ("collision", "visual"))
    urdf, base, built = read_pinocchio(model, *shapes)
    return Entry("", base=base), None, urdf, built


def _robot_file(path: Path) -> Path:
    """The path itself, or the one URDF or MJCF in a folder and not far below it."""
    if not path.is_dir():
        return path
    near = [file for depth in range(_DEPTH) for file in sorted(path.glob("*/" * depth + "*")) if os.path.isfile(file)]
    found = [file for file in near if file.suffix == ".urdf"]
    found = found or [file for file in near if file.suffix == ".xml" and _is_mjcf(file)]
    if len(found) > 1:
        files = ", ".join(str(file.relative_to(path)) for file in found[:12])
        raise ModelError(f"{path}: there are {len(found)} robot files in this folder; give the path of one: {files}")
    return found[0] if found else path


def _is_mjcf(file: Path) -> bool:
    try:
        with file.open("rb") as content:
            return b"<mujoco" in content.read(_HEAD)
    except OSError:  # what cannot be read is no robot file
        return False


def _listed(name: str, given: Any, kind: Any, what: str) -> list[Any]:
    items = enumerate(checks.items(name, given, what))
    return [checks.instance(f"{name}[{i}]", item, kind, what) for i, item in items]


def _entry(name: str) -> tuple[Entry, Path]:
    """A robot that is known by its name, and the folder that its files are in."""
    if name in OWN:
        return OWN[name], OWN_ROBOTS
    if name not in EXAMPLES:
        raise UnknownRobot(name, [*OWN, *EXAMPLES], "or give the path of a URDF or MJCF file")
    try:
        return EXAMPLES[name], example_robots() / "robots"
    except ModelError as missing:
        raise ModelError(f"robot {name!r}: {missing}") from None


@final
@dataclass
class _Wanted:
    """How a robot is to stand; ``guessed`` are sentences on what nobody said, ``straight`` means that no pose is."""

    base: Base
    name: str | None
    entry: Entry
    feet: Sequence[str | Foot] | None = None
    guessed: list[str] = field(default_factory=list)
    straight: bool = False

    def robot(self, urdf: Urdf, model: Any, srdf: Any, q0: Any) -> PinocchioModel:
        from wbc.models.pinocchio_ import PinocchioModel
        from wbc.models.soles import Measured

        urdf = {"fixed": urdf.on_world, "planar": urdf.on_plane}.get(self.base, lambda: urdf)()
        robot = PinocchioModel(urdf, base=self.base, name=self.name, model=model)
        poses = dict(urdf.poses) | self._named(robot, srdf)
        whole = q0 is not None and not isinstance(q0, str | Mapping)
        q = configuration(robot, "q0", q0) if whole else _posed(robot, self._pose(robot, poses, q0))
        measured = Measured(robot, q)
        feet = self.entry.feet if self.feet is None else self.feet
        if feet is None and self.base == "floating":
            measured.guess()
        for foot in feet or ():
            measured.add(foot)
        if self.straight and not measured.feet:
            q, self.guessed = _posed(robot, _drawn(robot)), []
        self.guessed += measured.guessed
        if measured.feet:
            urdf = urdf.with_frames(measured.added)
            model = None if model is None else _with_frames(model, robot.frames, measured.added)
            robot = PinocchioModel(urdf, base=self.base, name=self.name, feet=measured.feet, model=model)
        configurations = {name: _levelled(robot, _posed(robot, pose)) for name, pose in poses.items()}
        plausible.joints(robot, "q0", q[robot.nq - robot.nj :])
        if whole:
            plausible.upright(robot, "q0", q)
        return robot.replace(q0=q if whole else _levelled(robot, q), configurations=configurations)

    def _named(self, robot: PinocchioModel, srdf: Any) -> dict[str, NamedPose]:
        """Those given, or of the SRDF beside the file, which is passed over where it is not one."""
        if isinstance(srdf, str | Path):
            return dict(read_poses(Path(srdf)))
        if isinstance(srdf, Mapping) and all(isinstance(pose, Mapping) for pose in srdf.values()):
            for pose in srdf.values():
                robot.configuration(pose)
            return {name: {joint: [x] for joint, x in pose.items()} for name, pose in srdf.items()}
        if srdf is not None:
            raise InvalidInput(f"srdf is {checks.shown(srdf)}; it must be a path, or positions by name and joint")
        beside = None if robot.urdf.path is None else srdf_beside(robot.urdf.path)
        try:
            return {} if beside is None else dict(read_poses(beside))
        except ModelError:
            return {}

    def _pose(self, robot: PinocchioModel, poses: Mapping[str, NamedPose], q0: Any) -> NamedPose:
        """Positions by joint: those asked for; or what the file draws, with a stance if it has one."""
        if isinstance(q0, str):
            if q0 not in poses:
                raise UnknownConfiguration(q0, poses)
            return poses[q0]
        drawn = _drawn(robot)
        if q0 is not None:
            robot.posed(q0)
            return drawn | {joint: [position] for joint, position in q0.items()}
        stance = {joint: [position] for joint, position in self.entry.stance.items()}
        name = self.entry.pose
        if robot.nb and not stance:
            name = standing(name for name, pose in poses.items() if _is_within_limits(robot, pose))
            self.guessed.append(f"q0 is {name!r}" if name else "in q0 joints are as straight as their limits allow")
            self.straight = name is None
        if self.straight:
            drawn = _straight(robot) | drawn
        return drawn | (dict(poses[name]) if name is not None else {}) | stance


def _drawn(robot: PinocchioModel) -> dict[str, list[float]]:
    """Where the file draws joints that it does not draw at zero."""
    return {joint.name: [joint.reference] for joint in robot.urdf.joints if joint.reference}


def _straight(robot: PinocchioModel) -> dict[str, list[float]]:
    """Zero, or the limit that is nearest to it: legs are straight then, and their soles level, in most descriptions."""
    limits = robot.limits
    return {
        joint: [min(max(0.0, low), high)]
        for joint, low, high in zip(robot.joint_names, limits.q_min.tolist(), limits.q_max.tolist(), strict=True)
    }


def _with_frames(model: Any, frames: Mapping[str, int], mounts: Iterable[Joint]) -> Any:
    import pinocchio as pin

    for mount in mounts:
        index = frames[mount.parent]
        carrier, at = model.frames[index], pin.SE3(mount.origin.matrix)
        model.addFrame(pin.Frame(mount.child, carrier.parentJoint, index, carrier.placement * at, pin.FrameType.BODY))
    return model


def _posed(robot: PinocchioModel, pose: NamedPose) -> Vec:
    """A configuration, standing on the feet that are known; joints that the robot has not are passed over."""
    import pinocchio as pin

    positions = {joint: values for joint, values in pose.items() if joint in robot.joint_names and len(values)}
    q = robot.posed({joint: v[0] if len(v) == 1 else float(np.arctan2(v[1], v[0])) for joint, v in positions.items()})
    if robot.nb and robot.urdf.base is not None:
        q[:7] = pin.SE3ToXYZQUAT(pin.SE3(robot.urdf.base.matrix))
    base = np.array(pose.get(BASE, ()))
    if robot.nb and base.shape == (7,) and base[3:].any():
        q[:7] = base
        q[3:7] /= np.linalg.norm(base[3:])
    return robot.on_ground(q)


def read_description(path: str | Path, *, packages: Iterable[str | Path] = ()) -> Urdf:
    """Read a URDF or MJCF file. ``packages``: folders that ``package://`` and ``../`` may lead to, beside its own.

    Raises:
        ModelError: the file cannot be read or is not a robot; the message names the file and says what is wrong.
        PathRefused: a mesh outside the folders.
    """
    path = Path(path)
    try:
        root = read_xml(path, "robot", "mujoco")
        return (read_mjcf if root.tag == "mujoco" else read_urdf)(root, path, packages=packages)
    except ModelError as error:
        raise type(error)(f"{path}: {error}") from None
    except OSError as cause:
        raise ModelError(f"{str(path)[:200]}: it cannot be read: {cause.strerror}") from None


def _is_within_limits(robot: PinocchioModel, pose: NamedPose) -> bool:
    q, limits = _posed(robot, pose)[robot.nq - robot.nj :], robot.limits
    sane = limits.q_min < limits.q_max
    return bool(((limits.q_min <= q) & (q <= limits.q_max) | ~sane).all())


def _fallen(robot: PinocchioModel) -> list[str]:
    """Sentences on soles whose normal, the z axis of their frame, is not up where a free robot stands."""
    state, found = robot.state(), []
    for frame in (foot.frame for foot in robot.feet.values() if robot.nb and foot.half_size is not None):
        lean = float(np.arccos(np.clip(state.frame(frame).rotation[2, 2], -1.0, 1.0)))
        if lean > _FALLS:
            found.append(
                f"the normal of a sole is the z axis of its frame {frame!r}, which leans by {np.degrees(lean):.0f}° in "
                "q0 (of a frame alone the sole is measured)"
            )
    return found


def _levelled(robot: PinocchioModel, q: Vec) -> Vec:
    """On the ground, and where the soles lean by half a degree and more, turned until their mean normal is up."""
    import pinocchio as pin

    soles = [foot.frame for foot in robot.feet.values() if foot.half_size is not None]
    if robot.nb and soles:
        state = robot.state()
        state.update(0.0, q, np.zeros(robot.nv))
        normal = np.sum([state.frame(frame).rotation[:, 2] for frame in soles], axis=0)
        turn = pin.Quaternion.FromTwoVectors(normal, np.array([0.0, 0.0, 1.0]))
        if _LEANS < pin.AngleAxis(turn).angle < _FALLS:
            q[3:7] = (turn * pin.Quaternion(q[3:7])).coeffs()
    return robot.on_ground(q)
