"""Measured feet: the lowest points of the shapes of a robot in a configuration, as soles and points."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from wbc.errors import ModelError
from wbc.models.feet import Foot
from wbc.models.geometry import Box, Cylinder, Geometry, Mesh, Origin, Sphere, triple
from wbc.models.urdf import Joint, unused
from wbc.types import Mat, Vec

if TYPE_CHECKING:
    from wbc.models.pinocchio_ import PinocchioModel

#: Ends of limbs that are no feet.
_HAND = re.compile("hand|gripper|finger|palm|wrist", re.IGNORECASE)
#: The friction that a foot is expected to have where nobody says.
FRICTION = 0.5
#: What lies this far above the lowest point touches too [m]; a rectangle whose half sides are shorter is a point [m].
_LAYER, _LEAST_SOLE = 0.002, 0.015
#: Feet stand at heights within this share of the hips' height above them; 1 − cos of how far a sole may lean, 45°.
_LEVEL, _LEANING = 0.05, 0.293
#: A round foot, seen by the points of a mesh: how much of it is looked at, its largest radius, how exact [m].
_CAP, _LARGEST_BALL, _ROUND = 0.01, 0.1, 0.001
#: How far a wheel is turned to know it [rad], and how much its lowest point then moves, as a share of its radius.
_TURNED, _OUT_OF_ROUND = 1.0, 0.1
#: Sides of shapes are straight up to rounding: to so many digits of a metre.
_DIGITS = 9


class Measured:
    """Feet of a robot as they stand in the configuration ``q``, and the frames that had to be added for them."""

    def __init__(self, robot: PinocchioModel, q: Vec) -> None:
        self._robot, self._state = robot, robot.state()
        self._state.update(0.0, q, np.zeros(robot.nv))
        self._joint_of = {name: int(robot.pinocchio.frames[i].parentJoint) for name, i in robot.frames.items()}
        links = {link.name for link in robot.urdf.links}
        self._links = [name for name in robot.frame_names if name in links]  # from the root on
        self.feet: list[Foot] = []
        self.added: list[Joint] = []
        self._measured_feet: list[Foot] = []

    def guess(self) -> None:
        """Feet are the ends of two limbs or more, not wheels, at one height, below the hips and below the trunk."""
        model = self._robot.pinocchio
        ends = [i for i in range(2, model.njoints) if not len(model.children[i]) and not self._is_of_a_hand(i)]
        heights = {i: self._height(i) for i in range(1, model.njoints)}
        if not ends:
            return
        hips = max(heights[i] for i in model.children[1])
        near = [i for i in ends if heights[i] <= min(heights.values()) + 0.5 * (hips - min(heights.values()))]
        clouds = {i: self._cloud(self._on(i)) for i in near}
        lowest = {i: float((points[:, 2] - radii).min()) for i, (points, radii) in clouds.items() if len(points)}
        lowest = {i: low for i, low in lowest.items() if not self._rolls(i, low)}
        ground = min(lowest.values(), default=np.inf)
        standing = [i for i, low in lowest.items() if low <= ground + _LEVEL * (hips - ground)]
        if len(standing) < 2 or hips <= ground:
            return
        points, radii = self._cloud(self._on(1))
        if (points[:, 2] - radii).min(initial=hips) > ground:
            for i in standing:
                self.feet.append(self._measured(self._on(i), clouds[i], FRICTION))
            self._measured_feet += self.feet

    def _is_of_a_hand(self, end: int) -> bool:
        """Whether links from the end of a limb back to where limbs part are called as those of hands; so are fingers
        of any name on a hand."""
        model, links, joint = self._robot.pinocchio, self._on(end), int(self._robot.pinocchio.parents[end])
        while joint > 1:
            links += self._on(joint)
            joint = int(model.parents[joint]) if len(model.children[joint]) == 1 else 0
        return bool(_HAND.search(" ".join(links)))

    def _rolls(self, joint: int, low: float) -> bool:
        """Whether the end of a limb is a wheel: it turns without end, and turned reaches as far down as before."""
        robot, model = self._robot, self._robot.pinocchio
        if np.isfinite(robot.limits.q_max[robot.joint(model.names[joint])]):
            return False
        q = np.array(self._state.q)
        q[model.idx_qs[joint]] += _TURNED
        points, radii = Measured(robot, q)._cloud(self._on(joint))
        return bool(abs((points[:, 2] - radii).min() - low) < _OUT_OF_ROUND * (self._height(joint) - low))

    def add(self, foot: str | Foot) -> None:
        """A foot as it is; or, of a frame alone, what is on its link, or else on all that is fixed to that; a point
        where nothing is."""
        known = isinstance(foot, Foot)
        frame, friction = (foot.frame, foot.friction) if isinstance(foot, Foot) else (foot, FRICTION)
        self._robot.check_frame(frame)
        if isinstance(foot, Foot) and (foot.kind == "point" or foot.half_size is not None):
            self.feet.append(foot)
            return
        clouds = [self._cloud(links) for links in ([frame], self._on(self._joint_of[frame]))]
        cloud = next((cloud for cloud in clouds if len(cloud[0])), None)
        found = Foot(frame, "point", friction) if cloud is None else self._measured([frame], cloud, friction)
        self.feet.append(found)
        if not known:
            self._measured_feet.append(found)

    @property
    def guessed(self) -> list[str]:
        """Sentences on the feet of which nobody said what they are."""
        alike: dict[str, list[str]] = {}
        for foot in self._measured_feet:
            x, y = (200.0 * side for side in foot.half_size or (0.0, 0.0))
            size = f"sole of {x:.1f} x {y:.1f} cm" if x else f"ball of {1e3 * foot.radius:.0f} mm"
            alike.setdefault(f"a {size}, friction {foot.friction:g}", []).append(repr(foot.frame))
        return [f"foot {', '.join(frames)}: {what}" for what, frames in alike.items()]

    # ---- where things are
    def _height(self, joint: int) -> float:
        return float(self._state.frame(next(n for n, i in self._joint_of.items() if i == joint)).position[2])

    def _on(self, joint: int) -> list[str]:
        return [link for link in self._links if self._joint_of.get(link) == joint]

    def _cloud(self, links: Iterable[str]) -> tuple[Mat, Vec]:
        """Balls that the shapes on some links are the hull of: centres (n, 3) in the world, and radii (n,) [m]."""
        points, radii = [np.zeros((0, 3))], [np.zeros(0)]
        for shapes in (self._robot.collisions, self._robot.visuals):
            for geometry in (shape for shape in shapes if shape.link in links):
                corners, radius = _corners(geometry)
                frame = self._state.frame(geometry.link)
                here = corners @ geometry.origin.rotation.T + geometry.origin.xyz
                points.append(here @ frame.rotation.T + frame.position)
                radii.append(np.full(len(corners), radius))
            if len(points) > 1:
                break
        return np.concatenate(points), np.concatenate(radii)

    # ---- what a foot is
    def _measured(self, links: Sequence[str], cloud: tuple[Mat, Vec], friction: float) -> Foot:
        """A sole in the most level frame that shows one, or in a new level one; or else the ball that it stands on."""
        points, radii = cloud
        middle = points[(points[:, 2] - radii).argmin()]
        frames = {link: self._state.frame(link) for link in links}
        leaning = {link: 1.0 - frame.rotation[2, 2] for link, frame in frames.items()}
        named = {link: ["sole" in link.lower(), "foot" in link.lower(), True].index(True) for link in links}
        for link in sorted(links, key=lambda link: (round(leaning[link], 3), named[link])):
            if leaning[link] < _LEANING:
                frame = frames[link]
                found = _sole(link, (points - frame.position) @ frame.rotation, radii, friction)
                if found is not None:
                    return found
        found = _sole("", (points - middle) @ self._heading(), radii, friction)
        if found is not None:
            x, y, _ = found.origin
            name = self._new(links[0], self._heading(), middle + self._heading() @ [x, y, 0.0])
            balls = tuple((a - x, b - y, c) for a, b, c in found.balls)
            return replace(found, frame=name, origin=(0.0, 0.0, found.origin[2]), balls=balls)
        return self._point(links, points, radii, friction)

    def _point(self, links: Sequence[str], points: Mat, radii: Vec, friction: float) -> Foot:
        i = int((points[:, 2] - radii).argmin())
        centre, radius = points[i], float(radii[i])
        if not radius:
            centre, radius = _ball(points[points[:, 2] < centre[2] + _CAP], centre)
        for link in links:
            step = self._state.frame(link).position - centre
            if np.linalg.norm(step) <= _ROUND + 0.1 * radius:
                return Foot(link, "point", friction, radius=radius)
            if not radius and np.hypot(*step[:2]) < _CAP and 0.0 <= step[2] < 3.0 * _CAP:
                return Foot(link, "point", friction, radius=float(step[2]))
        return Foot(self._new(links[0], self._heading(), centre), "point", friction, radius=radius)

    def _heading(self) -> Mat:
        """Level axes, x where the base looks."""
        x, y = self._state.frame(self._robot.urdf.root).rotation[:2, 0]
        c, s = np.array([x, y]) / (np.hypot(x, y) or 1.0) if np.hypot(x, y) else (1.0, 0.0)
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    def _new(self, link: str, R: Mat, position: Vec) -> str:
        name, carrier = unused(f"{link}_foot", self._joint_of), self._state.frame(link)
        at = Origin.of(carrier.rotation.T @ (position - carrier.position), carrier.rotation.T @ R)
        self.added.append(Joint(unused(f"{name}_mount", self._joint_of), "fixed", link, name, at))
        return name


def _sole(frame: str, points: Mat, radii: Vec, friction: float) -> Foot | None:
    """The rectangle that touches a plane below balls, in the axes of ``frame``; None where that is a line or less."""
    ground = float((points[:, 2] - radii).min())
    touching = points[:, 2] - radii <= ground + _LAYER
    centres, sizes = points[touching], radii[touching]
    (x, y), half_size = largest_rectangle(centres[:, :2])
    if min(half_size) < _LEAST_SOLE:
        return None
    same = bool(sizes.min() == sizes.max() > 0.0)
    return Foot(
        frame, "sole", friction, origin=(x, y, ground), half_size=half_size,
        radius=float(sizes[0]) if same else 0.0, balls=tuple(map(triple, centres)) if same else (),
    )  # fmt: skip


def _corners(geometry: Geometry) -> tuple[Mat, float]:
    """Points (n, 3) about the shape's own origin, and the radius of a ball about each."""
    match geometry.shape:
        case Sphere(radius):
            return np.zeros((1, 3)), radius
        case Box(size):
            return 0.5 * np.array(size) * _SIGNS, 0.0
        case Cylinder(radius, length):
            rim = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
            circle = np.column_stack([radius * np.cos(rim), radius * np.sin(rim)])
            return np.vstack([np.column_stack([circle, np.full(48, z)]) for z in (-length / 2, length / 2)]), 0.0
        case Mesh() as mesh:
            from wbc.models.coal_ import mesh_points

            try:
                return mesh_points(mesh), 0.0
            except ModelError:  # who needs the mesh says so
                return np.zeros((0, 3)), 0.0


