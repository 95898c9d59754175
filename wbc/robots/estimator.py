"""BaseEstimator: where a floating base is and how it moves, from an IMU and the encoders of the joints.

Every sample of the sensors does this, with the filter of :mod:`wbc.robots.invariant_filter`:

1. Predict: R, v, p of the IMU by the gyroscope and the accelerometer. A ball of radius r [m] whose link turns by the
   angle θ (3,) [rad, world axes] in the sample rolls by r θ × z, with the vertical z; a flat foot does not.
2. Touching. A foot begins to touch when its normal force has been more than ``make`` for ``settle`` seconds, and ends
   at once when the force is less than ``break_``; both are shares of the robot's weight. Where no sensor in the foot
   gives the force, the joint torques do, by least squares and without accelerations: Jᵀ f = h − τ, with the Jacobian J
   (6 or 3, nj) of the foot, the bias h (nj,) and the torques τ (nj,) [N m].
3. Slip. r (3m,) [m] are the innovations of the m points of a foot, S their covariance. A foot with
   rᵀ S⁻¹ r > γ has moved: γ is what χ² with 3m degrees of freedom exceeds with probability ``gate``.
4. Correct by the points of the feet that touched and did not move. Those that just touched or moved stand where the
   encoders see them from now on.

A round foot is one point, the centre of its ball. A flat one is three points of its sole, which hold its orientation
too. Covariance of where the encoders see the points, with Jacobian J (3m, nj) of all of them in the IMU's frame, the
errors of encoders ``joint`` [rad, m] and of what is rigid ``flex`` [m]: N = joint² J Jᵀ + flex² I. A standing point
wanders by ``creep`` [m/√s] along the ground, which is what a foot does that is neither fixed nor slips, and by ``sink``
[m/√s] up and down, as soles and ground deform when weight shifts: a flat sole then holds the heading, not the lean.

Rates come with white noise, which gains on velocities make torques. What is returned is what a stationary Kalman filter
of rate and acceleration makes of them, which takes the change of accelerations for white, with densities ``agility``
[rad/s³/√Hz, m/s³/√Hz] of base and joints. Steady accelerations do not make it late, and without noise it does nothing.

``floor`` [m]: by how much the heights of footholds differ from a level plane, one standard deviation. Then a foot that
lands says where that plane is, which goes through the feet that touched first; one that is too far from it (``gate``)
says nothing. None: nothing is known of the ground.

What nothing here can see: the position along the floor, and the heading. Both drift, from where
:meth:`BaseEstimator.reset` put the feet. The vertical and the velocity do not. Without ``floor`` the height drifts too,
and of a robot that never leans otherwise the bias of the accelerometer along the floor cannot be told from a lean by
as many rad as it is shares of g.

Points as states and the gate: M. Bloesch, M. Hutter, M. A. Hoepflinger, S. Leutenegger, C. Gehring, C. D. Remy, R.
Siegwart: State estimation for legged robots: consistent fusion of leg kinematics and IMU, Robotics: Science and Systems
2012. Flat feet: N. Rotella, M. Bloesch, L. Righetti, S. Schaal: State estimation for a humanoid robot, IROS 2014. Level
ground: G. Bledt et al.: MIT Cheetah 3, IROS 2018. Gains for rates: P. R. Kalata: The tracking index, IEEE Transactions
on Aerospace and Electronic Systems 20(2), 1984.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, final

import numpy as np
import pinocchio
from scipy.special import chdtri

from wbc import checks
from wbc.arguments import TellsArguments
from wbc.compiled import Memory
from wbc.errors import InvalidInput
from wbc.models import plausible
from wbc.models.feet import Foot
from wbc.models.model import RobotModel
from wbc.models.poses import configuration
from wbc.robots.compiled.estimate_kernel import BEFORE, GAP, LAYOUT, NOW, PARTS, STEP, foresee, settle
from wbc.robots.device import rotation
from wbc.robots.invariant_filter import ImuNoise, made, start
from wbc.robots.stamps import FAR, is_wild
from wbc.types import Mat, Vec

#: How many parts of a sample are needed.
NEEDED = 4
#: A joint that is said to be faster is none [rad/s, m/s]; nor is one that far away [rad, m].
FASTEST, FARTHEST = 1e3, 1e4


@final
class BaseEstimator(metaclass=TellsArguments):
    """Estimates (q, v) of a robot with a floating base, one sample of its sensors after the other.

    Settings are arguments; what changes is what :meth:`reset` and :meth:`update` write. Without ``forces`` and
    ``joint_tau`` every contact is taken to touch: for a robot that only stands.

    Args:
        robot: from ``wbc.load``, with a floating base.
        contacts: frames of the robot, or :class:`~wbc.models.feet.Foot`; default: the robot's feet.
        imu_frame: the frame of the IMU, on the link of the base; default: the base itself.
        noise: of the IMU.
        joint, flex, creep, sink, floor, agility: as above [rad, m], [m], [m/√s], [m/√s], [m], (base, joints).
        joint_rate: error of the joint velocities in each sample [rad/s, m/s].
        make, break_, settle: when a foot touches [share of the weight], [s].
        gate: probability at which a foot that stands is taken to slip, in each sample.
        late: how late samples arrive [s]; the result is extrapolated by this time, with the last accelerations.
        tilt, speed: standard deviations of what ``reset`` is told of the lean [rad] and of v [m/s].

    Raises:
        InvalidInput: a robot without floating base or contacts, a sole without size, an IMU on another link, a number
            out of range.
        UnknownFrame: a frame that the robot does not have.

    Example:
        >>> import numpy as np, wbc
        >>> from wbc.robots import BaseEstimator
        >>> robot = wbc.load("quadruped")
        >>> estimator = BaseEstimator(robot)
        >>> estimator.reset(robot.q0, np.zeros(robot.nv))
        >>> at_rest = {"gyro_in_imu": np.zeros(3), "acceleration_in_imu": np.array([0.0, 0.0, 9.81])}
        >>> for k in range(1, 100):
        ...     q, v = estimator.update(1e-3 * k, robot.q0[7:], np.zeros(12), **at_rest)
        >>> bool(np.abs(q - robot.q0).max() < 1e-9), estimator.contacts["front_left_foot"], estimator.why
        (True, True, '')
    """

    def __init__(
        self,
        robot: RobotModel,
        contacts: Iterable[str | Foot] | None = None,
        *,
        imu_frame: str = "",
        noise: ImuNoise | None = None,
        joint: float = 3e-4,
        flex: float = 3e-4,
        creep: float = 1e-4,
        sink: float = 1e-3,
        joint_rate: float = 0.0,
        floor: float | None = None,
        agility: tuple[float, float] = (3.0, 10.0),
        make: float = 0.05,
        break_: float = 0.025,
        settle: float = 5e-3,
        gate: float = 1e-6,
        late: float = 0.0,
        tilt: float = 0.02,
        speed: float = 0.05,
    ) -> None:
        if not isinstance(robot, RobotModel) or not robot.nb:
            raise InvalidInput(f"robot is {checks.shown(robot)}; it must be a robot with a floating base")
        feet = getattr(robot, "feet", {})
        given = list(feet) if contacts is None else checks.items("contacts", contacts, "frames or feet")
        for one in given:
            checks.instance("an entry of contacts", one, str | Foot, "a frame or a Foot")  # type: ignore[arg-type]
        self._feet = [one if isinstance(one, Foot) else feet.get(one, Foot(one, "point", 1.0)) for one in given]
        names = checks.names("contacts", [foot.frame for foot in self._feet])
        noise = ImuNoise() if noise is None else noise
        self.robot, self.noise = robot, checks.instance("noise", noise, ImuNoise, "an ImuNoise")
        flex2 = checks.number("flex", flex, low=0.0, strict=True) ** 2
        base, joints = checks.pair("agility", agility, "base, joints")
        weight = robot.weight
        gate = checks.number("gate", gate, low=0.0, high=1.0)
        self._tilt2 = checks.number("tilt", tilt, low=0.0) ** 2
        self._speed2 = checks.number("speed", speed, low=0.0) ** 2
        self._state = robot.state(drifts=False)
        self._frames = [self._state.frame(name) for name in names]
        points = [_points(foot) for foot in self._feet]
        counts = [len(some) for some in points]
        gates = np.array([chdtri(3 * count, gate) for count in counts])
        up = -robot.gravity / np.linalg.norm(robot.gravity)
        upright = np.outer(up, up)
        creep, sink = checks.number("creep", creep, low=0.0), checks.number("sink", sink, low=0.0)
        wander = creep**2 * (np.eye(3) - upright) + sink**2 * upright
        self._filter = made(sum(counts), self.noise, robot.gravity, wander)
        self._memory = Memory(*self._filter)
        numbers = [
            checks.number("joint", joint, low=0.0) ** 2, flex2, self.noise.gyro,
            checks.number("joint_rate", joint_rate, low=0.0),
            checks.number("agility of the base", base, low=0.0, strict=True),
            checks.number("agility of joints", joints, low=0.0, strict=True),
            weight * checks.number("make", make, low=0.0), weight * checks.number("break_", break_, low=0.0, high=make),
            checks.number("settle", settle, low=0.0),
            -1.0 if floor is None else checks.number("floor", floor, low=0.0) ** 2, chdtri(1, gate), gates.min(),
            checks.number("late", late, low=0.0),
        ]  # fmt: skip
        lever, mount = self._imu(imu_frame)
        self._names, nj = names, robot.nj
        most = np.array(
            [FARTHEST, FASTEST, self.noise.gyro_range, self.noise.accelerometer_range, checks.LARGEST, checks.LARGEST]
        )
        self._estimate = LAYOUT.arrays(
            np.array([self._memory.address, len(names), nj, 0, sum(counts)]), numbers=np.array(numbers), most=most,
            up=up, lever=lever, mount=mount, first=np.cumsum([0, *counts]), gates=gates, offsets=np.concatenate(points),
            is_flat=np.array([foot.kind != "point" for foot in self._feet], dtype=np.int64),
            radius=np.array([foot.radius if foot.kind == "point" else 0.0 for foot in self._feet]),
        )  # fmt: skip
        self._everything = Memory(*self._estimate)
        e = self._estimate
        self._parts = (
            ("joint_q", e.joint_q), ("joint_v", e.joint_v), ("gyro_in_imu", e.gyro), ("acceleration_in_imu", e.force),
            ("joint_tau", e.tau), ("forces", e.pressures),
        )  # fmt: skip
        self._places = [
            (frame, e.position[i], e.rotation[3 * i : 3 * i + 3], e.jacobian[6 * i : 6 * i + 6])
            for i, frame in enumerate(self._frames)
        ]
        self.reset(robot.q0, np.zeros(robot.nv))

    def _imu(self, frame: str) -> tuple[Vec, Mat]:
        """Where the IMU is in the base, and the rotation from its axes to the base's."""
        if not checks.instance("imu_frame", frame, str, "the name of a frame"):
            return np.zeros(3), np.eye(3)
        state, q = self.robot.state(drifts=False), np.zeros(self.robot.nq)
        q[6], q[7:] = 1.0, self.robot.q0[7:]
        state.update(0.0, q, np.zeros(self.robot.nv))
        found = state.frame(frame)
        if np.abs(found.jacobian()[:, 6:]).any():
            raise InvalidInput(f"imu_frame {frame!r} moves with a joint; the IMU must be on the link of the base")
        return np.array(found.position), np.array(found.rotation, order="C")

    def reset(self, q: Any, v: Any) -> None:
        """Begin at q (nq,), v (nv,): its position and heading are those that all later estimates are in.

        A quaternion that looks like w x y z is warned about (:class:`~wbc.models.plausible.ImplausibleUnit`).

        Raises:
            InvalidInput: wrong shape, not finite, or a quaternion that is not of length 1 within 1e-6.
        """
        q, v = configuration(self.robot, "q", q), checks.array("v", v, (self.robot.nv,))
        plausible.upright(self.robot, "q", q)
        e, turn = self._estimate, rotation(q[3:7])
        self._state.update(0.0, q, v)
        feet = np.mean([frame.position for frame in self._frames], axis=0)
        variance = np.concatenate([self._tilt2 * (1.0 - e.up**2), np.full(3, self._speed2), np.zeros(3)])
        velocity, place = turn @ (v[:3] + np.cross(v[3:6], e.lever)), q[:3] + turn @ e.lever
        start(self._filter, turn @ e.mount, velocity, place, noise=self.noise, variance=variance, about=feet)
        e.q[:], e.v[:], e.a[:], e.since[:], e.touches[:] = q, v, 0.0, np.inf, 0
        e.out_q[:], e.out_v[:] = q, v
        e.clock[:], self._stamp = np.nan, math.nan
        self.why = ""

    # ---- what is known
    @property
    def lever(self) -> Vec:
        """Where the IMU is in the base (3,) [m]."""
        return self._estimate.lever

    @property
    def mount(self) -> Mat:
        """The rotation (3, 3) from the axes of the IMU to those of the base."""
        return self._estimate.mount

    @property
    def contacts(self) -> Mapping[str, bool]:
        """True for each foot that touches the ground, by name."""
        return MappingProxyType(dict(zip(self._names, (self._estimate.touches != 0).tolist(), strict=True)))

    @property
    def gyro_bias(self) -> Vec:
        """Estimated bias of the gyroscope (3,) [rad/s], axes of the IMU."""
        return self._filter.bias[:3].copy()

    @property
    def accelerometer_bias(self) -> Vec:
        """Estimated bias of the accelerometer (3,) [m/s²], axes of the IMU."""
        return self._filter.bias[3:].copy()

    @property
    def covariance(self) -> Mat:
        """Of the errors (9, 9) of the base, world axes: position [m], orientation [rad], velocity [m/s]."""
        e, f = self._estimate, self._filter
        lever = e.mount.T @ -e.lever
        p, arm = f.p + f.R @ lever, f.R @ pinocchio.skew(lever)
        v = f.v + np.cross(f.R @ (e.mount.T @ e.v[3:6]), f.R @ lever)
        into = np.zeros((9, 15))  # of the base: p + R l, v + R (ω × l)
        into[:3, 6:9], into[:3, :3] = np.eye(3), -pinocchio.skew(p)
        into[3:6, :3] = np.eye(3)
        into[6:, 3:6], into[6:, :3], into[6:, 9:12] = np.eye(3), -pinocchio.skew(v), arm
        return into @ f.P[:15, :15] @ into.T

    # ---- a sample
    def update(
        self,
        t: float,
        joint_q: Any,
        joint_v: Any,
        gyro_in_imu: Any,
        acceleration_in_imu: Any,
        *,
        joint_tau: Any = None,
        forces: Mapping[str, float] | None = None,
    ) -> tuple[Vec, Vec]:
        """Take up a sample and return (q (nq,), v (nv,)) as :meth:`wbc.Controller.tick` takes them.

        A sample that is not finite, out of range, of another shape or not later than the one before is left out:
        ``why`` says so, and the last (q, v) come back. It raises nothing, and returns finite numbers only. So is one
        whose time is more than 0.5 s from that of the one before, until the next goes on from it: a clock that jumps
        costs one sample, and a single wild stamp nothing else.

        Args:
            t: time of the sample [s].
            joint_q, joint_v: of the joints (nj,) [rad, m], [rad/s, m/s].
            gyro_in_imu: mean rate since the sample before (3,) [rad/s], axes of the IMU.
            acceleration_in_imu: mean specific force (3,) [m/s²], axes of the IMU: upwards g at rest.
            joint_tau: torques of the joints (nj,) [N m, N].
            forces: the normal force on each contact [N], by frame; used in place of torques.
        """
        e, address = self._estimate, self._everything.address
        try:
            e.clock[NOW] = t = checks.number("t", t)
            before, heard, self._stamp = e.clock[BEFORE], self._stamp, t
            if is_wild(t, before, heard):
                raise InvalidInput(f"t is {t:g} s, far from that of the sample before, {before:g} s")
            if -FAR <= t - before <= 0.0:
                raise InvalidInput(f"t is {t:g} s, not later than that of the sample before, {before:g} s")
            if t < before:  # a clock that has jumped back leaves a gap, as one that jumps forward does
                e.clock[BEFORE] = 2.0 * t - before
            pressures: Any = forces
            if isinstance(forces, Mapping):
                pressures = [forces.get(name, math.nan) for name in self._names]
            given = (joint_q, joint_v, gyro_in_imu, acceleration_in_imu, joint_tau, pressures)
            bad = self._hear(given) or foresee(address)
            if bad:
                name, array = self._parts[bad - 1]
                raise InvalidInput(
                    f"{name} is {checks.shown(given[bad - 1])}; it must have shape {array.shape} within "
                    f"±{e.most[bad - 1]:g}"
                )
            self._state.update(t, e.now_q, e.now_v)
            for frame, position, turn, jacobian in self._places:
                position[:], turn[:], jacobian[:] = frame.position, frame.rotation, frame.jacobian()[:, 6:]
            if joint_tau is not None and forces is None:
                e.h[:] = self._state.h[6:]
            if settle(address):
                raise InvalidInput("the estimate is not finite")
        except InvalidInput as cause:
            self.why = f"sample left out: {cause}"
        else:
            self._say()
        return e.out_q.copy(), e.out_v.copy()

    def _hear(self, given: Sequence[Any]) -> int:
        """Take down the parts of a sample; which is none, from 1, or 0."""
        there = 0
        for i, (value, (_, array)) in enumerate(zip(given, self._parts, strict=True)):
            if value is None and i >= NEEDED:
                continue
            there |= 1 << i
            try:
                numbers = np.asarray(value, dtype=np.float64)
                if numbers.shape != array.shape:
                    return i + 1
                array[:] = numbers
            except Exception:  # a conversion may raise whatever it likes
                return i + 1
        self._estimate.sizes[PARTS] = there
        return 0

    def _say(self) -> None:
        """What is wrong with the sample."""
        e, self.why = self._estimate, ""
        if e.clock[STEP] > GAP:
            self.why = f"nothing was heard for {e.clock[STEP]:.3g} s"
        elif e.slips.any():
            self.why = "; ".join(f"{name} slips" for name, slips in zip(self._names, e.slips, strict=True) if slips)


def _points(foot: Foot) -> Mat:
    """The points of a foot (m, 3) [m], in its frame: the centre of a ball, or three on a sole that fix its place."""
    origin = np.array(foot.origin)
    if foot.kind == "sole" and foot.half_size is None:
        raise InvalidInput(f"foot {foot.frame!r} is a sole without half_size; load(..., feet=[...]) measures it")
    if foot.half_size is None:
        return origin[None]
    x, y = foot.half_size
    points: Mat = origin + np.array([[x, y, 0.0], [x, -y, 0.0], [-x, 0.0, 0.0]])
    return points
