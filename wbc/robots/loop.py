"""Loop: a controller on a robot. It waits for a state, comes in gently, watches what arrives, and never just stops.

    begin    the first state decides where the robot is held; over ``ramp`` seconds the controller's order replaces that
    tick     newest state → base estimate → controller → order τ*, q*, q̇*, kp, kd → frame
    end      the robot is held where it is: q* = q, τ* = the last torque, stiffness and damping of ``hold``; or it is
             let go over ``ramp`` seconds ("release"), and held where that is interrupted

Torques are continuous at both ends, but for the damping of what moves. What is watched, and counted in the run's
metadata:

    repeated      a state with the time of the one before        out of order   one that is older: it is not used
    lost          states that are missing between two            bad            frames that are not sound, or whose time
                                                                                is wild (:mod:`wbc.robots.stamps`)
    late, missed  periods (:class:`wbc.Rate`)

No new state for longer than ``patience`` ends the run. A controller that raises, Ctrl-C and the end of the time end
in the same hold. With a port that other processes can use, a guard (:mod:`wbc.robots.guard`) holds the robot also where
the script is killed. Not tried on hardware.
"""

from __future__ import annotations

import gc
from collections.abc import Callable
from math import isnan, nan
from typing import Any, Protocol, final

import numpy as np
import pinocchio
from threadpoolctl import threadpool_limits

from wbc import checks
from wbc.arguments import TellsArguments
from wbc.control.command import Command
from wbc.control.controller import Controller
from wbc.control.rate import Rate
from wbc.control.recorder import Recorder, Run
from wbc.control.setpoint import Setpoint
from wbc.errors import InvalidInput
from wbc.files import Place
from wbc.robots.device import BadFrame, Order, Reading, rotation
from wbc.robots.guard import Guard
from wbc.robots.joint_map import JointMap
from wbc.robots.motor_board import holding_gains
from wbc.robots.port import DeviceSilent, Port
from wbc.robots.stamps import FAR, is_wild, unwrapped
from wbc.types import Mat, Vec

AT_END = ("hold", "release")
#: How often a guard is told where the robot is [Hz]; rows that are set aside for a run without end.
_TELL, _ROWS = 50.0, 100_000


class Base(Protocol):
    """What estimates a floating base, such as :class:`wbc.robots.BaseEstimator`."""

    def reset(self, q: Any, v: Any) -> None:
        """Begin at q (nq,), v (nv,)."""

    @property
    def mount(self) -> Mat:
        """The rotation (3, 3) from the axes of the IMU to those of the base."""

    def update(
        self, t: float, joint_q: Any, joint_v: Any, gyro_in_imu: Any, acceleration_in_imu: Any, *, joint_tau: Any
    ) -> tuple[Vec, Vec]:
        """q (nq,) and v (nv,) after a sample of the sensors."""