_SIGNS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)


def largest_rectangle(points: Mat) -> tuple[tuple[float, float], tuple[float, float]]:
    """The largest rectangle along x and y inside the hull of points (n, 2): its centre and half its sides.

    Above an interval of x the hull has room between the greater of its lower ends and the lesser of its upper ends.
    """
    low, high = _chain(points), _chain(points * [1.0, -1.0]) * [1.0, -1.0]
    x = np.unique(np.r_[low[:, 0], high[:, 0], np.linspace(low[0, 0], low[-1, 0], 50)])
    floor, roof = np.interp(x, *low.T), np.interp(x, *high.T)
    bottom, top = np.maximum.outer(floor, floor), np.minimum.outer(roof, roof)
    wide, deep = np.maximum(np.subtract.outer(x, x), 0.0), np.maximum(top - bottom, 0.0)
    i, j = np.unravel_index((wide * deep).argmax(), wide.shape)
    sides = (wide[i, j], deep[i, j])
    centre = ((x[i] + x[j]) / 2, (top[i, j] + bottom[i, j]) / 2)
    return (float(centre[0]), float(centre[1])), (float(sides[0]) / 2, float(sides[1]) / 2)


def _chain(points: Mat) -> Mat:
    """The lower side of the hull of points (n, 2), from the least x to the greatest."""
    lowest: dict[float, float] = {}
    for x, y in sorted(map(tuple, points.round(_DIGITS).tolist())):
        lowest.setdefault(x, y)
    chain: list[tuple[float, float]] = []
    for corner in lowest.items():
        while len(chain) > 1 and _turn(chain[-2], chain[-1], corner) <= 0.0:
            chain.pop()
        chain.append(corner)
    return np.array(chain)


def _turn(a: Any, b: Any, c: Any) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def _ball(points: Mat, lowest: Vec) -> tuple[Vec, float]:
    """The ball through points (n, 3), 2 p·c + (r² − |c|²) = |p|² by least squares; no ball: the lowest point itself."""
    relative = points - lowest
    A = np.column_stack([2.0 * relative, np.ones(len(points))])
    solution, _, rank, _ = np.linalg.lstsq(A, (relative**2).sum(axis=1), rcond=None)
    centre, radius = solution[:3], float(np.sqrt(max(0.0, solution[3] + solution[:3] @ solution[:3])))
    gaps = np.linalg.norm(relative - centre, axis=1) - radius
    if rank < 4 or not 0.0 < radius <= _LARGEST_BALL or np.abs(gaps).max() > _ROUND:
        return lowest, 0.0
    return centre + lowest, radius
