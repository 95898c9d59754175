"""A robot that does what it is told, tick by tick."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import wbc
from wbc.types import Vec


def obeyed(
    controller: wbc.Controller, ticks: int, q: Vec | None = None, v: Vec | None = None
) -> Iterator[tuple[Vec, Vec]]:
    """The states that certified commands lead to, from the home configuration at rest unless said otherwise."""
    robot = controller.model
    q, v = robot.q0 if q is None else q, np.zeros(robot.nv) if v is None else v
    for k in range(ticks):
        command = controller.tick(k * controller.dt, q, v)
        assert command.status.ok, controller.explain()
        q, v = command.q, command.v
        yield q, v
