"""Check: proves that what a program takes for a robot's joints are the robot's joints, from what comes back.

    listen    states come, in time, in order and sound
    frames    what we would send is what the robot takes, motor by motor
    move      one joint at a time moves by a few degrees; the torques of all joints are compared with the model's
              (:mod:`wbc.robots.response`): order, sign, gear, unit, offset; and how late orders act
    turn      the robot is turned by hand about three axes: order of the quaternion, mounting and units of the IMU

Joints that the model cannot tell apart by their torques are moved by hand, one of each kind. What is wrong is one
sentence each; what rotors and friction hide stays unproven. The base is fixed: it hangs or lies. Not tried on hardware.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel
from wbc.robots import imu_check
from wbc.robots.device import BadFrame, Device, Order, Reading, rotation
from wbc.robots.hands import Hands
from wbc.robots.joint_map import UNITS, JointMap
from wbc.robots.port import Port
from wbc.robots.response import CONVINCING, Candidates, Expected, Mistake, Response, Weights
from wbc.robots.stamps import unwrapped
from wbc.types import Mat, Vec

#: Motions: frequency [Hz], amplitude [rad, m] and as a share of the joint's range at most, whole periods that it grows
#: in and that are measured.
FREQUENCY, AMPLITUDE, SHARE, GROWS, MEASURED = 2.5, 0.06, 0.25, 1, 2
#: Orders that act later than this [s], and clocks that differ by more than this share, are findings.
LATE, DIFFERENT = 0.02, 0.2


@final
@dataclass(frozen=True)
class Finding:
    """One thing that is wrong. ``kind``: "silent", "frame", "rate", "stale", "order", "sign", "gear", "unit", "offset",
    "torque", "command", "velocity", "latency", "imu", "unknown"; ``joints`` are those it is about."""

    kind: str
    sentence: str
    joints: tuple[str, ...] = ()


@final
@dataclass
class Checked:
    """What a check found. ``unproven``: what could not be looked at, and why; ``figures``: rate [Hz]; latency [s] of
    orders, to a period of the states."""

    findings: list[Finding] = field(default_factory=list)
    unproven: list[str] = field(default_factory=list)
    figures: dict[str, float] = field(default_factory=dict)

    @property
    def ok(self) -> bool:
        """Whether nothing was found."""
        return not self.findings

    def add(self, kind: str, sentence: str, joints: tuple[str, ...] = ()) -> None:
        """Add a finding."""
        self.findings.append(Finding(kind, sentence, joints))


class _Moved(NamedTuple):
    """Positions, velocities, torques, what orders and states asked of them (N, n); the joint that ran away, or None."""

    q: Mat
    v: Mat
    tau: Mat
    wanted: Mat
    felt: Mat
    away: int | None


@final
class _Check:
    def __init__(
        self, port: Port, robot: RobotModel, *, device: Device, joint_map: JointMap, hands: Hands | None,
        progress: Callable[[float], None],
    ) -> None:  # fmt: skip
        self.port, self.robot, self.device, self.joint_map = port, robot, device, joint_map
        self.hands, self.progress, self.result = hands, progress, Checked()
        self.period = 1.0 / device.rate
        joints = [robot.joint(name) for name in joint_map.joints]
        if joints != [*range(robot.nj)]:
            raise InvalidInput("a check needs a map of all joints of the robot, in its order")
        # Of each motor. A map that is wrong can make it smaller, never larger.
        ranges = np.minimum(robot.limits.q_max - robot.limits.q_min, checks.LARGEST)
        own = SHARE * np.abs(joint_map.velocity_to_device(ranges))
        self.amplitude: Vec = np.minimum(AMPLITUDE * UNITS[device.unit], np.where(own > 0.0, own, np.inf))
        self.reading: Reading | None = None
        self.attitude: Mat = np.eye(3)

    # ---- listen
    def listen(self) -> bool:
        """Whether states come that can be used."""
        add, times, begun = self.result.add, [], self.port.clock()
        while self.port.clock() - begun < 1.0:
            self.port.sleep(0.5 * self.period)
            if self._hear():
                times.append(self._now().time)
        if not times and self.result.ok:
            add("silent", "no state comes: the robot is off, or the topic or the network is another")
        if not self.result.ok:
            return False
        rate = len(times) / (self.port.clock() - begun)
        self.result.figures["rate"] = rate
        steps = np.diff([unwrapped(one, times[0], self.device.wraps) for one in times])
        if not np.isnan(times[0]):
            passed = steps.sum() / len(steps) * rate
            same = int((steps == 0.0).sum())
            if same == len(steps):
                add("stale", "states are stale: their time stands still")
            elif same > DIFFERENT * len(steps):
                add("stale", f"{same} of {len(steps)} states are the one before once more")
            elif older := int((steps < 0.0).sum()):
                add("stale", f"states come out of order: {older} of {len(steps)} are older than the one before")
            elif not 1.0 - DIFFERENT < passed < 1.0 + DIFFERENT:
                add("rate", f"the robot's clock runs {passed:.3g} times as fast as ours")
        if not 1.0 - DIFFERENT < rate * self.period < 1.0 + DIFFERENT:
            add("rate", f"states come at {rate:.0f} Hz, not {self.device.rate:.0f} Hz")
        return self.result.ok

    # ---- frames
    def frames(self) -> bool:
        """Whether the robot would take what we send, and as it is meant."""
        now = self._now()
        n = np.arange(len(now.q)) + 1.0
        order = Order(now.q + 1e-3 * n, 1e-3 * n, 1e-2 * n, n, 0.1 * n)
        frame = self.device.encode(order, now)
        try:
            taken = self.port.device.decode(frame, now)
        except BadFrame as cause:
            self.result.add("frame", f"the robot does not take our frames: {cause}")
            return False
        if self.device.law == "impedance":
            for name in ("q", "dq", "tau", "kp", "kd"):
                theirs, ours = getattr(taken, name), getattr(order, name)
                wrong = np.abs(theirs - ours) > 1e-4 * (1.0 + np.abs(ours))
                if wrong.any():
                    motor = self.device.motors[int(wrong.argmax())]
                    self.result.add("frame", f"our frames say another {name} of {motor} than is meant", (motor,))
                    return False
        return True

    def _now(self) -> Reading:
        assert self.reading is not None, "states come"
        return self.reading

    # ---- move
    def _hear(self) -> bool:
        """Whether a sound state has come; one that is not is a finding, and the check goes on without it."""
        frame = self.port.receive()
        try:
            if frame is not None:
                self.reading = self.device.unpack(frame)
            return frame is not None
        except BadFrame as cause:
            if all(one.kind != "frame" for one in self.result.findings):
                self.result.add("frame", f"states are not sound: {cause}")
            return False

    def _send(self, position: Vec) -> Order:
        # All that is sent is thought in motors, not in joints: it does not depend on the map.
        order = Order(position, 0.0, self.support, *self.device.gains)
        self.port.send(self.device.encode(order, self._now()))
        return order

    def _state(self) -> tuple[Vec, Vec]:
        reading = self._now()
        torque = self.joint_map.torque_from_device(np.nan_to_num(reading.tau))
        return self.joint_map.position_from_device(reading.q), torque

    def begin(self) -> bool:
        """Hold the robot where it is, and take down how it rests."""
        self.expected = Expected(self.robot, self.attitude)
        self.rest, _ = self._state()
        if self._implausible():
            return False
        now = self._now()
        self.still, self.support = now.q, 0.0 if self.device.adds_gravity else np.nan_to_num(now.tau)
        seen = self._moved(None, 0.5)
        half = len(seen.q) // 2
        self.rest, self.weight = seen.q[half:].mean(axis=0), seen.tau[half:].mean(axis=0)
        return True

    def _implausible(self) -> bool:
        limits, q = self.robot.limits, self.rest
        outside, as_degrees = (np.maximum(one - limits.q_max, limits.q_min - one) > 0.3 for one in (q, np.radians(q)))
        is_wrong = bool(outside.any() and not as_degrees.any() and np.abs(q).max() > 4.0 * np.pi)
        if is_wrong:
            names = tuple(self.robot.joint_names[k] for k in np.flatnonzero(outside))
            who = names[0] if len(names) == 1 else "every joint"
            self.result.add("unit", f"{who} comes in degrees and is taken for radians", names)
        return is_wrong

    def _moved(self, motor: int | None, seconds: float) -> _Moved:
        """What comes back while a motor swings; it ends early where one runs away."""
        joint_map, rows, away = self.joint_map, [], None
        for k in range(round(seconds / self.period)):
            t, position = k * self.period, self.still.copy()
            if motor is not None:
                swing = min(1.0, t * FREQUENCY / GROWS) * np.sin(2.0 * np.pi * FREQUENCY * t)
                position[motor] += self.amplitude[motor] * swing
            order = self._send(position)
            self.port.sleep(self.period)
            self._hear()
            reading = self._now()
            # τ = wanted + felt, of which a motor that has the law on board feels its own state at once.
            rate = np.nan_to_num(reading.dq)
            wanted, felt = order.torque(0.0 * reading.q, 0.0 * rate), -order.kp * reading.q - order.kd * rate
            q, tau = self._state()
            velocity = joint_map.velocity_from_device(rate)
            rows.append((q, velocity, tau, *(joint_map.torque_from_device(part) for part in (wanted, felt))))
            far = (np.abs(reading.q - self.still) / self.amplitude)[joint_map.index]
            if motor is not None and far.max() > 4.0:
                away = int(far.argmax())
                break
        q, v, tau, wanted, felt = (np.array(column) for column in zip(*rows, strict=True))
        return _Moved(q, v, tau, wanted, felt, away)

    def move(self) -> Response | None:
        """Move each joint; None where that cannot go on."""
        n, names, add = self.robot.nj, self.robot.joint_names, self.result.add
        Q, V, A, S, T = np.zeros((5, n, 4 * n))
        seconds = (GROWS + MEASURED) / FREQUENCY
        weights = Weights(round(seconds / self.period), self.period, FREQUENCY)
        weigh, first, window = weights.phi[:2], weights.first[:2], weights.window
        kp = np.broadcast_to(self.device.gains[0], len(self.device.motors))
        drive = 0.5 * np.abs(self.joint_map.torque_from_device(kp * self.amplitude))  # of ∫ φ sin: ∫ window / 2
        q, tau = self.rest.copy(), self.weight.copy()
        lags, slow = [], dict[str, float]()
        for j, name in enumerate(names):
            self.progress(j / n)
            seen = self._moved(int(self.joint_map.index[j]), seconds)
            if seen.away is not None:
                who, cause = names[seen.away], "orders act too late to hold it"
                if self.device.law != "torque":
                    cause = "the gains of its motor do not hold it"
                add("command", f"{who} runs away: it is commanded one way and read the other, or {cause}", (who,))
                return None
            rate, change = weigh @ seen.v[:, j], -first @ (seen.q[:, j] - self.rest[j])
            ratio = float(rate @ change / (change @ change))
            if not np.isnan(self._now().dq).any() and not 0.7 < ratio < 1.4:
                slow[name] = ratio
            lag, own = self._lag(seen, j)
            lags.append(lag * self.period)
            # A motor gives the torques that its own order asks for: others, where orders go astray.
            astray = np.linalg.norm(weigh @ (seen.tau - self._asked(seen, lag, own)), axis=0) / drive
            if self.device.has_torque and astray[j] > 0.4 and name not in slow:
                others = [k for k in range(n) if k != j and astray[k] > 0.2]
                moved = f"an order for {name} moves {names[others[0]]}" if others else f"{name} ignores its orders"
                add("command", moved, (name, *(names[k] for k in others[:1])))
                return None
            swing = weigh @ (seen.q - self.rest)
            if (np.abs(self.joint_map.velocity_to_device(np.abs(swing).max(axis=0))) <= 3e-3 * self.amplitude).all():
                add("command", f"{name} does not move by what it is sent", (name,))
                return None
            change, columns = seen.q - self.rest, slice(j, None, n)
            Q[:, columns], T[:, columns] = (weights.phi @ change).T, (weights.phi @ (seen.tau - self.weight)).T
            V[:, columns], A[:, columns] = -(weights.first @ change).T, (weights.second @ change).T
            S[j, columns] = weights.signs(seen.q[:, j])
            q[j], tau[j] = window @ seen.q[:, j], window @ seen.tau[:, j]  # friction goes both ways, gravity does not
            self._moved(None, 0.16)
        if slow:
            which, middle = "all joints" if len(slow) == n else ", ".join(slow), float(np.median([*slow.values()]))
            how = "have the other sign" if -1.4 < middle < -0.7 else f"are {middle:.3g} times the rates of positions"
            add("velocity", f"the velocities of {which} {how}", tuple(slow))
        latency = self.result.figures["latency"] = float(np.median(lags))
        # By wrong velocities nobody knows what was asked for; without torques, how late a drive itself is counts too.
        if latency > LATE and not slow and self.device.has_torque:
            add("latency", f"orders act {1e3 * latency:.0f} ms late")
        return Response(q, tau, Q, V, A, S, T)

    def _asked(self, seen: _Moved, lag: int, own: float) -> Mat:
        """The torques (N, n) that were asked for, had orders acted so many periods late.

        The law on the robot is about its state ``own`` periods before, an order about the one that was read before it.
        """
        before = np.roll(seen.felt, 1 if self.device.law == "impedance" else lag + 1, axis=0)
        own = own if self.device.law == "impedance" else 1.0
        return np.roll(seen.wanted, lag, axis=0) + (1.0 - own) * seen.felt + own * before

    def _lag(self, seen: _Moved, j: int) -> tuple[int, float]:
        """How many periods torques, or positions where there are none, follow what was asked for; and ``own``, between
        two states where the law is faster than orders: without it the torque of the state before would hide a delay."""
        most = min(len(seen.tau) // 2, round(0.1 / self.period))
        if not self.device.has_torque:
            q, wanted = (one[:, j] - one[:, j].mean() for one in (seen.q, seen.wanted))
            return int(np.argmax([np.corrcoef(q[most:], np.roll(wanted, k)[most:])[0, 1] for k in range(most)])), 0.0
        fits = []
        for lag in range(most):
            now, before = ((seen.tau - self._asked(seen, lag, own))[most:, j] for own in (0.0, 1.0))
            (_, along), (_, size) = np.cov(now, now - before)
            own = float(np.clip(along / size, 0.0, 1.0)) if size > 0.0 else 0.0
            fits.append((float(np.var((1.0 - own) * now + own * before)), lag, own))
        return min(fits)[1:]

    # ---- what it was
    def explain(self, seen: Response) -> None:
        """Name the mistakes that explain what was seen, the simplest first; ask by hand where nothing shows it."""
        expected, candidates = self.expected, Candidates(self.expected)
        whole = [*candidates.exchanged(), *candidates.turned(), *candidates.units(), *candidates.limbs()]
        fitted = candidates.geared, candidates.torques, candidates.shifted
        left, cost = seen, expected.cost(seen)
        found: list[Mistake] = []
        for _ in range(6):
            if cost < CONVINCING:
                break
            every = [*whole, *(one for fit in fitted for one in fit(left, expected))]
            best, least = self._best(every, left)
            if cost - least < CONVINCING:
                break
            if not found and self.hands is not None:
                best = self._decided(best, least, every, left)
            found.append(best)
            left, cost = best.applied(left), expected.cost(best.applied(left))
        self._named(found)
        names = ", ".join(self.robot.joint_names[k] for k in self._odd(left)[:3])
        if cost > 0.3 * len(seen.q) ** 2 + CONVINCING:
            self.result.add("unknown", f"torques are not those of the model, most of all of {names}")
        elif cost >= CONVINCING:
            self.result.unproven.append(f"torques differ somewhat from those of the model, most of all of {names}")
        if not self.result.ok:
            self.result.unproven.append("what torques do not show; check again once this is right")
            return
        ideal = expected.ideal(left)  # what a sound robot could not be told from
        self._by_hand([one for one in whole if expected.cost(one.applied(ideal)) < 2.0 * CONVINCING])
        self.result.unproven += candidates.hidden(ideal, expected)
        self._named(expected.outside(left.q) if self.result.ok else [])

    def _named(self, found: list[Mistake]) -> None:
        for mistake in found:
            self.result.add(mistake.kind, mistake.sentence, mistake.joints)

    def _decided(self, best: Mistake, least: float, mistakes: list[Mistake], seen: Response) -> Mistake:
        """Of the mistakes that explain nearly as much as the best one, the one that joints moved by hand show."""
        costs = np.array([self.expected.cost(one.applied(seen)) for one in mistakes])
        rivals = [mistakes[k] for k in np.argsort(costs, kind="stable") if costs[k] < least + CONVINCING]
        for _ in range(4):
            joint = next((name for one in rivals if (name := best.parts(one, self.robot.joint_names))), "")
            if not joint:
                break
            shown, way = self._feel(joint)
            rivals = [one for one in rivals if one.shows(joint, shown, way, self.robot.joint_names)]
            if not rivals:
                return best
            best = rivals[0]
        return best

    def _best(self, mistakes: list[Mistake], seen: Response) -> tuple[Mistake, float]:
        costs = [self.expected.cost(mistake.applied(seen)) for mistake in mistakes]
        k = int(np.argmin(costs))
        return mistakes[k], costs[k]

    def _odd(self, seen: Response) -> list[int]:
        """Joints by how far their torques are from the model's, the farthest first."""
        dynamic, static = (np.abs(r) for r in self.expected.errors(seen))
        n = len(static)
        own = np.maximum(dynamic[:, :n].max(axis=0), dynamic[:, n:].max(axis=0))
        return [int(k) for k in np.argsort(-(static + own + dynamic.max(axis=1)))]

    def _by_hand(self, alike: list[Mistake]) -> None:
        names, moved = self.robot.joint_names, dict[str, tuple[str, float]]()
        if self.hands is None:
            for kind in dict.fromkeys(mistake.kind for mistake in alike):
                of = {name for mistake in alike if mistake.kind == kind for name in mistake.joints}
                which = ", ".join(name for name in names if name in of)
                text = f"not shown by torques, and nobody moves the robot: the {kind} of {which}"
                self.result.unproven.append(text)
            return
        for mistake in alike:
            joint = mistake.joints[0]
            if any(name in moved for name in mistake.joints) and mistake.kind == "order":
                joint = next(name for name in mistake.joints if name in moved)
            if joint not in moved:
                moved[joint] = self._feel(joint)
        wrong = [(joint, seen) for joint, (seen, way) in moved.items() if seen != joint or way < 0.0]
        if not wrong:
            return
        fits = [one for one in alike if all(one.shows(joint, *told, names) for joint, told in moved.items())]
        if fits:
            self.result.add(fits[0].kind, fits[0].sentence, fits[0].joints)
            return
        for joint, seen in wrong:
            kind, how = ("order", seen) if seen != joint else ("sign", "itself, the other way round")
            self.result.add(kind, f"{joint}, moved by hand, is read as {how}", (joint,))

    def only_by_hand(self) -> None:
        """Without torques nothing tells joints apart but a hand that moves each of them."""
        candidates = Candidates(self.expected)
        self._by_hand([*candidates.exchanged(), *candidates.turned()])
        self.result.unproven.append("gears and offsets, as the robot reports no torques")
        self._named(self.expected.outside(self.rest) if self.result.ok else [])

    def _feel(self, joint: str) -> tuple[str, float]:
        """Which joint is read to move when one is moved by hand, and by how much."""
        assert self.hands is not None, "somebody is there"
        before = self._moved(None, 0.2).q[-1]
        self.hands.move(joint)
        while not self.hands.done():
            self._send(self.still)
            self.port.sleep(self.period)
            self._hear()
        change = self._state()[0] - before
        k = int(np.abs(change).argmax())
        self.hands.move("")
        self._moved(None, 0.3)
        return self.robot.joint_names[k], float(change[k])

    # ---- turn
    def turn(self) -> bool:
        """Whether the IMU is what it is taken for, as far as somebody turns the robot."""
        rest = self._watched(lambda count: count >= 20)
        if wrong := imu_check.still(rest):
            self.result.add("imu", wrong)
        elif self.hands is None:
            if wrong := imu_check.upright(rest):
                self.result.add("imu", wrong)
            self.result.unproven.append("how the IMU is mounted, as nobody turns the robot")
        else:
            hands, turns = self.hands, []
            for axis in "xyz":
                hands.turn(axis)
                turns.append(self._watched(lambda count: hands.done() and count > 5))
                hands.turn("")
                self._watched(lambda count: hands.done() and count > 5)
            if wrong := imu_check.turned(rest, turns):
                self.result.add("imu", wrong)
        if self.result.ok:
            self.attitude = rotation(rest[-1].quaternion)
        return self.result.ok

    def _watched(self, enough: Callable[[int], bool]) -> list[Reading]:
        """The readings until ``enough`` of their number is true; it is evaluated each period."""
        readings: list[Reading] = []
        while not enough(len(readings)):
            self.port.sleep(self.period)
            if self._hear():
                readings.append(self._now())
        return readings


