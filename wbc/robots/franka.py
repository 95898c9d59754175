"""Franka: torques at 1 kHz through ``pylibfranka``, to which the robot adds gravity. Not tried on hardware.

The robot compensates gravity by itself and stops with a reflex where a torque changes by more than 1 N m in a
millisecond (``kMaxTorqueRate`` of libfranka, 1000 N m/s). What is sent is therefore τ − g(q), within 1 N m of what was
sent last, which the robot's own state says (``tau_J_d``).
"""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple, final

import numpy as np

from wbc import checks
from wbc.robots.device import BadFrame, Device, Order, Reading, opened
from wbc.types import Vec


class FrankaState(NamedTuple):
    """The attributes of libfranka's ``RobotState`` that are read: [s], [rad], [rad/s], [N m], [N m]."""

    time: Any
    q: Any
    dq: Any
    tau_J: Any
    tau_J_d: Any


@final
class Franka(Device):
    """Panda or FR3 by torques: frames are arrays (7,) for ``Torques``, states have the names of ``RobotState``.

    ``prefix`` is that of the joints' names in the robot's description. Position and gains of an order become torques
    here, from the state that they answer to.

    Example:
        >>> import numpy as np
        >>> from wbc.robots import Franka
        >>> from wbc.robots.device import Order, Reading
        >>> arm = Franka()
        >>> state = arm.unpack(arm.report(Reading(q=np.zeros(7), dq=np.zeros(7), tau=np.zeros(7), time=0.0)))
        >>> arm.encode(Order(np.zeros(7), tau=10.0, gravity=9.5), state).tolist()  # 0.5 more than gravity
        [0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5]
        >>> arm.encode(Order(np.zeros(7), tau=50.0), state)[0]  # not more than 1 N m in one millisecond
        np.float64(0.999999)
    """

    rate = 1000.0
    gains = (
        np.array([100.0, 100.0, 100.0, 100.0, 50.0, 30.0, 10.0]),
        np.array([10.0, 10.0, 10.0, 10.0, 5.0, 3.0, 1.0]),
    )
    law: ClassVar[str] = "torque"
    adds_gravity: ClassVar[bool] = True
    torque_rate: ClassVar[float] = 1000.0 - 1e-3

    def __init__(self, prefix: str = "panda_joint") -> None:
        self.motors = tuple(f"{checks.text('prefix', prefix)}{i}" for i in range(1, 8))

    def encode(self, order: Order, reading: Reading) -> Vec:
        most = self.torque_rate / self.rate
        torque = order.torque(reading.q, reading.dq) - order.gravity
        sent: Vec = np.clip(torque, reading.sent - most, reading.sent + most)
        return sent

    def unpack(self, frame: Any) -> Reading:
        with opened(frame):
            time = frame.time.to_sec() if hasattr(frame.time, "to_sec") else frame.time
            names = "q", "dq", "tau_J", "tau_J_d"
            q, dq, tau, sent = (checks.array(name, getattr(frame, name), (7,)) for name in names)
            return Reading(q=q, dq=dq, tau=tau, time=float(time), sent=sent)

    def decode(self, frame: Any, reading: Reading) -> Order:
        with opened(frame):
            torque = checks.array("torques", frame, (7,))
        most = np.abs(torque - reading.sent).max() if len(reading.sent) else 0.0
        if most > 1.0 + 1e-9:
            raise BadFrame(f"a torque changes by {most:.3g} N m from one frame to the next; at most 1 N m is allowed")
        return Order(reading.q, tau=torque)

    def report(self, reading: Reading) -> FrankaState:
        sent = reading.sent if len(reading.sent) else np.zeros(7)
        return FrankaState(reading.time, reading.q, reading.dq, reading.tau, sent)
