"""Ros2Control: a group of joints behind ``forward_command_controller``, by effort or position. Not tried on hardware.

Commands are the ``data`` of ``std_msgs/Float64MultiArray`` on the controller's ``~/commands``, in the order of its
parameter ``joints``. States are ``sensor_msgs/JointState``, whose own order is read **by name**.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, final

import numpy as np

from wbc import checks
from wbc.robots.device import BadFrame, Device, Order, Reading, opened
from wbc.types import Vec

INTERFACES = ("effort", "position")


@final
class Ros2Control(Device):
    """A ``forward_command_controller`` of ``ros2_control``, on one ``interface``: "effort" or "position".

    ``joints`` is the controller's parameter of that name; ``adds_gravity`` says whether the hardware compensates
    gravity by itself; ``gains`` (stiffness, damping) hold each joint still in a check. Messages are anything that has
    the fields of the ROS messages.

    Example:
        >>> from types import SimpleNamespace
        >>> from wbc.robots import Ros2Control
        >>> group = Ros2Control(["shoulder", "elbow"], interface="position")
        >>> group.unpack(SimpleNamespace(name=["elbow", "shoulder"], position=[0.2, 0.1], velocity=[], effort=[])).q
        array([0.1, 0.2])
    """

    def __init__(
        self,
        joints: Sequence[str],
        *,
        interface: str = "effort",
        rate: float = 500.0,
        adds_gravity: bool = False,
        gains: tuple[Any, Any] = (20.0, 1.0),
    ) -> None:
        self.motors = checks.names("joints", joints)
        self.law = "torque" if checks.one_of("interface", interface, INTERFACES) == "effort" else "position"  # type: ignore[misc]
        self.rate = checks.number("rate", rate, low=0.0, strict=True)
        self.adds_gravity = checks.truth("adds_gravity", adds_gravity)  # type: ignore[misc]
        gains = checks.pair("gains", gains, "stiffness, damping")
        self.gains = tuple(checks.gains("gains", gain, len(self.motors)) for gain in gains)  # type: ignore[assignment]

    def encode(self, order: Order, reading: Reading) -> Vec:
        if self.law == "position":
            position: Vec = order.q.copy()
            return position
        gravity = order.gravity if self.adds_gravity else 0.0
        torque: Vec = order.torque(reading.q, np.nan_to_num(reading.dq)) - gravity
        return torque

    def unpack(self, frame: Any) -> Reading:
        with opened(frame):
            names = list(frame.name)
            if missing := [joint for joint in self.motors if joint not in names]:
                raise BadFrame(f"the joint state has no {missing[0]!r}; it has {', '.join(names)}")
            order = [names.index(joint) for joint in self.motors]
            values = {}
            for name in ("position", "velocity", "effort"):
                given = np.asarray(getattr(frame, name), dtype=np.float64)
                values[name] = given[order] if len(given) == len(names) else np.full(len(order), np.nan)
            stamp = getattr(getattr(frame, "header", None), "stamp", None)
            time = 0.0 if stamp is None else stamp.sec + 1e-9 * stamp.nanosec
            time = time or float("nan")  # 0 is what ROS has where nobody set a time
            return Reading(q=values["position"], dq=values["velocity"], tau=values["effort"], time=time)

    def decode(self, frame: Any, reading: Reading) -> Order:
        with opened(frame):
            data = checks.array("data", frame, (len(self.motors),))
            return Order(data) if self.law == "position" else Order(reading.q, tau=data)

    def report(self, reading: Reading) -> SimpleNamespace:
        seconds = 0.0 if np.isnan(reading.time) else reading.time
        stamp = SimpleNamespace(sec=int(seconds), nanosec=round(1e9 * (seconds - int(seconds))))
        return SimpleNamespace(
            header=SimpleNamespace(stamp=stamp), name=list(self.motors), position=reading.q.tolist(),
            velocity=reading.dq.tolist(), effort=reading.tau.tolist(),
        )  # fmt: skip