@final
class Loop(metaclass=TellsArguments):
    """Runs a controller on the robot behind a port.

    Args:
        port: a connection, such as ``wbc.robots.MotorBoard``, ``wbc.robots.Udp`` or one of your own.
        controller: a controller or setpoint, with the period of the loop.
        rate: ticks per second; default: the controller's.
        joint_map: which motor drives which joint; default: that of equal names.
        base: the estimator of a floating base.
        kp, kd: gains [N m/rad, N m s/rad] of the motors about the commanded motion, one for all or (nj,). Default: 0
            where the controller decides torques, else those of ``hold``.
        hold: (stiffness, damping) that keep a posture; default: from the torque limits.
        ramp: time over which the controller takes over, and is released [s].
        at_end: "hold" or "release".
        patience: longest time without a new state [s]; for the first one it is ten times as long.
        guard: whether another process holds the robot when this one dies; needs a port that processes share.
        hold_for: how long a guard holds [s].

    Raises:
        InvalidInput: another rate than the controller's, a floating base without ``base``, an argument out of range, a
            map of another device's motors, a joint without torque limit where ``hold`` is not given.

    Example:
        >>> import numpy as np, wbc
        >>> from wbc.robots import Franka, Loop, MotorBoard
        >>> from wbc.sim.engine import PhysicsSettings
        >>> from wbc.sim.mujoco_ import MujocoPlant
        >>> from wbc.tasks import Posture
        >>> robot, arm = wbc.load("arm"), Franka()
        >>> joint_map = arm.joint_map(robot, names=dict(zip(robot.joint_names, arm.motors)))
        >>> stack = wbc.Stack([Posture(robot.q0, kp=100)])
        >>> controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics(), dt=1e-3)
        >>> plant = MujocoPlant(robot, settings=PhysicsSettings(armature=0.01))
        >>> board = MotorBoard(arm, plant, joint_map=joint_map)
        >>> run = Loop(board, controller, rate=1000, joint_map=joint_map).run(0.1)
        >>> run.rows, run.meta["ended"], run.meta["loop"]["lost"]
        (100, 'complete', 0)
    """

    def __init__(
        self,
        port: Port,
        controller: Controller | Setpoint,
        *,
        rate: float | None = None,
        joint_map: JointMap | None = None,
        base: Base | None = None,
        kp: Any = None,
        kd: Any = None,
        hold: tuple[Any, Any] | None = None,
        ramp: float = 1.0,
        at_end: str = "hold",
        patience: float = 0.1,
        guard: bool = True,
        hold_for: float = np.inf,
    ) -> None:
        port = checks.instance("port", port, Port, "a port, as MotorBoard(...)")
        self.port, self.driver = port, controller
        decides = controller.controller if isinstance(controller, Setpoint) else controller
        self.controller = checks.instance("controller", decides, Controller, "a wbc.Controller or Setpoint")
        robot = self.robot = self.controller.model
        self.dt = self.controller.dt
        if rate is not None and abs(checks.number("rate", rate, low=0.0, strict=True) * self.dt - 1.0) > 1e-9:
            raise InvalidInput(
                f"rate is {rate:g} Hz; the controller ticks at {1 / self.dt:g} Hz: give it dt = 1 / rate"
            )
        if robot.nb and base is None:
            raise InvalidInput(f"{robot.name} has a floating base, which no motor measures; give base")
        self.base = base
        self.joint_map = port.device.accepted(joint_map, robot)
        self._joints = np.array([robot.joint(name) for name in self.joint_map.joints])
        stiffness, damping = holding_gains(robot) if hold is None else checks.pair("hold", hold, "stiffness, damping")
        if hold is None and not (stiffness[self._joints] > 0.0).all():
            weak = self.joint_map.joints[int(stiffness[self._joints].argmin())]
            raise InvalidInput(f"joint {weak!r} has a torque limit of 0, so nothing would hold it; give hold")
        self._hold = self._gain("hold", stiffness), self._gain("hold", damping)
        usual = (0.0, 0.0) if self.controller.level.dynamics else (stiffness, damping)
        self._gains = self._gain("kp", usual[0] if kp is None else kp), self._gain("kd", usual[1] if kd is None else kd)
        self._ramp = checks.number("ramp", ramp, low=0.0, strict=True)
        self._at_end = checks.one_of("at_end", at_end, AT_END)
        self._patience = checks.number("patience", patience, low=0.0, strict=True)
        self._guarded = checks.truth("guard", guard) and port.shared
        self._hold_for = hold_for
        if not (isinstance(hold_for, float) and hold_for == np.inf):
            self._hold_for = checks.number("hold_for", hold_for, low=0.0, strict=True)
        self.guard: Guard | None = None
        self._gravity = robot.state() if port.device.adds_gravity else None

    def _gain(self, name: str, value: Any) -> Vec:
        """Gains of the device's motors, from those of the robot's joints."""
        joints = checks.gains(name, value, self.robot.nj)
        return self.joint_map.gain_to_device(joints[self._joints])

    # ---- a run
    def run(
        self,
        seconds: float | None = None,
        *,
        before_tick: Callable[[float], None] | None = None,
        out: Place | None = None,
    ) -> Run:
        """Run for this time, or until Ctrl-C; the record, with ``meta["ended"]`` saying how it ended.

        ``before_tick(t)`` is called first in each tick and may assign targets. ``out``: a folder for the record, which
        is written however the run ends.

        Raises:
            DeviceSilent: no first state. Whatever the controller or ``before_tick`` raised, once the robot is held.
        """
        if before_tick is not None:
            checks.function("before_tick", before_tick, "a function of a number")
        ticks = None if seconds is None else max(1, round(checks.number("seconds", seconds, low=0.0) / self.dt))
        if self._guarded and not (self.guard is not None and self.guard.alive):
            self.guard = Guard(self.port, silence=max(0.05, 5.0 * self.dt), hold_for=self._hold_for)
        self._recorder, self._counts = Recorder(ticks or _ROWS), dict.fromkeys(COUNTS, 0)
        self._rate = Rate(self.dt, clock=self.port.clock, sleep=self.port.sleep)
        self._reading: Reading | None = None
        self._time = self._stamp = nan  # of the last state, and of the last that came
        ended = "complete"
        self._wait()
        collects = gc.isenabled()
        gc.disable()  # a collection takes longer than a tick
        try:
            with threadpool_limits(1):
                ended = self._ticks(ticks, before_tick)
        except KeyboardInterrupt:
            ended = "interrupted"
        except BaseException as cause:
            ended = f"{type(cause).__name__}: {cause}"
            raise
        finally:
            try:
                ended = self._finish(ended)
            finally:
                if collects:
                    gc.enable()
                run = self._run(ended)
                if out is not None and run.rows:
                    run.save(out)
        return run

    def _wait(self) -> None:
        """The first state, and where the robot is held until the controller has come in."""
        begun = self.port.clock()
        while not self._receive():
            if self.port.clock() - begun > 10.0 * self._patience:
                raise DeviceSilent(
                    f"no state came in {10.0 * self._patience:g} s; is the robot on, and its topic right?"
                )
            self.port.sleep(self.dt)
        self.driver.reset()
        self._start = self._heard
        self._q, self._v = self._begin()
        self._order = Order(self.reading.q, tau=np.nan_to_num(self.reading.tau))

    @property
    def reading(self) -> Reading:
        """The last state."""
        assert self._reading is not None, "there is one since the run began"
        return self._reading

    def _ticks(self, ticks: int | None, before_tick: Callable[[float], None] | None) -> str:
        k, first, fresh = 0, self._held(), False
        while ticks is None or k < ticks:
            self._rate.sleep()
            fresh = self._receive()
            t = self.port.clock() - self._start
            if self.port.clock() - self._heard > self._patience:
                return f"no new state for {1e3 * self._patience:g} ms at t = {t:.3f} s"
            if before_tick is not None:
                before_tick(t)
            if fresh:
                self._estimate(t)
            age = self.port.clock() - self._heard
            command = self._recorder.tick(
                self.driver, t, self._q, self._v, **{"device.time": self._time, "device.age": age},
                **{"device.q": self.reading.q, "device.tau": self.reading.tau},
            )  # fmt: skip
            share = min(1.0, (k + 1) * self.dt / self._ramp)
            order = self._asked(command)
            self._give(k, first.mixed(order, share) if share < 1.0 else order)
            self.controller.compile_waiting()
            k += 1
        return "complete"

    def _finish(self, ended: str) -> str:
        """Hold the robot, or let it go; how the run ended."""
        released = False
        try:
            if self._at_end == "release":
                self._let_go()
                released = True
        except KeyboardInterrupt:
            ended = "interrupted"
        finally:
            if not released:
                held = self._held()
                self._send(held)
                if self.guard is not None:
                    self.guard.tell(held, self.reading, now=True)
        return ended

    def _let_go(self) -> None:
        held = self._held()
        free = Order(held.q, kd=held.kd, weight=0.0)
        ticks = max(1, round(self._ramp / self.dt))
        for k in range(ticks):
            self._rate.sleep()
            self._receive()
            self._give(k, held.mixed(free, (k + 1) / ticks))
        self.release()

    def release(self) -> None:
        """Dismiss the guard that holds the robot after a run."""
        if self.guard is not None:
            self.guard.dismiss()
            self.guard = None

    # ---- one tick
    def _receive(self) -> bool:
        """Whether a new state has come; it is then the last one."""
        frame = self.port.receive()
        if frame is None:
            return False
        try:
            reading = self.port.device.unpack(frame)
        except BadFrame:
            self._counts["bad"] += 1
            return False
        time, stamp = unwrapped(reading.time, self._time, self.port.device.wraps), self._stamp
        self._stamp = time
        if not isnan(passed := time - self._time):
            if (wild := is_wild(time, self._time, stamp)) or -FAR <= passed <= 0.0:
                self._counts["bad" if wild else "repeated" if passed == 0.0 else "out_of_order"] += 1
                return False
            expected = max(self.dt, 1.0 / self.port.device.rate)
            self._counts["lost"] += max(0, round(passed / expected) - 1)
        self._reading, self._time, self._heard = reading, time, self.port.clock()
        return True

    def _joint_state(self) -> tuple[Vec, Vec, Vec]:
        """q, v and τ (nj,) of the joints; of those that the device does not have, q0 and 0."""
        robot, joint_map, reading = self.robot, self.joint_map, self.reading
        q, v, tau = robot.q0[-robot.nj :].copy(), np.zeros(robot.nj), np.zeros(robot.nj)
        q[self._joints] = joint_map.position_from_device(reading.q)
        v[self._joints] = joint_map.velocity_from_device(np.nan_to_num(reading.dq))
        tau[self._joints] = joint_map.torque_from_device(np.nan_to_num(reading.tau))
        return q, v, tau

    def _begin(self) -> tuple[Vec, Vec]:
        """The first q (nq,), v (nv,): a floating base stands at rest on its feet, as the IMU says how."""
        robot = self.robot
        q, v = robot.q0.copy(), np.zeros(robot.nv)
        q[-robot.nj :], v[-robot.nj :], _ = self._joint_state()
        if self.base is not None and robot.nb:
            told = self.reading.quaternion
            if not np.isnan(told).any():
                if not np.linalg.norm(told) > 0.5:
                    raise InvalidInput(f"the quaternion of the IMU is {told}; it says no orientation")
                q[3:7] = pinocchio.Quaternion(rotation(told) @ self.base.mount.T).coeffs()
            q = robot.on_ground(q)  # type: ignore[attr-defined]
            self.base.reset(q, v)
        return q, v

    def _estimate(self, t: float) -> None:
        q, v, tau = self._joint_state()
        if self.base is None or not self.robot.nb:
            self._q, self._v = q, v
            return
        reading = self.reading
        time = t if isnan(self._time) else self._time
        self._q, self._v = self.base.update(time, q, v, reading.gyro, reading.acceleration, joint_tau=tau)

    def _asked(self, command: Command) -> Order:
        """The order that a command is."""
        robot, joint_map, joints = self.robot, self.joint_map, self._joints
        tau = np.nan_to_num(command.tau)[joints]
        v = command.v[-robot.nj :][joints]
        return Order(
            joint_map.position_to_device(command.q[-robot.nj :][joints]), joint_map.velocity_to_device(v),
            joint_map.torque_to_device(tau), *self._gains, gravity=self._gravity_torques(),
        )  # fmt: skip

    def _held(self) -> Order:
        """The order that holds the robot where it is, with the torques of the last order but for their damping."""
        last, q = self._order, self.reading.q
        return Order(q, 0.0, last.tau + last.kp * (last.q - q), *self._hold, gravity=self._gravity_torques())

    def _gravity_torques(self) -> Any:
        """What gravity asks of the motors (n,); 0 where the robot does not add it by itself."""
        if self._gravity is None:
            return 0.0
        self._gravity.update(0.0, self._q, np.zeros(self.robot.nv))
        return self.joint_map.torque_to_device(self._gravity.h[self.robot.nb :][self._joints])

    def _give(self, k: int, order: Order) -> None:
        """Send the order of tick k; now and then the guard is told what would hold the robot."""
        self._order = order
        self._send(order)
        if self.guard is not None and k % max(1, round(1.0 / (_TELL * self.dt))) == 0:
            self.guard.tell(self._held(), self.reading)

    def _send(self, order: Order) -> None:
        self.port.send(self.port.device.encode(order, self.reading))

    def _run(self, ended: str) -> Run:
        rate = self._rate
        counts = self._counts | {"late": rate.late, "missed": rate.missed, "worst_lateness": rate.worst}
        counts["guarded"] = self.guard is not None and self.guard.alive
        told = {"device": repr(self.port.device), "rate": 1.0 / self.dt, "ramp": self._ramp, "at_end": self._at_end}
        return self._recorder.run({"scenario": "loop", "ended": ended, "loop": told | counts})


#: What is counted of the states that come.
COUNTS = ("bad", "repeated", "out_of_order", "lost")
