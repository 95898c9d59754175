"""Plausibility: numbers that are allowed and look as if they were in another unit are warned about, not refused."""

from __future__ import annotations

from collections.abc import Sequence
from math import pi
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from wbc.errors import warn
from wbc.tolerances import MET
from wbc.types import Vec

if TYPE_CHECKING:
    from wbc.models.model import RobotModel
    from wbc.models.urdf import Urdf

#: By how much of the largest principal moment it may exceed the sum of the others: files round to two or three digits.
_ROUNDING = 1e-2
#: Radii of gyration √(I/m) [m] that no link has: thinner than a hair, wider than any robot.
_THIN, _WIDE = 1e-5, 20.0
#: A range of so many times what counts as met is exceeded by a hundredth of itself.
_NARROW = 100.0
#: No robot's foot, hand or wheel measures so much from its middle [m].
_LARGE = 5.0
#: A robot that reaches less far [m] may be one whose frames lie in its base.
_SHORT = 0.1
#: The share of gravity with which a robot may sink.
_SINKS = 0.05


class ImplausibleUnit(UserWarning):
    """A number that looks like degrees, milliseconds or millimetres."""


class ImplausibleInertia(UserWarning):
    """Mass and principal moments of inertia that no rigid body has."""


class NothingHoldsTheBase(UserWarning):
    """A floating base in gravity that no force acts on."""


class Sinks(UserWarning):
    """A robot so heavy that what its contact forces cost pulls it down."""


def doubt(sentence: str) -> None:
    """Warn."""
    warn(sentence, ImplausibleUnit)


def joints(model: RobotModel, name: str, positions: Vec) -> None:
    """Joint positions (nj,) beyond a whole turn, of joints whose limits are within one, look like degrees."""
    turning = np.array([unit == "rad" for unit in model.joint_units])
    low, high = model.limits.q_min, model.limits.q_max
    far = turning & (low >= -2.0 * pi) & (high <= 2.0 * pi) & (np.abs(positions) > 2.0 * pi)
    if far.any():
        i = int(far.argmax())
        doubt(
            f"{name} has {positions[i]:g} rad for joint {model.joint_names[i]!r}, whose limits are "
            f"[{low[i]:g}, {high[i]:g}]: are these degrees?"
        )


def upright(model: RobotModel, name: str, q: Vec) -> None:
    """A free base whose quaternion is (±1, 0, 0, 0) exactly looks like one with its scalar first."""
    if model.nb == 6 and model.nq - model.nj == 7 and abs(q[3]) == 1.0 and not q[4:7].any():
        doubt(f"{name} has {q[3:7].tolist()} for the base, which is upside down: quaternions are x, y, z, w here")


def position(model: RobotModel, name: str, point: Vec) -> None:
    """Points ten times farther than any frame of a robot with a fixed base is in q0 look like millimetres, unless it
    slides there."""
    far = float(np.abs(point).max(initial=0.0))
    if model.nb or not far > 10.0 * _SHORT:
        return
    state = model.state()
    reach = max([_SHORT, *(float(np.linalg.norm(state.frame(frame).position)) for frame in model.frame_names)])
    slides = np.array([unit == "m" for unit in model.joint_units])
    slide = float(np.maximum(np.abs(model.limits.q_min), np.abs(model.limits.q_max))[slides].sum())
    if far > 10.0 * reach + slide:
        doubt(f"{name} is {point} m, more than ten times as far as {model.name} reaches: are these millimetres?")


def extent(name: str, size: Any) -> None:
    """Sizes of a sole, an edge, a ball or a wheel, a number or (k,) [m], that no robot has look like millimetres."""
    if np.max(size) >= _LARGE:
        doubt(f"{name} is {np.asarray(size)} m, and no robot's foot, hand or wheel is as large: are these millimetres?")


def period(dt: float) -> None:
    """Ticks of half a second and more look like milliseconds."""
    if dt >= 0.5:
        doubt(f"dt is {dt:g} s: are these milliseconds?")


def torques(model: RobotModel, lower: Vec, upper: Vec) -> None:
    """Ranges of joint torques (nj,) not much wider than what counts as met look like another unit: they do not hold."""
    narrow = upper - lower < _NARROW * MET
    if narrow.any():
        i = int(narrow.argmax())
        unit = "N" if model.joint_units[i] == "m" else "N m"
        doubt(
            f"the torque of joint {model.joint_names[i]!r} is limited to [{lower[i]:g}, {upper[i]:g}] {unit}, "
            f"and a limit counts as met within {MET:g} {unit}: is this another unit?"
        )


def held(model: RobotModel, weights: Sequence[float]) -> None:
    """A floating base in gravity without contacts falls, whatever the joints do: they look forgotten. Contacts whose
    forces cost ½ w |f|², w in ``weights``, pull a robot of mass m down by g m² / Σ 1/w against tasks of weight 1."""
    if not (model.nb and model.gravity.any()):
        return
    share = model.mass**2 / sum(1.0 / w for w in weights) if weights and min(weights) > 0.0 else 0.0
    if share > _SINKS:
        said = (
            f"{model.name} has {model.mass:.0f} kg, and force_weight of its contacts lets tasks of weight 1 sink with "
            f"{share:.2g} g: give the contacts force_weight={min(weights) * 0.01 / share:.2g}"
        )
        warn(said, Sinks)
    if not weights:
        said = (
            f"{model.name} has a floating base and the stack has no contacts: no force holds the base, so it falls. "
            "Give the stack contacts, such as feet(robot), or load the robot with base='fixed'"
        )
        warn(said, NothingHoldsTheBase)


class Described(Protocol):
    """A robot with its description."""

    urdf: Urdf
    pinocchio: Any


def inertias(robot: Described) -> list[str]:
    """What is doubtful about each link that moves, with all that is fixed to it: one sentence a link.

    Principal moments I₁ <= I₂ <= I₃ of a body of mass m > 0 have I₁ > 0 and I₃ <= I₁ + I₂: I₃ = Σ m (x² + y²) counts
    x² of I₂ and y² of I₁. Moments below 1e-10 m² · m or above 400 m² · m look forgotten, or like another unit.

    Example:
        >>> from wbc.models import load
        >>> from wbc.models.plausible import inertias
        >>> inertias(load("arm"))
        []
    """
    links = {joint.name: joint.child for joint in robot.urdf.joints}
    found = []
    for name, inertia in list(zip(robot.pinocchio.names, robot.pinocchio.inertias, strict=True))[1:]:
        link = links.get(name, robot.urdf.root)
        mass, moments = float(inertia.mass), np.linalg.eigvalsh(inertia.inertia)
        least, middle, largest = moments.tolist()
        shown = f"principal moments {least:.3g}, {middle:.3g} and {largest:.3g} kg m²"
        if mass == 0.0:
            why = f"no mass, but {shown}" if largest > 0.0 else ""
        elif largest <= _THIN**2 * mass:
            why = f"a mass of {mass:g} kg and no inertia"
        elif largest > least + middle + _ROUNDING * largest:
            why = f"{shown}: no body has one that is larger than the sum of the others"
        elif largest > _WIDE**2 * mass:
            why = f"a mass of {mass:g} kg and {shown}: are these kg mm²?"
        else:
            continue
        if why:
            found.append(f"link {link!r} has {why}")
    return found
