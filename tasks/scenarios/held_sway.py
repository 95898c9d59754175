"""What a standing robot can hold when joints have no torque, and a sway of the centre of mass that stays there."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, final

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.optimize import linprog

import wbc
from wbc.models.model import RobotModel
from wbc.models.pinocchio_ import PinocchioModel
from wbc.stack.contact import Contact
from wbc.types import Vec

from .. import CenterOfMass, Orientation, Posture, Release, Retarget, When
from ..components.diagnosis import Diagnosis
from ..components.fault_reaction import TABLE
from .fault_trials import Stand
from .least_torque import contact_jacobian
from .standing import Stance, held_by_damping, joint_constraints

#: Positions per axis that the sway's box is sampled at; boxes of a half of it and single positions are on the grid.
SAMPLES = 5
#: Shares of the sway that are tried, and how many positions to each side of the centre that is on the grid.
SHARES: Sequence[tuple[float, int]] = ((1.0, 2), (0.5, 1), (0.0, 0))
#: Step [s], most steps and slowest speed [rad/s, m/s] of the search for a posture; error that is no posture [m].
STEP, STEPS, STILL, UNREACHED = 0.05, 60, 1e-3, 3e-3
#: Acceleration left for what is not planned [m/s²]: what the usual gain of 400 asks for with the centre of mass half a
#: millimetre off; and with noise and wrong masses, 5 mm at a gain of 100.
LEAST, LEAST_ROUGH = 0.2, 0.5
#: Times that the change from one sway to the other may take [s], and how often what is left is looked at on the way.
CHANGES, LOOKS = (0.4, 0.6, 0.8, 1.0, 1.3, 1.7, 2.2), 25
#: Left where the robot cannot stand [m/s²].
NOTHING = -10.0


def reserve(robot: RobotModel, contacts: Sequence[Contact], q: Vec, without: Sequence[str] = ()) -> float:
    """How fast the robot can accelerate its centre of mass from rest at q (nq,), whatever the level direction [m/s²].

    The largest s for which each of c̈ = ±s x, ±s y has contact forces f within their cones and torques within their
    limits, zero at the joints ``without``, with g + m J_comᵀ c̈ = Sᵀ τ + Jᵀ f: four linear programs. Times the height
    of the centre of mass and divided by gravity, it is how far the centre of pressure may still go. Negative: the robot
    cannot stand still here; −inf: no level acceleration helps.

    Example:
        >>> import wbc
        >>> from wbc.tasks import feet
        >>> from wbc.tasks.scenarios.held_sway import reserve
        >>> robot = wbc.load("humanoid", base="floating")
        >>> sound, lame = reserve(robot, feet(robot), robot.q0), reserve(robot, feet(robot), robot.q0, ["left_knee"])
        >>> sound > lame > 0.0
        True
    """
    state, nb = robot.state(), robot.nb
    state.update(0.0, q, np.zeros(robot.nv))
    J = np.vstack([contact_jacobian(contact, state) for contact in contacts])
    cones = [contact.cone() for contact in contacts]
    K = np.zeros((sum(len(cone) for cone in cones), len(J)))
    row = column = 0
    for cone in cones:
        K[row : row + len(cone), column : column + cone.shape[1]] = cone
        row, column = row + len(cone), column + cone.shape[1]
    dead = np.isin(np.arange(robot.nj), [robot.joint(joint) for joint in without])
    most = robot.limits.tau_max[~dead]
    # Unknown: (f, s). Torques are τ = g + s h − Jᵀ f, with h the generalised force of a unit acceleration.
    left = np.concatenate([np.arange(nb), nb + np.flatnonzero(dead)])
    driven = nb + np.flatnonzero(~dead)
    best = []
    for direction in ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0)):
        h = robot.mass * (state.com_jacobian.T @ np.array(direction))
        torque = np.column_stack([-J.T[driven], h[driven]])
        found = linprog(
            np.append(np.zeros(len(J)), -1.0),
            A_ub=np.vstack([np.column_stack([K, np.zeros(len(K))]), torque, -torque]),
            b_ub=np.concatenate([np.zeros(len(K)), most - state.g[driven], most + state.g[driven]]),
            A_eq=np.column_stack([J.T[left], -h[left]]), b_eq=state.g[left],
            bounds=[(None, None)] * (len(J) + 1), method="highs",
        )  # fmt: skip
        best.append(float(found.x[-1]) if found.status == 0 else -np.inf)
    return min(best)


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
    """What statics leaves in the box of the usual sway, ``left`` (n, n, n) [m/s²], and the sways within it.

    ``box`` (3,) [m]: where it ends on both sides of its centre; ``fall`` [1/s²]: gravity over the height of the centre
    of mass, what a metre outside the box costs; ``sways``: all that were tried.
    """

    left: Vec
    box: Vec
    fall: float
    sways: Sequence[Held]

    def at(self, offsets: Vec) -> Vec:
        """What is left (m,) [m/s²] at ``offsets`` (m, 3) [m] from the usual centre, linear between positions."""
        half = (np.array(self.left.shape) - 1) / 2
        places = half[:, None] * (1.0 + (offsets / np.where(self.box > 0.0, self.box, 1.0)).T)
        outside = np.linalg.norm(np.maximum(np.abs(offsets) - self.box, 0.0), axis=1)
        found = map_coordinates(np.maximum(self.left, NOTHING), places, order=1, mode="nearest")
        return np.asarray(found - self.fall * outside)

    def largest(self, least: float, reserves: Sequence[float] | Vec) -> int | None:
        """The sway that is held: of those with the largest share, the one with most in reserve, if that is at least
        ``least``; else the one with most of all. None: none can be held."""
        for share in sorted({sway.share for sway in self.sways}, reverse=True):
            same = [i for i, sway in enumerate(self.sways) if sway.share == share]
            best = max(same, key=lambda i: reserves[i])
            if reserves[best] >= least:
                return best
        best = max(range(len(self.sways)), key=lambda i: reserves[i])
        return best if np.isfinite(reserves[best]) else None


@final
class HeldSway:
    """The largest share of a stance's sway that the robot can hold when joints have lost their torque.

    The box of the usual sway is sampled. At each position the posture is found by inverse kinematics, and
    :func:`reserve` says what is left there without the dead joints. A sway is the whole usual one, half of it about a
    position of the grid, or rest at one; its reserve is the least that is left in its box, less what it accelerates
    itself. At a diagnosis the way to each sway counts too: the least that is left along it, less the level
    acceleration, over the times that it may take. The largest share with a reserve of ``least`` is taken; where there
    is none, the sway with the largest reserve. The rule is the same for all joints and both sides.

    As ``Retarget("CenterOfMass", HeldSway(...), made=True)`` it answers a diagnosis. A controller that must be in time
    calls ``region`` for the joints that matter before it starts: what was found is kept.

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
        best = region.largest(self.least, [sway.reserve for sway in region.sways])
        return None if best is None else region.sways[best]

    def region(self, without: Sequence[str]) -> Region:
        """What is left without these joints."""
        joints = tuple(sorted(without))
        if joints not in self._known:
            self._known[joints] = self._sampled(joints)
        return self._known[joints]

    def _sampled(self, joints: tuple[str, ...]) -> Region:
        if self._postures is None:
            self._postures = postures(self.robot, self.stance)
        left = np.full((SAMPLES,) * 3, -np.inf)
        for place, q in self._postures.items():
            left[place] = reserve(self.robot, self._contacts, q, joints)
        box, half = np.array(self.stance.sway), SAMPLES // 2
        own = float(np.linalg.norm(box * (2.0 * np.pi * np.array(self.stance.frequency)) ** 2))
        sways = []
        for share, reach in SHARES:
            for centre in product(range(reach, SAMPLES - reach), repeat=3):
                least = float(left[tuple(slice(c - reach, c + reach + 1) for c in centre)].min())
                sways.append(Held(box * (np.array(centre) - half) / half, share, least - share * own))
        height = float(self.robot.state().com[2]) - min(self._heights())
        return Region(left, box, float(np.linalg.norm(self.robot.gravity)) / height, sways)

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
    centre, offsets = usual(0.0)[0], np.array([sway.offset for sway in region.sways])
    shares, own = np.array([[sway.share] for sway in region.sways]), np.array([s.reserve for s in region.sways])

    def sways(t: float) -> tuple[Vec, Vec, Vec]:
        position, rate, acceleration = usual(t)
        return offsets + shares * (position - centre), shares * rate, shares * acceleration

    now, then = until_now(start), sways(start)
    begin, rate, bent = (x - y for x, y in zip((now[0] - centre, now[1], now[2]), then, strict=True))
    still = np.zeros(offsets.size)
    times = start + np.linspace(0.0, max(CHANGES), LOOKS)
    on_time = [sways(float(t)) for t in times]
    ways = np.empty((len(CHANGES), len(own)))
    for k, duration in enumerate(CHANGES):
        blend = to_rest(begin.ravel(), rate.ravel(), bent.ravel(), still, start=start, duration=duration)
        left = np.full(len(own), np.inf)
        for t, (position, _, acceleration) in zip(times, on_time, strict=True):
            more, _, faster = blend(float(t))
            level = (acceleration + faster.reshape(-1, 3))[:, :2]
            left = np.minimum(left, region.at(position + more.reshape(-1, 3)) - np.linalg.norm(level, axis=1))
        ways[k] = left
    best = region.largest(least, np.minimum(own, ways.max(axis=0)))
    if best is None or (region.sways[best].whole and usual is until_now):
        return None
    return ChangedSway(usual, until_now, region.sways[best], start, CHANGES[int(ways[:, best].argmax())])


