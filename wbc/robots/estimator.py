"""BaseEstimator: where a floating base is and how it moves, from an IMU and the encoders of the joints.

Every sample of the sensors does this, with the filter of :mod:`wbc.robots.invariant_filter`:

1. Predict: R, v, p of the IMU by the gyroscope and the accelerometer. A ball of radius r [m] whose link turns by the
   angle θ (3,) [rad, world axes] in the sample rolls by r θ × z, with the vertical z; a flat foot does not.
2. Touching. A foot begins to touch when its normal force has been more than ``make`` for ``settle`` seconds, and ends
   at once when the force is less than ``break_``; both are shares of the robot's weight. Where no sensor in the foot
   gives the force, it is that which explains the joint torques best, by least squares, nothing accelerating:
   Jᵀ f = h − τ, with the Jacobian J (6 or 3, nj) of the foot, the bias h (nj,) and the torques τ (nj,) [N m].
3. Slip. r (3m,) [m] are the innovations of the m points of a foot, S their covariance. A foot with
   rᵀ S⁻¹ r > γ has moved: γ is what χ² with 3m degrees of freedom exceeds with probability ``gate``.
4. Correct by the points of the feet that touched and did not move. Those that just touched or moved stand where the
   encoders see them from now on.

A round foot is one point, the centre of its ball. A flat one is three points of its sole, which hold its orientation
too. Covariance of where the encoders see the points, with Jacobian J (3m, nj) of all of them in the IMU's frame, the
errors of encoders ``joint`` [rad, m] and of what is rigid ``flex`` [m]: N = joint² J Jᵀ + flex² I. A standing point
wanders by ``creep`` [m/√s] along the ground, which is what a foot does that is neither fixed nor slips, and by ``sink``
[m/√s] up and down, as soles and ground give way when weight shifts: a flat sole then holds the heading, not the lean.

Rates come with white noise, which gains on velocities make torques. What is returned are those of a Kalman filter that
takes accelerations for white, with densities ``agility`` [rad/s²/√Hz, m/s²/√Hz] of base and joints: a low-pass with the
time constant of noise over agility, which is 0 for a sensor without noise.

What nothing here can see: the position, and the heading. Both drift, from where :meth:`BaseEstimator.reset` put them.
The vertical and the velocity do not. Of a robot that never leans otherwise, the bias of the accelerometer along the
floor cannot be told from a lean by as many rad as it is shares of g.

Points as states and the gate: M. Bloesch, M. Hutter, M. A. Hoepflinger, S. Leutenegger, C. Gehring, C. D. Remy, R.
Siegwart: State estimation for legged robots: consistent fusion of leg kinematics and IMU, Robotics: Science and Systems
2012. Flat feet: N. Rotella, M. Bloesch, L. Righetti, S. Schaal: State estimation for a humanoid robot, IROS 2014.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, final

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from wbc import checks
from wbc.errors import InvalidInput
from wbc.models.feet import Foot
from wbc.models.model import RobotModel
from wbc.robots.invariant_filter import ImuNoise, InvariantFilter, cross_matrix
from wbc.types import Index, Mat, Vec

#: A sample that comes later than this after the one before is a gap [s]; what the IMU missed then, at most, is taken to
#: be a rate [rad/s] and an acceleration [m/s²] of this size.
GAP, MISSED_RATE, MISSED_ACCELERATION = 0.02, 1.0, 5.0
#: A joint that is said to be faster is none [rad/s, m/s]; nor is one that far away [rad, m].
FASTEST, FARTHEST = 1e3, 1e4


@final
class BaseEstimator:
    """Estimates (q, v) of a robot with a floating base, one sample of its sensors after the other.

    Settings are arguments; what changes is what :meth:`reset` and :meth:`update` write. Without ``forces`` and
    ``joint_tau`` every contact is taken to touch: for a robot that only stands.

    Args:
        robot: from ``wbc.load``, with a floating base.
        contacts: frames of the robot, or :class:`~wbc.models.feet.Foot`; default: the robot's feet.
        imu_frame: the frame of the IMU, on the link of the base; default: the base itself.
        noise: of the IMU.
        joint, flex, creep, sink, agility: as above [rad, m], [m], [m/√s], [m/√s], (base, joints).
        joint_rate: error of the joint velocities in each sample [rad/s, m/s].
        make, break_, settle: when a foot touches [share of the weight], [s].
        gate: probability at which a foot that stands is taken to slip, in each sample.
        tilt, speed: standard deviations of what ``reset`` is told of the lean [rad] and of v [m/s].

    Raises:
        InvalidInput: a robot without floating base or contacts, an IMU on another link, a number out of range.
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
        agility: tuple[float, float] = (0.012, 0.1),
        make: float = 0.05,
        break_: float = 0.025,
        settle: float = 5e-3,
        gate: float = 1e-6,
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
        self._joint2 = checks.number("joint", joint, low=0.0) ** 2
        self._flex2 = checks.number("flex", flex, low=0.0, strict=True) ** 2
        self._joint_rate = checks.number("joint_rate", joint_rate, low=0.0)
        base, joints = checks.pair("agility", agility, "base, joints")
        self._agility = (
            checks.number("agility of the base", base, low=0.0, strict=True),
            checks.number("agility of joints", joints, low=0.0, strict=True),
        )
        weight = robot.mass * float(np.linalg.norm(robot.gravity))
        self._make = weight * checks.number("make", make, low=0.0)
        self._break = weight * checks.number("break_", break_, low=0.0, high=make)
        self._settle = checks.number("settle", settle, low=0.0)
        gate = checks.number("gate", gate, low=0.0, high=1.0)
        self._tilt2 = checks.number("tilt", tilt, low=0.0) ** 2
        self._speed2 = checks.number("speed", speed, low=0.0) ** 2
        self._state = robot.state(drifts=False)
        self._frames = [self._state.frame(name) for name in names]
        self._offsets = [_points(foot) for foot in self._feet]
        counts = [len(points) for points in self._offsets]
        self._points = np.split(np.arange(sum(counts)), np.cumsum(counts)[:-1])
        self._foot_of = np.repeat(np.arange(len(names)), counts)
        self._radius = np.array([foot.radius if foot.kind == "point" else 0.0 for foot in self._feet])
        self._gates = np.array([chdtri(3 * count, gate) for count in counts])
        self._least_gate = float(self._gates.min())
        self._up = -robot.gravity / np.linalg.norm(robot.gravity)
        self._up_cross = cross_matrix(self._up)
        creep, sink = checks.number("creep", creep, low=0.0), checks.number("sink", sink, low=0.0)
        upright = np.outer(self._up, self._up)
        self._wander = creep**2 * (np.eye(3) - upright) + sink**2 * upright
        self.lever, self.mount = self._imu(imu_frame)
        self._filter = InvariantFilter(sum(counts), self.noise, np.array(robot.gravity))
        self._names = names
        #: Of each part of a sample: name, size, the largest that any sensor says, whether it is needed.
        self._sound_is = (
            ("joint_q", robot.nj, FARTHEST, True),
            ("joint_v", robot.nj, FASTEST, True),
            ("gyro_in_imu", 3, self.noise.gyro_range, True),
            ("acceleration_in_imu", 3, self.noise.accelerometer_range, True),
            ("joint_tau", robot.nj, checks.LARGEST, False),
            ("forces", len(names), checks.LARGEST, False),
        )
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
        return np.array(found.position), np.array(found.rotation)

    def reset(self, q: Any, v: Any) -> None:
        """Begin at q (nq,), v (nv,): its position and heading are those that all later estimates are in.

        Raises:
            InvalidInput: wrong shape, not finite, or a quaternion that is not of length 1 within 1e-6.
        """
        q, v = checks.array("q", q, (self.robot.nq,)), checks.array("v", v, (self.robot.nv,))
        if abs(np.linalg.norm(q[3:7]) - 1.0) > 1e-6:
            raise InvalidInput(f"q[3:7] is a quaternion of length {np.linalg.norm(q[3:7]):g}; it must be 1")
        base = rotation(q[3:7])
        variance = np.concatenate([self._tilt2 * (1.0 - self._up**2), np.full(3, self._speed2), np.zeros(3)])
        velocity = base @ (v[:3] + cross_matrix(v[3:6]) @ self.lever)
        self._filter.start(base @ self.mount, velocity, q[:3] + base @ self.lever, variance)
        self._q, self._v = q, v
        self._t: float | None = None
        self._turns: Mat | None = None
        self._since = np.full(len(self._names), np.inf)
        self._touching = np.zeros(len(self._names), dtype=bool)
        self._standing = np.zeros(len(self._names), dtype=bool)
        self.why = ""

    # ---- what is known
    @property
    def contacts(self) -> Mapping[str, bool]:
        """True for each foot that touches the ground, by name."""
        return MappingProxyType(dict(zip(self._names, self._touching.tolist(), strict=True)))

    @property
    def gyro_bias(self) -> Vec:
        """Estimated bias of the gyroscope (3,) [rad/s], axes of the IMU."""
        return self._filter.gyro_bias.copy()

    @property
    def accelerometer_bias(self) -> Vec:
        """Estimated bias of the accelerometer (3,) [m/s²], axes of the IMU."""
        return self._filter.accelerometer_bias.copy()

    @property
    def covariance(self) -> Mat:
        """Of the errors (9, 9) of the base, world axes: position [m], orientation [rad], velocity [m/s]."""
        R, lever = self._filter.R, self.mount.T @ -self.lever
        p, arm = self._filter.p + R @ lever, R @ cross_matrix(lever)
        rate = R @ (self.mount.T @ self._v[3:6])
        v = self._filter.v + cross_matrix(rate) @ R @ lever
        into = np.zeros((9, 15))  # of the base: p + R l, v + R (ω × l)
        into[:3, 6:9], into[:3, :3] = np.eye(3), -cross_matrix(p)
        into[3:6, :3] = np.eye(3)
        into[6:, 3:6], into[6:, :3], into[6:, 9:12] = np.eye(3), -cross_matrix(v), arm
        return into @ self._filter.P[:15, :15] @ into.T

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
        ``why`` says so, and the last (q, v) come back. Nothing is raised, and nothing that is returned is not finite.

        Args:
            t: time of the sample [s].
            joint_q, joint_v: of the joints (nj,) [rad, m], [rad/s, m/s].
            gyro_in_imu: mean rate since the sample before (3,) [rad/s], axes of the IMU.
            acceleration_in_imu: mean specific force (3,) [m/s²], axes of the IMU: upwards g at rest.
            joint_tau: torques of the joints (nj,) [N m, N].
            forces: the normal force on each contact [N], by frame; used in place of torques.
        """
        try:
            sample = self._sound(t, joint_q, joint_v, gyro_in_imu, acceleration_in_imu, joint_tau, forces)
            before = dict(vars(self._filter))
            try:
                self._q, self._v = self._take(float(t), sample)
            except BaseException:
                vars(self._filter).update(before)
                raise
        except (InvalidInput, np.linalg.LinAlgError) as cause:
            self.why = f"sample left out: {cause}"
        return self._q.copy(), self._v.copy()

    def _sound(self, t: Any, *given: Any) -> list[Vec | None]:
        """Joint positions and velocities, rate, specific force, torques and forces of a sample, as arrays.

        Raises:
            InvalidInput: what no sensor says.
        """
        t = checks.number("t", t)
        if self._t is not None and t <= self._t:
            raise InvalidInput(f"t is {t:g} s, not later than that of the sample before, {self._t:g} s")
        *arrays, forces = given
        if isinstance(forces, Mapping):
            forces = [forces.get(name, np.nan) for name in self._names]
        found: list[Vec | None] = []
        for value, (name, size, most, needed) in zip([*arrays, forces], self._sound_is, strict=True):
            if value is None and not needed:
                found.append(None)
                continue
            try:
                array = np.asarray(value, dtype=np.float64)
                fits = array.shape == (size,) and bool((np.abs(array) <= most).all())
            except Exception:  # a conversion may raise whatever it likes
                fits = False
            if not fits:
                raise InvalidInput(f"{name} is {checks.shown(value)}; it must have shape ({size},) within ±{most:g}")
            found.append(array)
        return found

    def _take(self, t: float, sample: Sequence[Any]) -> tuple[Vec, Vec]:
        """(q, v) after a sound sample.

        Raises:
            LinAlgError: numbers that have lost their meaning; only the filter has changed then.
        """
        joint_q, joint_v, gyro, acceleration, tau, forces = sample
        estimate, dt = self._filter, 0.0 if self._t is None else t - self._t
        has_gap = dt > GAP
        if has_gap:
            missed = min(dt, 10.0) * np.repeat([MISSED_RATE, MISSED_ACCELERATION, 0.5 * dt * MISSED_ACCELERATION], 3)
            estimate.v = np.zeros(3)
            estimate.doubt(missed**2)
        elif dt > 0.0:
            estimate.predict(dt, gyro, acceleration, self._wander)
        rate = self.mount @ (gyro - estimate.gyro_bias)
        base = estimate.R @ self.mount.T
        q = np.concatenate([np.zeros(3), quaternion_of(base, self._q[3:7]), joint_q])
        v = np.concatenate([np.zeros(3), rate, joint_v])
        self._state.update(t, q, v)
        turns = np.array([frame.rotation for frame in self._frames])
        if self._turns is not None:
            estimate.d = estimate.d + self._rolled(self._turns, turns)
        touching, since = self._feel(t, self._normal(tau, forces))
        standing = touching & self._standing & (not has_gap)
        places, J = self._seen(base)
        slips = self._correct(np.flatnonzero(standing), places, J)
        standing[slips] = False
        if (fresh := np.flatnonzero(touching & ~standing)).size:
            points = self._points_of(fresh)
            estimate.place(points, places[points], self._encoders(J, points))
        base = estimate.R @ self.mount.T
        q[:3] = estimate.p - base @ self.lever
        q[3:7] = quaternion_of(base, self._q[3:7])
        v[3:6] = self.mount @ (gyro - estimate.gyro_bias)
        if 0.0 < dt and not has_gap:
            for part, noise, agility in zip(
                (slice(3, 6), slice(6, None)),
                (self.noise.gyro / math.sqrt(dt), self._joint_rate),
                self._agility,
                strict=True,
            ):
                v[part] = self._v[part] + _gain(noise**2, agility**2 * dt) * (v[part] - self._v[part])
        v[:3] = base.T @ estimate.v - cross_matrix(v[3:6]) @ self.lever
        if not (np.isfinite(q).all() and np.isfinite(v).all() and np.isfinite(estimate.P).all()):
            raise np.linalg.LinAlgError("the estimate is not finite")
        self._t, self._turns, self._touching, self._standing, self._since = t, turns, touching, touching, since
        said = [f"{self._names[i]} slips" for i in slips] + [f"nothing was heard for {dt:.3g} s"] * has_gap
        self.why = "; ".join(said)
        return q, v

    def _rolled(self, before: Mat, now: Mat) -> Mat:
        """By how much each point has rolled (k, 3) [m], from the rotations (c, 3, 3) of the feet."""
        turn = now @ before.transpose(0, 2, 1)
        angle = 0.5 * np.column_stack(
            [turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]]
        )
        moved: Mat = (self._radius[:, None] * (angle @ self._up_cross))[self._foot_of]
        return moved

    def _normal(self, tau: Vec | None, forces: Vec | None) -> Vec:
        """Normal force on each foot (c,) [N]; inf where nobody knows."""
        if forces is not None:
            return forces
        if tau is None:
            return np.full(len(self._names), np.inf)
        unexplained, found = self._state.h[6:] - tau, np.empty(len(self._names))
        for i, (frame, foot) in enumerate(zip(self._frames, self._feet, strict=True)):
            J = frame.jacobian()[: 3 if foot.kind == "point" else 6, 6:]
            gram = J @ J.T
            gram.reshape(-1)[:: len(gram) + 1] += 1e-6 * gram.trace()  # a straight leg carries what no joint feels
            found[i] = self._up @ np.linalg.solve(gram, J @ unexplained)[:3]
        return found

    def _feel(self, t: float, force: Vec) -> tuple[NDArray[np.bool_], Vec]:
        """Which feet touch, and since when each that presses has done so."""
        start = t if self._t is not None else -np.inf
        since = np.where(force > self._make, np.minimum(self._since, start), np.inf)
        landed = t - since >= self._settle - 1e-9
        return np.where(self._touching, force >= self._break, landed), since

    def _seen(self, base: Mat) -> tuple[Mat, Mat]:
        """Where the encoders see each point from the IMU (k, 3), world axes, and its Jacobian (k, 3, nj)."""
        places, jacobians = [], []
        origin = base @ self.lever
        for frame, offsets in zip(self._frames, self._offsets, strict=True):
            arms, J = offsets @ frame.rotation.T, frame.jacobian()[:, 6:]
            for arm in arms:
                places.append(frame.position + arm - origin)
                jacobians.append(J[:3] - cross_matrix(arm) @ J[3:] if arm.any() else J[:3])
        return np.array(places), np.array(jacobians)

    def _encoders(self, J: Mat, points: Index) -> Mat:
        """N (3m, 3m) [m²] of those points (m,)."""
        rows = J[points].reshape(3 * len(points), -1)
        N: Mat = self._joint2 * (rows @ rows.T)
        N.reshape(-1)[:: len(N) + 1] += self._flex2
        return N

    def _correct(self, feet: Index, places: Mat, J: Mat) -> list[int]:
        """Take up what the feet that stand say; those that have moved."""
        if not len(feet):
            return []
        points = self._points_of(feet)
        r, S, seen = self._filter.innovation(points, places[points], self._encoders(J, points))
        # No foot alone exceeds what all of them do together.
        if self._filter.correct(r, S, seen, self._least_gate):
            return []
        held, slips, at = np.ones(len(r), dtype=bool), [], 0
        for i in feet:
            own = slice(at, at + 3 * len(self._points[i]))
            if r[own] @ np.linalg.solve(S[own, own], r[own]) > self._gates[i]:
                slips.append(int(i))
                held[own] = False
            at = own.stop
        if slips:
            r, S, seen = r[held], S[np.ix_(held, held)], seen[held]
        if r.size:
            self._filter.correct(r, S, seen)
        return slips

    def _points_of(self, feet: Index) -> Index:
        return np.concatenate([self._points[i] for i in feet])


def _gain(noise2: float, step2: float) -> float:
    """Gain of the stationary Kalman filter of a random walk with these squares of steps, seen with those of noise."""
    known = 0.5 * (step2 + math.sqrt(step2**2 + 4.0 * step2 * noise2))
    return known / (known + noise2)


def _points(foot: Foot) -> Mat:
    """The points of a foot (m, 3) [m], in its frame: the centre of a ball, or three on a sole that fix its place."""
    origin = np.array(foot.origin)
    if foot.half_size is None:
        return origin[None]
    x, y = foot.half_size
    points: Mat = origin + np.array([[x, y, 0.0], [x, -y, 0.0], [-x, 0.0, 0.0]])
    return points


def rotation(quaternion: Vec) -> Mat:
    """The rotation (3, 3) of a quaternion x y z w of length 1."""
    X = cross_matrix(quaternion[:3])
    R: Mat = np.eye(3) + 2.0 * quaternion[3] * X + 2.0 * X @ X
    return R


def quaternion_of(R: Mat, near: Vec) -> Vec:
    """The quaternion x y z w of R (3, 3): that of the two which is near another."""
    (a, b, c), (d, e, f), (g, h, i) = R.tolist()
    squares = (1.0 + a - e - i, 1.0 - a + e - i, 1.0 - a - e + i, 1.0 + a + e + i)  # four times those of its entries
    most = squares.index(max(squares))
    entries = np.array(
        (
            (squares[0], b + d, c + g, h - f),
            (b + d, squares[1], f + h, c - g),
            (c + g, f + h, squares[2], d - b),
            (h - f, c - g, d - b, squares[3]),
        )[most]
    )
    quaternion: Vec = entries / np.linalg.norm(entries)
    return quaternion if quaternion @ near >= 0.0 else -quaternion
