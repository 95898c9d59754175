"""One robot, one stack, one motion, driven in a closed loop without physics.

The loop is closed by integrating the answer: q ⊕ dt v at the velocity level, q ⊕ dt (v + ½ dt a) and v + dt a where
accelerations are the unknowns. It is deterministic, so tick k does the same work in each repeat and the least of its
times is the work without the machine's interruptions.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, final

import numpy as np

from wbc.stack.formulation import Formulation
from wbc.stack.stack import Stack
from wbc.types import Vec

from .robots import MadeRobot, RobotRecipe

Progress = Callable[[int, int], None]


@final
@dataclass(frozen=True)
class Record:
    """What happened in one closed loop of N ticks.

    q (N + 1, nq) and v (N + 1, nv) are the states, the last one behind the last tick; a (N, nv), tau (N, nj) and
    forces (N, contacts, 3 or 6) the answers where the level has them; nanoseconds (N,) and solved (N,) of the ticks.
    """

    q: Vec
    v: Vec
    a: Vec
    tau: Vec
    forces: Vec
    nanoseconds: Any
    solved: Any

    @classmethod
    def empty(cls, made: MadeRobot, ticks: int, contacts: int, rows: int) -> Record:
        """Memory for a run that starts where the robot starts, at rest."""
        robot = made.robot
        record = cls(
            q=np.zeros((ticks + 1, robot.nq)), v=np.zeros((ticks + 1, robot.nv)), a=np.zeros((ticks, robot.nv)),
            tau=np.zeros((ticks, robot.nj)), forces=np.zeros((ticks, contacts, rows)),
            nanoseconds=np.zeros(ticks, np.int64), solved=np.zeros(ticks, bool),
        )  # fmt: skip
        record.q[0] = made.q0
        return record

    @property
    def ticks(self) -> int:
        """Number of ticks."""
        return len(self.nanoseconds)


@final
@dataclass(frozen=True)
class Problem:
    """What a workload asks of a robot: the stack, the frames it reads, and how its result is judged."""

    stack: Stack
    frames: Sequence[str]
    judge: Callable[[Record], dict[str, Any]]


class ClosedLoop(ABC):
    """What is run: a robot, the stack that it is given, at which level and how often it ticks."""

    name: ClassVar[str]
    title: ClassVar[str]
    recipe: ClassVar[RobotRecipe]
    level: ClassVar[Formulation]
    dt: ClassVar[float]
    ticks: ClassVar[int]

    @abstractmethod
    def problem(self, made: MadeRobot, ticks: int) -> Problem:
        """Stack and references for a run of so many ticks."""