@final
class ChangedSway:
    """``held`` instead of the sway ``usual``: from ``start`` on the target goes over to it in ``duration`` [s]."""

    def __init__(self, usual: Any, until_now: Any, held: Held, start: float, duration: float) -> None:
        self.usual, self.held, self.start, self.duration = usual, held, start, duration
        self._centre = usual(0.0)[0]
        position, rate, acceleration = (
            np.asarray(old) - new for old, new in zip(until_now(start), self._sway(start), strict=True)
        )
        self._blend = to_rest(position, rate, acceleration, np.zeros(3), start=start, duration=duration)

    def _sway(self, t: float) -> tuple[Vec, Vec, Vec]:
        position, rate, acceleration = self.usual(t)
        centre, share = self._centre, self.held.share
        return centre + self.held.offset + share * (position - centre), share * rate, share * acceleration

    def __call__(self, t: float) -> tuple[Vec, Vec, Vec]:
        now = self._sway(t)
        if t >= self.start + self.duration:
            return now
        position, rate, acceleration = (a + b for a, b in zip(now, self._blend(t), strict=True))
        return position, rate, acceleration


def postures(robot: PinocchioModel, stance: Stance) -> dict[tuple[int, int, int], Vec]:
    """Configurations (nq,) with the centre of mass at the positions of the sway's box, ``SAMPLES`` along each axis.

    Feet planted, the frame upright, joints near the reference and within their limits. Positions that the robot does
    not reach are left out.
    """
    state = robot.state()
    start, still = np.array(state.com), np.zeros(robot.nv)
    com = CenterOfMass(target=start, kp=400)
    upright = Orientation(stance.upright, target=np.array(state.frame(stance.upright).rotation), kp=100)
    stack = wbc.Stack(
        [com, upright, Posture(robot.q0, kp=100, weight=1e-4)],
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


def to_rest(
    position: Vec, rate: Vec, acceleration: Vec, goal: Vec, *, start: float, duration: float
) -> Callable[[float], tuple[Vec, Vec, Vec]]:
    """The polynomial of degree five from a moving start at time ``start`` to rest at ``goal``, ``duration`` later."""
    T = duration
    begins = np.array([position, T * rate, 0.5 * T**2 * acceleration])
    missing = np.array([goal - begins.sum(axis=0), -begins[1] - 2.0 * begins[2], -2.0 * begins[2]])
    ends = np.linalg.solve([[1.0, 1.0, 1.0], [3.0, 4.0, 5.0], [6.0, 12.0, 20.0]], missing)
    coefficients, k = np.vstack([begins, ends]), np.arange(6)

    def path(t: float) -> tuple[Vec, Vec, Vec]:
        s = (t - start) / T
        if s >= 1.0:
            return goal, np.zeros_like(goal), np.zeros_like(goal)
        powers = s**k
        first = np.concatenate([[0.0], k[1:] * powers[:-1]]) / T
        second = np.concatenate([[0.0, 0.0], k[2:] * k[1:-1] * powers[:-2]]) / T**2
        return powers @ coefficients, first @ coefficients, second @ coefficients

    return path
