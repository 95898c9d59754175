"""Random stacks on legs against an independent oracle: ``python -m tests.families.legs --count 1000 --seed 1``.

``--first K`` goes on from case K of this seed; what was found so far is printed every minute.

Humanoids and quadrupeds on points, lines and soles, in mild and wild states, friction from 1e-6 to 1.5, weights from
1e-6 to 1e6, under every hierarchy, with every solver that may run in a loop.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

import tasks as T
import wbc
from tests.families.oracle import undamped
from tests.families.progress import Family, Ticks, followed
from wbc.qp.solvers import usable

#: The first stands for the compiled tick. One that is not installed is replaced by the default.
SOLVERS = ("pdas", "pdas", "daqp", "proxqp", "piqp", "osqp", "clarabel", "quadprog")
HIERARCHIES = (wbc.Weighted(), wbc.Strict(), wbc.Scaled())
_HANDS = {"humanoid": ("left_hand", "right_hand", "head"), "quadruped": ("trunk", "front_left_foot", "rear_right_foot")}


@cache
def robot_named(name: str) -> Any:
    """The robot, loaded once."""
    return wbc.load(name)


def contacts(robot: Any, rng: np.random.Generator) -> list[Any]:
    """Some of the feet, each on a point, a line or a sole."""
    names = list(robot.feet)
    least = 1 if len(names) == 2 else 2
    chosen = rng.permutation(names)[: rng.integers(least, len(names) + 1)]
    friction = 0.5 if rng.uniform() < 0.5 else float(10.0 ** rng.uniform(-6.0, np.log10(1.5)))
    kind = str(rng.choice(["point", "line", "sole"]))
    found: list[Any] = []
    for frame in map(str, chosen):
        if kind == "point":
            found.append(T.Point(frame, friction=friction))
        elif kind == "line":
            found.append(T.Edge(frame, half_length=0.05, friction=friction))
        else:
            found.append(T.Sole(frame, half_size=(0.11, 0.05), friction=friction))
    return found


def stack(name: str, rng: np.random.Generator, *, wild: bool) -> wbc.Stack:
    """Tasks in one to four levels, ordinary or extreme weights, any of three limits."""
    robot, state = robot_named(name), robot_named(name).state()
    extreme = rng.uniform() < 0.3

    def weight(usual: float) -> float:
        return float(10.0 ** rng.uniform(-6.0, 6.0)) if extreme else usual

    reach = 1.0 if wild else 0.1
    tasks: list[Any] = [
        T.CenterOfMass(target=state.com + reach * rng.normal(size=3) * 0.3, kp=100, weight=weight(1.0)),
        T.Orientation(robot.frame_names[0], target=np.eye(3), kp=100, weight=weight(0.1)),
    ]
    for frame in rng.permutation(_HANDS[name])[: rng.integers(0, 3)]:
        target = state.frame(str(frame)).position + reach * rng.normal(size=3)
        tasks.append(T.Position(str(frame), target=target, kp=100, weight=weight(1.0)))
    tasks = [tasks[i] for i in rng.permutation(len(tasks))]
    cuts = sorted(set(rng.integers(1, len(tasks) + 1, size=rng.integers(0, 3)).tolist()))
    levels = [list(part) for part in np.split(np.array(tasks, dtype=object), cuts) if len(part)]
    posture = T.Posture(robot.q0, kp=10, weight=weight(1e-3))
    if rng.uniform() < 0.8:
        levels.append([posture])
    else:
        levels[-1].append(posture)
    limits = [
        limit for limit in (T.TorqueLimits(), T.JointVelocityLimits(), T.JointPositionLimits()) if rng.uniform() < 0.8
    ]
    return wbc.Stack(levels, contacts=contacts(robot, rng), subject_to=limits)


def draw(seed: int) -> tuple[wbc.Controller, np.ndarray, np.ndarray, str]:
    """A controller, a state and what it is."""
    rng = np.random.default_rng(seed)
    name, wild = str(rng.choice(["humanoid", "quadruped"])), bool(rng.uniform() < 0.4)
    robot = robot_named(name)
    hierarchy = HIERARCHIES[rng.integers(3)]
    index = int(rng.integers(len(SOLVERS)))
    solver = SOLVERS[index] if SOLVERS[index] in usable() else "pdas"
    made = stack(name, rng, wild=wild)
    control = wbc.Controller(
        robot, made, level=undamped(wbc.InverseDynamics(), hierarchy), hierarchy=hierarchy, solver=solver
    )  # fmt: skip
    noise, speed = (1.0, 3.0) if wild else (0.1, 0.1)
    q = robot.integrate(robot.q0, noise * rng.normal(size=robot.nv) * ([0.1] * 6 + [1.0] * robot.nj))
    v = speed * rng.normal(size=robot.nv)
    kind = type(hierarchy).__name__
    return control, q, v, f"{kind} {solver}"


def ticked(case: int, ticks: int) -> Ticks:
    """The controller, each of its commands, and what it is."""
    yield from followed(*draw(case), ticks)


FAMILY = Family(ticked)

if __name__ == "__main__":
    FAMILY.command(__doc__, ticks=2)
