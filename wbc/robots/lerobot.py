"""LeRobot: arms whose observations and actions are dictionaries of degrees. Not tried on hardware.

``robot.get_observation()`` and ``robot.send_action(action)`` of LeRobot take ``{"shoulder_pan.pos": 12.5}``; what is
not a position of one of the motors, such as a picture, is passed over. There are no torques and no velocities.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, final

import numpy as np

from wbc import checks
from wbc.robots.device import BadFrame, Device, Order, Reading, opened

SO101 = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")


@final
class LeRobot(Device):
    """An arm by positions in degrees, as with ``use_degrees=True``; ``motors`` default to those of an SO-101.

    A gripper that counts from 0 to 100 has a gear in its joint map.

    Example:
        >>> from wbc.robots import LeRobot
        >>> arm = LeRobot(["base", "elbow"])
        >>> arm.unpack({"base.pos": 10.0, "elbow.pos": -90.0, "camera": None}).q
        array([ 10., -90.])
    """

    rate = 50.0
    law: ClassVar[str] = "position"
    unit: ClassVar[str] = "deg"
    has_torque: ClassVar[bool] = False

    def __init__(self, motors: Sequence[str] = SO101) -> None:
        self.motors = checks.names("motors", motors)

    def encode(self, order: Order, reading: Reading) -> dict[str, float]:
        del reading
        return {f"{name}.pos": float(value) for name, value in zip(self.motors, order.q, strict=True)}

    def unpack(self, frame: Any) -> Reading:
        nothing = np.full(len(self.motors), np.nan)
        with opened(frame):
            return Reading(q=self._positions(frame), dq=nothing, tau=nothing)

    def decode(self, frame: Any, reading: Reading) -> Order:
        del reading
        with opened(frame):
            return Order(self._positions(frame))

    def report(self, reading: Reading) -> dict[str, float]:
        return self.encode(Order(reading.q), reading)

    def _positions(self, frame: Any) -> Any:
        if not isinstance(frame, Mapping):
            raise BadFrame(f"{checks.shown(frame)} is no dictionary of positions")
        if missing := [name for name in self.motors if f"{name}.pos" not in frame]:
            raise BadFrame(f"there is no {missing[0] + '.pos'!r} in what was observed")
        return checks.array("positions", [frame[f"{name}.pos"] for name in self.motors], (None,))
