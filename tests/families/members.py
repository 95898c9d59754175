"""Random stacks of all members of the library against an independent oracle: ``python -m tests.families.members``.

Tasks, constraints and contacts are drawn from what each class shows as its samples, on three robots, at every level and
under every hierarchy; tasks also as constraints, exact or within a range, limits also soft. While the loop runs, tasks
are switched off and on, weights and gains change, and stacks are replaced.
"""

from __future__ import annotations

import contextlib
from functools import cache
from typing import Any

import numpy as np

import tasks
import wbc
from tests.families.oracle import undamped
from tests.families.progress import Family, Ticks
from wbc.errors import WbcError
from wbc.qp.solvers import usable
from wbc.stack.constraint import Constraint
from wbc.stack.contact import Contact
from wbc.stack.task import Objective, Task
from wbc.testing import robots

SOLVERS = ("pdas", "pdas", "pdas", "daqp", "proxqp", "piqp", "osqp", "clarabel")
LEVELS = (wbc.VelocityLevel(), wbc.AccelerationLevel(), wbc.InverseDynamics())
HIERARCHIES = (wbc.Weighted(), wbc.Strict(), wbc.Scaled())


@cache
def classes(kind: type) -> list[Any]:
    """The members of a kind that have samples, in the order of their names."""
    found = [value for _, value in sorted(vars(tasks).items()) if isinstance(value, type) and issubclass(value, kind)]
    return [value for value in dict.fromkeys(found) if any(samples(value, i) for i in range(len(robots())))]


def samples(member: Any, robot: int) -> list[Any]:
    """New members of this class for a robot."""
    try:
        return list(member.samples(robots()[robot]))
    except TypeError:  # an abstract class
        return []


def some(kind: type, robot: int, rng: np.random.Generator, most: int) -> list[Any]:
    """At most ``most`` members, of classes that may repeat."""
    found = []
    for _ in range(int(rng.integers(0, most + 1))):
        known = classes(kind)
        here = samples(known[rng.integers(len(known))], robot)
        if here:
            found.append(here[rng.integers(len(here))])
    return found


def constrained(task: Any, rng: np.random.Generator) -> Any:
    """A task as a constraint."""
    return task.exactly() if rng.uniform() < 0.5 else task.within(float(10.0 ** rng.uniform(-3.0, 0.0)))


def stack(robot: int, rng: np.random.Generator) -> wbc.Stack:
    """One to six tasks in levels, up to three limits and contacts."""
    wanted = some(Objective, robot, rng, 5)
    posture = tasks.Posture(robots()[robot].q0, weight=float(10.0 ** rng.uniform(-4, 1)))
    for task in wanted:
        if rng.uniform() < 0.3 and isinstance(task, Task):
            with contextlib.suppress(WbcError):
                task.weight = float(10.0 ** rng.uniform(-4, 4))
    limits = [limit.softly() if rng.uniform() < 0.2 else limit for limit in some(Constraint, robot, rng, 3)]
    bound = [task for task in wanted if isinstance(task, Task) and rng.uniform() < 0.1]
    limits += [constrained(task, rng) for task in bound]
    wanted = [task for task in wanted if not any(task is other for other in bound)] + [posture]
    cuts = sorted(set(rng.integers(1, len(wanted) + 1, size=rng.integers(0, 3)).tolist()))
    levels = [list(part) for part in np.split(np.array(wanted, dtype=object), cuts) if len(part)]
    return wbc.Stack(levels, contacts=some(Contact, robot, rng, 3), subject_to=limits)


def draw(seed: int) -> tuple[wbc.Controller, str, np.random.Generator, int]:
    """A controller and what it is; combinations that are refused while building are drawn again."""
    rng = np.random.default_rng(seed)
    while True:
        robot = int(rng.integers(len(robots())))
        hierarchy, level = HIERARCHIES[rng.integers(3)], LEVELS[rng.integers(3)]
        solver = SOLVERS[rng.integers(len(SOLVERS))]
        solver = solver if solver in usable() else "pdas"
        with contextlib.suppress(WbcError):
            control = wbc.Controller(
                robots()[robot], stack(robot, rng), level=undamped(level, hierarchy), hierarchy=hierarchy, solver=solver
            )
            return control, f"{type(level).__name__} {type(hierarchy).__name__}", rng, robot


def change(control: wbc.Controller, rng: np.random.Generator, robot: int) -> None:
    """What users do between ticks."""
    listed = [task for level in control.stack.levels for task in level]
    task = listed[rng.integers(len(listed))]
    way = rng.integers(4)
    with contextlib.suppress(WbcError):
        if way == 0:
            task.active = not task.active
        elif way == 1:
            task.weight = float(10.0 ** rng.uniform(-4, 4))
        elif way == 2 and hasattr(task, "kp"):
            task.kp = float(10.0 ** rng.uniform(-1, 2))
        elif way == 3:
            control.replace(stack(robot, rng))


def ticked(case: int, ticks: int) -> Ticks:
    """The controller, each of its commands, and what it is."""
    control, kind, rng, robot = draw(case)
    model = robots()[robot]
    q, v = model.integrate(model.q0, 0.1 * rng.normal(size=model.nv)), 0.1 * rng.normal(size=model.nv)
    for tick in range(ticks):
        if tick % 5 == 4:
            change(control, rng, robot)
        decided = control.tick(1e-3 * tick, q, v)
        yield control, decided, kind
        q, v = decided.q, decided.v
        if not np.isfinite(q).all() or np.abs(v).max() > 1e3:
            return


def played(case: int, tick: int) -> tuple[wbc.Controller, wbc.Command]:
    """The controller at this tick of a case, and its command."""
    *_, (control, decided, _) = ticked(case, tick + 1)
    return control, decided


FAMILY = Family(ticked, every=5)

if __name__ == "__main__":
    FAMILY.command(__doc__, ticks=20)
