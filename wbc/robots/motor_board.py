"""MotorBoard: a plant behind the frames of a device, so that a controller that runs here runs through the same bytes.

In every step of the plant, each motor gives

    τ = w (τ* + kp (q* − q) + kd (q̇* − q̇)) + (1 − w) τ_own

with the last order that arrived and its weight w (1 where a device has none); τ_own keeps the posture in which the
board was started, as a robot's own controller does, also before the first order and for joints that the device does not
drive. τ is cut at the torque limits; states say what failing actuators leave of it. Orders arrive ``delay`` late and
states leave ``state_delay`` late. When no order has come for ``timeout``, motors hold on to the last one ("hold"),
brake by their own damping ("damp") or give nothing ("limp"): no maker says what real boards do then. A frame that the
robot would not take is dropped, and counts in ``refused``; ``why`` says what was wrong with the last one.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import Any, final

import numpy as np
import pinocchio

from wbc import checks
from wbc.arguments import TellsArguments
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel
from wbc.robots.device import BadFrame, Device, Order, Reading, rotation
from wbc.robots.joint_map import JointMap
from wbc.robots.sensors import SENSORS, Errors, Sensors, felt
from wbc.sim.disturbance import Delay, Disturbance, Effect, listed
from wbc.sim.plant import Delivered, Drive, Plant
from wbc.stack.tracking import rotation_target
from wbc.types import Mat, Vec

ON_TIMEOUT = ("hold", "damp", "limp")
#: A motor that keeps a posture gives all of its torque at this error [rad, m]; damping is stiffness times this [s].
DEFLECTION, DAMPING_TIME = 0.15, 0.03


def holding_gains(robot: RobotModel) -> tuple[Vec, Vec]:
    """Stiffness [N m/rad] and damping [N m s/rad] (nj,) with which motors keep a posture.

    Raises:
        InvalidInput: a joint without torque limit.
    """
    most = robot.limits.tau_max
    if not np.isfinite(most).all():
        endless = robot.joint_names[int(np.isfinite(most).argmin())]
        raise InvalidInput(f"joint {endless!r} has no torque limit to take a stiffness from")
    return most / DEFLECTION, most / DEFLECTION * DAMPING_TIME


@final
class MotorBoard(metaclass=TellsArguments):
    """A port (:class:`~wbc.robots.port.Port`) to a plant; its clock is the plant's, which moves while one sleeps.

    Args:
        device: the device whose frames it takes and makes.
        plant: takes torques; its step is the period of the motors' law, 1 ms or less.
        joint_map: which motor of the device drives which joint; default: that of equal names.
        delay, state_delay: how late orders and states arrive [s].
        timeout: how long an order counts [s].
        on_timeout: "hold", "damp" or "limp", as above.
        disturbances: pushes, payloads and failing actuators, as for :func:`wbc.sim.simulate.simulate`.
        sensors: noise and biases of joints, torques and IMU; its quaternion is off by ``tilt``. Default: exact ones.
            How late states are is ``state_delay``, not theirs.
        imu: rotation (3, 3) from the axes of the IMU to those of the base.
        feet: links whose normal forces the device's foot sensors measure, in its order.
        mode_machine: the value that a G1 expects back in its orders.
        seed: of the noises.

    Raises:
        InvalidInput: an argument out of range; a plant that takes something other than torques; a map of another
            device's motors; a disturbance that is a delay or acts on sensors, which are arguments of the board.

    Example:
        >>> import numpy as np, wbc
        >>> from wbc.robots import Franka, MotorBoard
        >>> from wbc.robots.device import Order
        >>> from wbc.sim.plant import ForwardDynamicsPlant
        >>> robot, arm = wbc.load("arm"), Franka()
        >>> names = dict(zip(robot.joint_names, arm.motors))
        >>> board = MotorBoard(arm, ForwardDynamicsPlant(robot), joint_map=arm.joint_map(robot, names=names))
        >>> board.sleep(0.01)
        >>> arm.unpack(board.receive()).time
        0.01
    """

    shared = False

    def __init__(
        self,
        device: Device,
        plant: Plant,
        *,
        joint_map: JointMap | None = None,
        delay: float = 0.0,
        state_delay: float = 0.0,
        timeout: float = 0.1,
        on_timeout: str = "damp",
        disturbances: Iterable[Disturbance] = (),
        sensors: Sensors | None = None,
        imu: Any = None,
        feet: Iterable[str] = (),
        mode_machine: int = 0,
        seed: int = 0,
    ) -> None:
        device = checks.instance("device", device, Device, "a device, as UnitreeG1()")
        robot = checks.instance("plant", plant, Plant, "a plant, as MujocoPlant(robot)").model
        if plant.takes != "torque":
            raise InvalidInput(f"{type(plant).__name__} takes {plant.takes}s; motors give torques")
        self.device, self.plant = device, plant
        self.joint_map = device.accepted(joint_map, robot)
        self._delay = checks.number("delay", delay, low=0.0)
        self._state_delay = checks.number("state_delay", state_delay, low=0.0)
        self._timeout = checks.number("timeout", timeout, low=0.0, strict=True)
        self._on_timeout = checks.one_of("on_timeout", on_timeout, ON_TIMEOUT)
        sensors = SENSORS["exact"] if sensors is None else checks.instance("sensors", sensors, Sensors, "a Sensors")
        self._errors = Errors(sensors, 1.0 / device.rate, checks.seed("seed", seed))
        self.imu: Mat = np.eye(3) if imu is None else rotation_target("imu", imu, strict=True)
        self._feet, self._mode = checks.items("feet", feet, "names of links"), mode_machine
        felt: Any = plant.wrenches() if hasattr(plant, "wrenches") else {}
        for link in self._feet:
            if not isinstance(link, str) or link not in felt:
                raise InvalidInput(f"feet: the plant knows no contact force of {checks.shown(link)}")
        self._joints = np.array([robot.joint(name) for name in self.joint_map.joints])
        self._stiffness, self._damping = holding_gains(robot)
        self._at_rest = robot.state()
        self._own = plant.q[-robot.nj :].copy()
        self._effects = []
        for one in listed(disturbances):
            effect = one.begin(plant)
            if isinstance(one, Delay) or type(effect).measure is not Effect.measure:
                raise InvalidInput(f"{one}: give a motor board delay=, state_delay= and sensors= instead")
            self._effects.append(effect)
        self._attitude: Mat = np.eye(3)
        #: Torques (nj,) on the joints from outside, as of a hand that moves them; no motor's limit cuts them.
        self.hand: Vec = np.zeros(robot.nj)
        self.refused, self.why = 0, ""
        self._order: Order | None = None
        self._ordered = 0.0
        self._tau: Vec = np.zeros(robot.nj)
        self._coming: deque[tuple[float, Any]] = deque()
        self._going: deque[tuple[float, Any]] = deque()
        self._due, self._ahead = plant.t + 1.0 / device.rate, 0.0
        self._seen = self._moves()
        self._last = self._read()

    # ---- the port
    def receive(self) -> Any | None:
        """The newest state that has arrived and was not received yet, or None."""
        frame = None
        while self._going and self._going[0][0] <= self.plant.t + 1e-9:
            frame = self._going.popleft()[1]
        return frame

    def send(self, frame: Any) -> None:
        """Put an order on its way."""
        self._coming.append((self.plant.t + self._delay, frame))

    def clock(self) -> float:
        """The plant's time [s], plus the remainder of the last sleep."""
        return self.plant.t + self._ahead

    def sleep(self, seconds: float) -> None:
        """Let the plant move for so long, in whole steps; the remainder, at most half a step, is added next time.

        Raises:
            SimulationError: the plant diverged. InvalidInput: a time that is negative or not finite.
        """
        self._ahead += checks.number("seconds", seconds, low=0.0)
        while self._ahead > 0.5 * self.plant.dt:
            self._ahead -= self.plant.dt
            self._step()

    # ---- a step
    def _step(self) -> None:
        plant = self.plant
        while self._coming and self._coming[0][0] <= plant.t + 1e-9:
            self._take(self._coming.popleft()[1])
        most, still = plant.model.limits.tau_max, np.zeros(plant.model.nv)
        given: Drive = Delivered(np.clip(self._torques(), -most, most), still, still, plant.q)
        for effect in self._effects:
            effect.push(plant.t)
            given = effect.deliver(given)
        self._tau = given.tau
        if self.hand.any():
            plant.push_joints(self.hand)
        plant.step(Delivered(self._tau, still, still, plant.q))
        if plant.t > self._due - 1e-9:
            self._due += 1.0 / self.device.rate
            self._last = self._read()
            self._going.append((plant.t + self._state_delay, self.device.report(self._last)))

    def _take(self, frame: Any) -> None:
        try:
            self._order, self._ordered = self.device.decode(frame, self._last), self.plant.t
        except BadFrame as cause:
            self.refused, self.why = self.refused + 1, str(cause)

    def _torques(self) -> Vec:
        """What the motors of all joints give (nj,) [N m]."""
        robot, joints = self.plant.model, self._joints
        q, v = self.plant.q[-robot.nj :], self.plant.v[-robot.nj :]
        tau: Vec = self._stiffness * (self._own - q) - self._damping * v
        order = self._order
        if order is None:
            return tau
        late = self.plant.t - self._ordered > self._timeout + 1e-9
        if late and self._on_timeout != "hold":
            tau[joints] = -self._damping[joints] * v[joints] if self._on_timeout == "damp" else 0.0
            return tau
        joint_map = self.joint_map
        if self.device.law == "position":
            wanted = joint_map.position_from_device(order.q)
            asked = self._stiffness[joints] * (wanted - q[joints]) - self._damping[joints] * v[joints]
        else:
            p, dp = joint_map.position_to_device(q[joints]), joint_map.velocity_to_device(v[joints])
            asked = joint_map.torque_from_device(order.torque(p, dp))
        if self.device.adds_gravity:
            asked = asked + self._gravity()[joints]
        tau[joints] = order.weight * asked + (1.0 - order.weight) * tau[joints]
        return tau

    def _gravity(self) -> Vec:
        robot = self.plant.model
        self._at_rest.update(self.plant.t, self.plant.q, np.zeros(robot.nv))
        gravity: Vec = self._at_rest.h[robot.nb :]
        return gravity

    # ---- what the sensors say
    def _read(self) -> Reading:
        plant, robot, joint_map, joints = self.plant, self.plant.model, self.joint_map, self._joints
        q, v = self._errors.joints(plant.q[-robot.nj :], plant.v[-robot.nj :])
        tau = self._errors.torques(self._tau)
        sensed: dict[str, Any] = {}
        if self.device.has_imu:
            sensed |= self._imu()
        if self._feet:
            wrenches: Any = plant.wrenches()  # type: ignore[attr-defined]
            sensed["feet"] = np.rint([wrenches[link][2] for link in self._feet])
        if self.device.adds_gravity:
            sensed["sent"] = self._sent()
        return Reading(
            q=joint_map.position_to_device(q[joints]), dq=joint_map.velocity_to_device(v[joints]),
            tau=joint_map.torque_to_device(tau[joints]), time=plant.t, mode_machine=self._mode, **sensed,
        )  # fmt: skip

    def _sent(self) -> Vec:
        return np.zeros(len(self.device.motors)) if self._order is None else self._order.tau

    def _imu(self) -> dict[str, Vec]:
        """Orientation, mean rate and mean specific force since the last state, in the axes of the IMU."""
        before, self._seen = self._seen, self._moves()
        said = self._errors.imu(felt(before, self._seen, 1.0 / self.device.rate, self.plant.model.gravity))
        told = self._seen[0] @ self.imu.T @ pinocchio.exp3(self._errors.lean) @ self.imu
        return {
            "quaternion": np.array(pinocchio.Quaternion(told).coeffs()), "gyro": said[:3], "acceleration": said[3:],
        }  # fmt: skip

    def _moves(self) -> tuple[Mat, Vec]:
        """Rotation (3, 3) of the IMU and velocity (3,) [m/s] of the base, where it sits, world axes."""
        plant = self.plant
        if not plant.model.nb:
            return self._attitude @ self.imu, np.zeros(3)
        base = rotation(plant.q[3:7])
        return base @ self.imu, base @ plant.v[:3]

    def tilt(self, attitude: Mat) -> None:
        """Hold a robot with a fixed base at this rotation (3, 3) in the world, as hands do; physics sees gravity turn.

        Raises:
            InvalidInput: a floating base, another plant than :class:`~wbc.sim.mujoco_.MujocoPlant`, or no rotation.
        """
        if self.plant.model.nb:
            raise InvalidInput("only a base that is fixed can be held at an angle")
        physics: Any = getattr(self.plant, "physics", None)
        if physics is None:
            raise InvalidInput(f"{type(self.plant).__name__} has a gravity that cannot be turned; use MujocoPlant")
        self._attitude = rotation_target("attitude", attitude, strict=True)
        physics.opt.gravity[:] = self._attitude.T @ self.plant.model.gravity

    def __repr__(self) -> str:
        return f"MotorBoard({self.device!r}, {self.plant!r})"
