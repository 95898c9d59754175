"""What a standing robot can hold when joints have no torque, and a sway of the centre of mass that stays there."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from typing import Any, final

import numpy as np
from scipy.linalg import block_diag
from scipy.ndimage import map_coordinates
from scipy.optimize import linprog

import wbc
from wbc.models.model import RobotModel
from wbc.models.pinocchio_ import PinocchioModel
from wbc.stack.contact import Contact
from wbc.types import Mat, Vec

from .. import CenterOfMass, Posture, Release, Retarget, When
from ..components.diagnosis import Diagnosis
from ..components.fault_reaction import TABLE
from .fault_trials import Stand
from .standing import Stance, held_by_damping, joint_constraints, upright

#: Positions per axis that the sway's box is sampled at; boxes of a half of it and single positions are on the grid.
SAMPLES = 5
#: Shares of the sway that are tried, and how many positions to each side of the centre that is on the grid.
SHARES: Sequence[tuple[float, int]] = ((1.0, 2), (0.5, 1), (0.0, 0))
#: Step [s], most steps and slowest speed [rad/s, m/s] of the search for a posture; error that is no posture [m].
STEP, STEPS, STILL, UNREACHED = 0.05, 60, 1e-3, 3e-3
#: Acceleration left for what is not planned [m/s²]: what the usual gain of 400 asks for with the centre of mass half a
#: millimetre off; and with noise and wrong masses, 5 mm at a gain of 100.
LEAST, LEAST_ROUGH = 0.2, 0.5
#: Times that the level and the vertical part of a change from one sway to the other may take [s], and how often what is
#: left is looked at on the way, more often at its start.
LEVEL_CHANGES, VERTICAL_CHANGES, LOOKS = (0.3, 0.4, 0.6, 0.9, 1.3, 2.0), (0.3, 0.6, 1.2), 25
#: All pairs of them, one for each axis.
CHANGES = np.array([(level, level, vertical) for level, vertical in product(LEVEL_CHANGES, VERTICAL_CHANGES)])
#: Left where the robot cannot stand, and what is divided by at least [m/s²].
NOTHING, SLIGHT = -10.0, 1e-6
#: Directions (8, 3) that level accelerations are tried in.
LEVEL = np.array([(np.cos(a), np.sin(a), 0.0) for a in 0.25 * np.pi * np.arange(8)])
UP = np.array([0.0, 0.0, 1.0])


def reach(robot: RobotModel, contacts: Sequence[Contact], q: Vec, directions: Mat, without: Sequence[str] = ()) -> Vec:
    """How fast the robot can accelerate its centre of mass from rest at q (nq,) in each of ``directions`` (m, 3), (m,).

    For each direction d the largest s [m/s²] for which c̈ = s d has contact forces f within their cones and torques
    within their limits, zero at the joints ``without``, with g + m J_comᵀ c̈ = Sᵀ τ + Jᵀ f: a linear program. −inf: no
    acceleration along d helps.

    Example:
        >>> import wbc
        >>> from wbc.tasks import feet
        >>> from wbc.tasks.scenarios.held_sway import UP, reach
        >>> robot = wbc.load("humanoid", base="floating")
        >>> down = reach(robot, feet(robot), robot.q0, [-UP])
        >>> print(down.round(6))  # in free fall no foot and no motor has to push
        [9.81]
    """
    state, nb = robot.state(), robot.nb
    state.update(0.0, q, np.zeros(robot.nv))
    J = np.vstack([contact.rows(state).J for contact in contacts])
    K = block_diag(*(contact.cone() for contact in contacts))
    dead = np.isin(np.arange(robot.nj), [robot.joint(joint) for joint in without])
    most = robot.limits.tau_max[~dead]
    # Unknown: (f, s). Torques are τ = g + s h − Jᵀ f, with h the generalised force of a unit acceleration.
    left = np.concatenate([np.arange(nb), nb + np.flatnonzero(dead)])
    driven = nb + np.flatnonzero(~dead)
    found = np.empty(len(directions))
    for i, direction in enumerate(directions):
        h = robot.mass * (state.com_jacobian.T @ direction)
        torque = np.column_stack([-J.T[driven], h[driven]])
        program = linprog(
            np.append(np.zeros(len(J)), -1.0),
            A_ub=np.vstack([np.column_stack([K, np.zeros(len(K))]), torque, -torque]),
            b_ub=np.concatenate([np.zeros(len(K)), most - state.g[driven], most + state.g[driven]]),
            A_eq=np.column_stack([J.T[left], -h[left]]), b_eq=state.g[left],
            bounds=[(None, None)] * (len(J) + 1), method="highs",
        )  # fmt: skip
        found[i] = float(program.x[-1]) if program.status == 0 else -np.inf
    return found


def reserve(robot: RobotModel, contacts: Sequence[Contact], q: Vec, without: Sequence[str] = ()) -> float:
    """The least of :func:`reach` over eight level directions [m/s²].

    Times the height of the centre of mass and divided by gravity, it is how far the centre of pressure may still go.
    Negative: the robot cannot stand still here; −inf: no level acceleration helps.

    Example:
        >>> import wbc
        >>> from wbc.tasks import feet
        >>> from wbc.tasks.scenarios.held_sway import reserve
        >>> robot = wbc.load("humanoid", base="floating")
        >>> sound, lame = reserve(robot, feet(robot), robot.q0), reserve(robot, feet(robot), robot.q0, ["left_knee"])
        >>> sound > lame > 0.0
        True
    """
    return float(reach(robot, contacts, q, LEVEL, without).min())


@final
@dataclass(frozen=True)
class Held:
    """A sway that can be held: ``share`` of the usual one, about ``offset`` (3,) [m] from its centre. ``reserve``
    [m/s²]: the least that is left along it."""

    offset: Vec
    share: float
    reserve: float

    @property
    def whole(self) -> bool:
        """Whether it is the usual sway."""
        return self.share == 1.0


@final
@dataclass(frozen=True, eq=False)
class Region:
    """What statics leaves in the box of the usual sway, and the sways within it.

    ``reached`` (9, n, n, n) [m/s²]: :func:`reach` in the eight directions of ``LEVEL`` and upwards, at each position;
    ``box`` (3,) [m]: where it ends on both sides of its centre; ``gravity`` [m/s²]; ``fall`` [1/s²], which is gravity
    over the height of the centre of mass: what a metre outside the box costs; ``sways``: all that were tried.
    """

    reached: Vec
    box: Vec
    gravity: float
    fall: float
    sways: Sequence[Held]

    def left(self, offsets: Vec, accelerations: Vec) -> Vec:
        """What is left (m, ...) [m/s²] at ``offsets`` (m, ..., 3) [m] from the usual centre beside ``accelerations``.

        What the robot can do at a position is a convex set: free fall, the reach s_d in each of the nine directions d,
        and all between them are in it. At the vertical acceleration a_z these are the level accelerations in the
        polygon with corners s_d d, made smaller by the factor 1 + a_z/g for a_z < 0 and 1 − a_z/s_up for a_z > 0. What
        is left is the distance of the level acceleration to the nearest side. Where the robot cannot stand still, or
        a_z is out of reach, it is the least s_d, made smaller likewise, less the level acceleration. Between positions
        s_d is linear.
        """
        half = (np.array(self.reached.shape[1:]) - 1) / 2
        places = np.moveaxis(half * (1.0 + offsets / np.where(self.box > 0.0, self.box, 1.0)), -1, 0)
        outside = self.fall * np.linalg.norm(np.maximum(np.abs(offsets) - self.box, 0.0), axis=-1)
        floors = [NOTHING] * len(LEVEL) + [0.0]
        *level, up = (
            map_coordinates(np.maximum(grid, floor), places, order=1, mode="nearest")
            for grid, floor in zip(self.reached, floors, strict=True)
        )
        reached, vertical = np.array(level) - outside, accelerations[..., 2]
        share = 1.0 - np.where(vertical < 0.0, -vertical / self.gravity, vertical / np.maximum(up, SLIGHT))
        least = reached.min(axis=0)
        inside = (least > 0.0) & (share > 0.0)
        size = np.where(inside, share * reached, 1.0)
        corners = [s[..., None] * d[:2] - accelerations[..., :2] for s, d in zip(size, LEVEL, strict=True)]
        sides = [_distance(one, other) for one, other in pairwise([*corners, corners[0]])]
        lost = np.where(least > 0.0, share, 1.0) * least - np.linalg.norm(accelerations[..., :2], axis=-1)
        left: Vec = np.where(inside, np.min(sides, axis=0), lost)
        return left

    def largest(self, least: float, reserves: Callable[[Sequence[Held]], Vec]) -> Held | None:
        """The sway that is held: of those with the largest share, the one with most in reserve, if that is at least
        ``least``; else the one with most of all. None: none can be held."""
        best: tuple[float, Held | None] = (-np.inf, None)
        for share in sorted({sway.share for sway in self.sways}, reverse=True):
            same = [sway for sway in self.sways if sway.share == share]
            found = reserves(same)
            first = int(found.argmax())
            if found[first] > best[0]:
                best = float(found[first]), same[first]
            if best[0] >= least:
                break
        return best[1]


def _distance(one: Vec, other: Vec) -> Vec:
    """Distance (...) of the origin from the lines through ``one`` and ``other`` (..., 2); positive on their left."""
    along = other - one
    distance: Vec = (one[..., 0] * along[..., 1] - one[..., 1] * along[..., 0]) / np.linalg.norm(along, axis=-1)
    return distance


@final
class HeldSway:
    """The largest share of a stance's sway that the robot can hold when joints have lost their torque.

    The box of the usual sway is sampled. At each position the posture is found by inverse kinematics, and
    :func:`reach` says what can be done there without the dead joints. A sway is the whole usual one, half of it about a
    position of the grid, or rest at one; its reserve is the least :func:`reserve` in its box, less what it accelerates
    itself. At a diagnosis the way to each sway counts too: the least that :meth:`Region.left` leaves along it, with the
    best of the times that its level and its vertical part may take. The largest share with a reserve of ``least`` is
    taken; where there is none, the sway with the largest reserve. The rule is the same for all joints and both sides.

    As ``Retarget("CenterOfMass", HeldSway(...), made=True)`` it answers a diagnosis. Sampling the box takes seconds:
    ``region``, called before the controller starts, keeps what it found. The choice of the sway takes a tenth of a
    second, which is more than a tick.

    Args:
        robot: as the controller has it.
        stance: its usual sway.
        least: acceleration that must be left for what is not planned [m/s²].
    """

    def __init__(self, robot: PinocchioModel, stance: Stance, *, least: float) -> None:
        self.robot, self.stance, self.least = robot, stance, least
        self._contacts = held_by_damping(robot)
        self._postures: Mapping[tuple[int, int, int], Vec] | None = None
        self._known: dict[tuple[str, ...], Region] = {}

    @classmethod
    def of(cls, stand: Stand) -> HeldSway:
        """For this robot as its controller has it."""
        return cls(stand.believed(), stand.stance, least=LEAST_ROUGH if stand.rough else LEAST)

    def held(self, without: Sequence[str]) -> Held | None:
        """The sway without these joints, wherever it starts from; None where the robot can stand nowhere in the box."""
        region = self.region(without)
        return region.largest(self.least, lambda sways: np.array([sway.reserve for sway in sways]))

    def region(self, without: Sequence[str]) -> Region:
        """What is left without these joints."""
        joints = tuple(sorted(without))
        if joints not in self._known:
            self._known[joints] = self._sampled(joints)
        return self._known[joints]

    def _sampled(self, joints: tuple[str, ...]) -> Region:
        if self._postures is None:
            self._postures = postures(self.robot, self.stance)
        reached = np.full((len(LEVEL) + 1, *(SAMPLES,) * 3), -np.inf)
        for place, q in self._postures.items():
            reached[(slice(None), *place)] = reach(self.robot, self._contacts, q, np.vstack([LEVEL, UP]), joints)
        left, box, half = reached[:-1].min(axis=0), np.array(self.stance.sway), SAMPLES // 2
        own = float(np.linalg.norm(box * (2.0 * np.pi * np.array(self.stance.frequency)) ** 2))
        sways = []
        for share, size in SHARES:
            for centre in product(range(size, SAMPLES - size), repeat=3):
                least = float(left[tuple(slice(c - size, c + size + 1) for c in centre)].min())
                sways.append(Held(box * (np.array(centre) - half) / half, share, least - share * own))
        height = float(self.robot.state().com[2]) - min(self._heights())
        gravity = float(np.linalg.norm(self.robot.gravity))
        return Region(reached, box, gravity, gravity / height, sways)

    def _heights(self) -> list[float]:
        state = self.robot.state()
        return [float(state.frame(contact.frame).position[2]) for contact in self._contacts]

    def __call__(self, diagnosis: Diagnosis, state: Any, plan: Any) -> Callable[[float], tuple[Vec, Vec, Vec]] | None:
        """The target of the centre of mass from now on; None: as it is."""
        lost = {int(i) for i in np.flatnonzero(plan.actuators.share == 0.0)} | {diagnosis.joint}
        dead = [self.robot.joint_names[i] for i in sorted(lost)]
        target = next(task for task in plan.stack.tasks if task.name == "CenterOfMass").target
        usual = target.usual if isinstance(target, ChangedSway) else target
        return changed(self.region(dead), usual, target, float(state.t), least=self.least)


def table_with(sway: HeldSway) -> Sequence[When]:
    """The table for robots that stand: a dead joint is released, and the sway becomes one that can still be held."""
    return [When("total", [Release(), Retarget("CenterOfMass", sway, made=True)]), *TABLE[1:]]


def changed(region: Region, usual: Any, until_now: Any, start: float, *, least: float) -> ChangedSway | None:
    """The sway to go over to at time ``start`` [s] from the target ``until_now``, and how fast; None: as it is.

    Both are chosen together: a sway's reserve is the least of its own and of what is left on the way.
    """

    def reserves(sways: Sequence[Held]) -> Vec:
        own = np.array([sway.reserve for sway in sways])
        least_of_both: Vec = np.minimum(own, ways(region, usual, until_now, start, sways).max(axis=0))
        return least_of_both

    held = region.largest(least, reserves)
    if held is None or (held.whole and usual is until_now):
        return None
    way = int(ways(region, usual, until_now, start, [held])[:, 0].argmax())
    return ChangedSway(usual, until_now, held, start, CHANGES[way])


def ways(region: Region, usual: Any, until_now: Any, start: float, sways: Sequence[Held]) -> Mat:
    """What is left along the way from ``until_now`` to each of ``sways`` in each time of ``CHANGES`` [m/s²] (18, m)."""
    centre = usual(0.0)[0]
    elapsed = float(CHANGES.max()) * np.linspace(0.0, 1.0, LOOKS) ** 2
    offsets, shares = np.array([sway.offset for sway in sways]), np.array([[sway.share] for sway in sways])
    now, then = until_now(start), usual(start)
    position, rate = now[0] - centre - offsets - shares * (then[0] - centre), now[1] - shares * then[1]
    moved = np.array([usual(float(t)) for t in start + elapsed])[:, :, None]
    left = np.empty((len(CHANGES), len(sways)))
    for k, duration in enumerate(CHANGES):
        more, _, faster = fading(position, rate, duration, elapsed[:, None, None])
        places = offsets + shares * (moved[:, 0] - centre) + more
        left[k] = region.left(places, shares * moved[:, 2] + faster).min(axis=0)
    return left


@final
class ChangedSway:
    """``held`` instead of the sway ``usual``: from ``start`` on the target goes over to it in ``duration`` (3,) [s],
    for each axis its own."""

    def __init__(self, usual: Any, until_now: Any, held: Held, start: float, duration: Vec) -> None:
        self.usual, self.held, self.start, self.duration = usual, held, start, duration
        self._centre = usual(0.0)[0]
        now, then = until_now(start), self._sway(start)
        self._begin = np.asarray(now[0]) - then[0], np.asarray(now[1]) - then[1]

    def _sway(self, t: float) -> tuple[Vec, Vec, Vec]:
        position, rate, acceleration = self.usual(t)
        centre, share = self._centre, self.held.share
        return centre + self.held.offset + share * (position - centre), share * rate, share * acceleration

    def __call__(self, t: float) -> tuple[Vec, Vec, Vec]:
        more = fading(*self._begin, self.duration, t - self.start)
        position, rate, acceleration = (a + b for a, b in zip(self._sway(t), more, strict=True))
        return position, rate, acceleration


def postures(robot: PinocchioModel, stance: Stance) -> dict[tuple[int, int, int], Vec]:
    """Configurations (nq,) with the centre of mass at the positions of the sway's box, ``SAMPLES`` along each axis.

    Feet planted, the frame upright, joints near the reference and within their limits. Positions that the robot does
    not reach are left out.
    """
    state = robot.state()
    start, still = np.array(state.com), np.zeros(robot.nv)
    com = CenterOfMass(target=start, kp=400)
    stack = wbc.Stack(
        [com, upright(state, stance), Posture(robot.q0, kp=100, weight=1e-4)],
        contacts=held_by_damping(robot), subject_to=joint_constraints(robot)[1:],
    )  # fmt: skip
    controller = wbc.Controller(robot, stack, level=wbc.VelocityLevel(), dt=STEP)
    found: dict[tuple[int, int, int], Vec] = {}
    half, axis = SAMPLES // 2, range(SAMPLES)
    for place in product(axis, axis, axis):
        com.target = start + np.array(stance.sway) * (np.array(place) - half) / half
        q, v = robot.q0.copy(), still
        controller.reset()
        for k in range(STEPS):
            v = controller.tick(k * STEP, q, v).v
            q = robot.integrate(q, STEP * v)
            if np.abs(v).max() < STILL:
                break
        state.update(0.0, q, still)
        if float(np.linalg.norm(state.com - com.target)) < UNREACHED:
            found[place] = q
    return found


def fading(position: Vec, rate: Vec, duration: Vec, elapsed: Any) -> tuple[Vec, Vec, Vec]:
    """A difference that starts as ``position`` with ``rate`` and is over after ``duration``: itself, its rate, and its
    acceleration, after ``elapsed`` [s].

    x(t) = (1 − s)³ (p + (3 p + T v) s) with s = t / T: the polynomial of degree four that comes to rest at 0. Its
    acceleration starts with no regard to the one before: the forces of a robot may change in a tick, and where little
    is left of them, there is none to spare for an acceleration that no longer helps.

    Example:
        >>> import numpy as np
        >>> from wbc.tasks.scenarios.held_sway import fading
        >>> place, rate, _ = fading(np.ones(1), np.full(1, 0.5), np.ones(1), np.array([[0.0], [0.5]]))
        >>> place.ravel(), rate.ravel()
        (array([1.     , 0.34375]), array([ 0.5  , -1.625]))
    """
    s = np.minimum(elapsed / duration, 1.0)
    rest, slope = 1.0 - s, 3.0 * position + duration * rate
    x = position + slope * s
    return (
        rest**3 * x,
        rest**2 * (rest * slope - 3.0 * x) / duration,
        6.0 * rest * (x - rest * slope) / duration**2,
    )