def check(
    port: Port, robot: RobotModel, *, device: Device | None = None, joint_map: JointMap | None = None,
    hands: Hands | None = None, progress: Callable[[float], None] = lambda done: None,
) -> Checked:  # fmt: skip
    """Check a robot whose base is fixed, as above; ``robot`` is its model with ``base="fixed"``.

    Args:
        port: a connection to the robot.
        robot: what it is taken for.
        device: who makes and reads our frames, if not the port's own device.
        joint_map: the map that is checked; default: that of equal names.
        hands: who moves the robot where torques show nothing; None: that stays unproven.
        progress: called with a number in [0, 1].

    Raises:
        InvalidInput: a floating base, a map that leaves joints out, or one of another device's motors.

    Example:
        >>> import wbc
        >>> from wbc.robots import JointMap, MotorBoard, Ros2Control
        >>> from wbc.robots.check import check
        >>> from wbc.sim.engine import PhysicsSettings
        >>> from wbc.sim.mujoco_ import MujocoPlant
        >>> robot = wbc.load("arm")
        >>> gains = [200, 200, 150, 150, 60, 60, 20], [10, 10, 8, 8, 2, 2, 0.5]
        >>> group = Ros2Control(robot.joint_names, gains=gains)
        >>> wrong = JointMap.of(robot, group.motors, sign={"elbow": -1})
        >>> plant = MujocoPlant(robot, settings=PhysicsSettings(armature=0.01))
        >>> board = MotorBoard(group, plant)
        >>> [finding.sentence for finding in check(board, robot, joint_map=wrong).findings]
        ['the sign of elbow is wrong']
    """
    if robot.nb:
        raise InvalidInput("a check is made with a fixed base: the robot hangs or lies; load it with base='fixed'")
    device = device or port.device
    taken = device.accepted(joint_map, robot)
    checker = _Check(port, robot, device=device, joint_map=taken, hands=hands, progress=progress)
    result = checker.result
    if not (checker.listen() and checker.frames() and (not device.has_imu or checker.turn())):
        return result
    if checker.begin():
        seen = checker.move()
        if seen is not None and device.has_torque:
            checker.explain(seen)
        elif seen is not None:
            checker.only_by_hand()
    return result
