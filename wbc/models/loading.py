"""``load``: a robot by its name, or from a URDF or MJCF file."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput, ModelError, UnknownRobot
from wbc.models import plausible
from wbc.models.catalogue import EXAMPLES, OWN, OWN_ROBOTS, Entry, example_robots, read_pose
from wbc.models.geometry import Origin
from wbc.models.mjcf_reader import read_mjcf
from wbc.models.safe_xml import read_xml
from wbc.models.urdf import Urdf
from wbc.models.urdf_reader import read_urdf
from wbc.types import Vec

if TYPE_CHECKING:
    from wbc.models.pinocchio_ import PinocchioModel


def load(
    name_or_path: str | Path,
    *,
    base: Literal["fixed", "floating"] | None = None,
    packages: Iterable[str | Path] = (),
) -> PinocchioModel:
    """A robot by its name, or from a URDF or MJCF file.

    Our own robots are "arm", "quadruped" and "humanoid"; "panda", "go2", "g1", "talos" and others need the package
    example-robot-data. ``base`` is what moves with the robot's first link: nothing ("fixed", the default for arms and
    files) or six velocities ("floating", the default for robots with legs and for an MJCF body with a free joint).

    MJCF (root element ``<mujoco>``) is compiled by MuJoCo, the extra ``sim``, after the checks that URDF passes: trees
    of hinges and slides with at most one free joint; bodies and named sites are frames (a site named as a body is
    ``<name>_site``), armature is part of M, equal joints are mimic joints. Springs, tendons and closed loops are left
    out with a warning. Options, keyframes and what stands still or lies about in the world are not the robot's.

    ``packages`` are further folders that ``package://`` and ``../`` in a file may lead to; meshes, and what an MJCF
    file includes, are taken from the file's own folder, its ROS package and these, never from elsewhere. Meshes that
    are missing, limits that make no sense, mimic joints, and inertias that no body has
    (:class:`~wbc.models.plausible.ImplausibleInertia`) are warned about.

    Raises:
        UnknownRobot: no such name and no such file; with the names that are near.
        ModelError: the file is not a robot, or the package with the robot is not installed.
        PathRefused: a mesh outside the allowed folders.
        InvalidInput: ``base`` or ``name_or_path`` is something else.

    Example:
        >>> from wbc.models import load
        >>> load("humanoid")
        humanoid (30 joints, floating base, 63.1 kg)
        >>> load("humanoyd")
        Traceback (most recent call last):
        wbc.errors.UnknownRobot: there is no robot 'humanoyd'; did you mean 'humanoid'...
    """
    if not isinstance(name_or_path, str | Path):
        raise InvalidInput(f"a robot is loaded by name or path, not by {type(name_or_path).__name__}")
    name = str(name_or_path)
    if base is not None:
        checks.one_of("base", base, ("fixed", "floating"))
    if isinstance(packages, str | Path) or not isinstance(packages, Iterable):
        raise InvalidInput(f"packages is {checks.shown(packages)}; it must be a list of folders")
    folders = []
    for i, given in enumerate(packages):
        if not isinstance(given, str | Path):
            raise InvalidInput(f"packages[{i}] is {checks.shown(given)}; it must be the path of a folder")
        folders.append(Path(given))
    if isinstance(name_or_path, Path) or os.sep in name or "." in name:
        return _named(None, Entry(name), Path(), base, folders)
    if name in OWN:
        return _named(name, OWN[name], OWN_ROBOTS, base, folders)
    if name not in EXAMPLES:
        raise UnknownRobot(name, [*OWN, *EXAMPLES], "or give the path of a URDF or MJCF file")
    try:
        folder = example_robots()
    except ModelError as missing:
        raise ModelError(f"robot {name!r}: {missing}") from None
    return _named(name, EXAMPLES[name], folder / "robots", base, [folder, *folders])


def _named(
    name: str | None, entry: Entry, folder: Path, base: Literal["fixed", "floating"] | None, packages: list[Path]
) -> PinocchioModel:
    from wbc.models.pinocchio_ import PinocchioModel

    urdf = read_description(folder / entry.urdf, packages=packages).with_rigid(entry.rigid)
    base = base or (entry.base if urdf.base is None else "floating")
    robot = PinocchioModel(urdf, base=base, name=name, feet=entry.feet(urdf))
    robot = robot.replace(q0=_stance(robot, entry, folder))
    oddities = urdf.oddities()
    idle = _without_inertia(robot)
    if idle:
        oddities.append(f"{idle} moves no inertia, so there is kinematics and no dynamics")
    for found, kind in ((oddities, UserWarning), (plausible.inertias(robot), plausible.ImplausibleInertia)):
        if found:
            more = f"; and {len(found) - 5} more" if len(found) > 5 else ""
            warnings.warn(f"{robot.name}: {'; '.join(found[:5])}{more}", kind, stacklevel=3)
    return robot


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


def _stance(robot: PinocchioModel, entry: Entry, folder: Path) -> Vec:
    """The reference configuration: the feet on the ground, or the base where the file with the stance puts it."""
    stance = {joint.name: joint.reference for joint in robot.urdf.joints if joint.reference} | dict(entry.stance)
    base: list[float] = []
    if entry.pose is not None:
        file, state = entry.pose
        pose = read_pose(folder / file, state)
        base = pose.pop("root_joint", [])
        stance |= {joint: position[0] for joint, position in pose.items() if joint in robot.joint_names}
    q0 = robot.configuration(stance)
    if robot.nb and robot.urdf.base is not None:
        q0[:7] = _xyz_quaternion(robot.urdf.base)
    if robot.nb and not robot.feet and len(base) == 7:
        q0[:7] = base
        q0[3:7] /= np.linalg.norm(q0[3:7])
    return q0


def _xyz_quaternion(origin: Origin) -> Vec:
    import pinocchio as pin

    return np.asarray(pin.SE3ToXYZQUAT(pin.SE3(origin.matrix)), dtype=np.float64)


def _without_inertia(robot: PinocchioModel) -> str:
    """What can move, or one of several that can move together, while nothing of any mass does; "" for nothing."""
    M = robot.state().M
    scale = np.sqrt(np.maximum(np.diag(M), 1e-300))
    values, directions = np.linalg.eigh(M / np.outer(scale, scale))
    if values[0] > 1e-10:
        return ""
    i = int(np.abs(directions[:, 0]).argmax()) - robot.nb
    return "the base" if i < 0 else f"joint {robot.joint_names[i]!r}"
