"""Hands: who turns a robot and moves its joints in a check; in a dry run it is physics."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol, final

import numpy as np
import pinocchio

from wbc.robots.motor_board import MotorBoard, holding_gains
from wbc.types import Vec

#: How far a robot is turned, and a joint is moved against its motor, by hand [rad].
TURN, MOVE = 0.35, 0.15


class Hands(Protocol):
    """Who moves the robot by hand. Both begin something; ``done`` is called until it is true."""

    def move(self, joint: str) -> None:
        """Turn a joint by some 10 degrees towards larger angles and hold it there; "": let go."""

    def turn(self, axis: str) -> None:
        """Turn the base from its rest by some 20 degrees about its own x, y or z axis: right side down, nose down, to
        the left; and hold it there. "": bring it back."""

    def done(self) -> bool:
        """Whether it was done."""


@final
class BoardHands(Hands):
    """The hands of a dry run."""

    def __init__(self, board: MotorBoard) -> None:
        self.board = board
        self._doing: Iterator[None] = iter(())
        self._angle = np.zeros(3)

    def move(self, joint: str) -> None:
        self.board.hand[:] = 0.0
        self._doing = iter(())
        if joint:
            board = self.board
            k = board.joint_map.joints.index(joint)
            kp = board.joint_map.gain_from_device(np.broadcast_to(board.device.gains[0], len(board.device.motors)))[k]
            if board.device.law == "position":
                kp = holding_gains(board.plant.model)[0][board.plant.model.joint(joint)]
            self._doing = self._pushing(board.plant.model.joint(joint), MOVE * kp)

    def _pushing(self, joint: int, torque: float) -> Iterator[None]:
        # Slowly, so that joints whose inertias are coupled do not swing along.
        begun = self.board.plant.t
        while (t := self.board.plant.t - begun) < 1.0:
            self.board.hand[joint] = torque * min(1.0, 2.0 * t)
            yield

    def turn(self, axis: str) -> None:
        goal = TURN * np.array([axis == name for name in "xyz"])
        self._doing = self._turning(self._angle, goal)
        self._angle = goal

    def _turning(self, start: Vec, goal: Vec) -> Iterator[None]:
        for share in np.minimum(np.linspace(0.0, 1.2, 150), 1.0):
            self.board.tilt(pinocchio.exp3((1.0 - share) * start + share * goal))
            yield

    def done(self) -> bool:
        return next(self._doing, self) is self
