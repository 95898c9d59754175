"""Faults injected into a running controller, counted: ``python -m tests.reliability.injected [FAULTS] [CHANGES]``."""

from __future__ import annotations

import sys
from collections import Counter
from typing import Any, NamedTuple

import numpy as np

import wbc
from tests.reliability.faults import FAULTS, excess, limited, sabotaged
from tests.stack.conftest import feet
from wbc.models.model import RobotState
from wbc.stack.component import Schedule

LEVELS = {"arm": wbc.VelocityLevel(), "quadruped": wbc.InverseDynamics(), "humanoid": wbc.InverseDynamics()}


class Tally(NamedTuple):
    """How many, how many of them badly answered, and by which fallback levels."""

    count: int
    bad: int
    fallback_levels: Counter[str]


def faults(name: str, count: int, *, seed: int = 0, other: bool = True) -> Tally:
    """``count`` faults of every kind at random ticks; with ``other`` False the solver that is asked next has them too.

    Badly answered: not in the same tick, not finite, or beyond what the limits leave by more than 1e-6.
    """
    rng, robot, level = np.random.default_rng(seed), wbc.load(name), LEVELS[name]
    control, script = sabotaged(robot, level, other=other)
    q, v, t = np.array(robot.q0), np.zeros(robot.nv), 0.0
    bad, done, fallback_levels = 0, 0, Counter[str]()
    while done < count:
        script.fault = str(rng.choice(FAULTS[:-1])) if rng.uniform() < 0.3 else ""
        command = control.tick(t, q, v)
        if script.fault:
            done += 1
            fallback_levels[command.fallback_level] += 1
            bad += not excess(control, command) <= 1e-6
        q, v, t = np.array(command.q), np.array(command.v), t + control.dt
        if np.abs(q[-robot.nj :] - robot.q0[-robot.nj :]).max() > 1.0 or rng.uniform() < 0.01:
            q, v = np.array(robot.q0), np.zeros(robot.nv)
            control.reset()
    return Tally(count, bad, fallback_levels)


class Whim(Schedule):
    """Which feet hold, if any, is drawn anew every few ticks."""

    def __init__(self, frames: list[str], rng: np.random.Generator) -> None:
        super().__init__(name="whim")
        self._frames, self._rng = frames, rng
        self.changes, self._now = 0, tuple(frames)

    def contact_sets(self) -> Any:
        sets = [()]
        for frame in self._frames:
            sets += [(*chosen, frame) for chosen in sets]
        return sets

    def contacts(self, state: RobotState, last: object) -> Any:
        if last is not None and self._rng.uniform() < 0.5:
            drawn = tuple(frame for frame in self._frames if self._rng.uniform() < 0.6)
            if drawn != self._now:
                self._now, self.changes = drawn, self.changes + 1
        return self._now


def contact_changes(name: str, count: int, *, seed: int = 0) -> Tally:
    """``count`` random changes of the feet that hold, on a robot that is put back to its stance now and then.

    Badly answered: no certified answer, or a number that is not finite.
    """
    rng, robot = np.random.default_rng(seed), wbc.load(name)
    level, soles = LEVELS[name], feet(robot)
    whim = Whim([sole.frame for sole in soles], rng)
    quiet = limited(robot, level)
    stack = wbc.Stack(quiet.tasks, contacts=quiet.contacts, subject_to=quiet.subject_to[3:], components=[whim])
    control = wbc.Controller(robot, stack, level=level)
    q, v, t = np.array(robot.q0), np.zeros(robot.nv), 0.0
    bad, ticks, fallback_levels = 0, 0, Counter[str]()
    while whim.changes < count:
        command = control.tick(t, q, v)
        fallback_levels[command.fallback_level] += 1
        bad += not command.certificate.ok or not np.isfinite(np.r_[command.tau, command.a, command.q]).all()
        q, v, t, ticks = np.array(command.q), np.array(command.v), t + control.dt, ticks + 1
        if ticks % 20 == 0:
            step = rng.uniform(0.0, 0.1) * rng.normal(size=robot.nv)
            q, v = robot.integrate(robot.q0, step), rng.uniform(0.0, 0.3) * rng.normal(size=robot.nv)
    assert control.plans.unplanned == 0
    return Tally(count, bad, fallback_levels)


def main() -> int:
    """Print a row for each robot; the exit code is the number of bad answers."""
    number, changes = (int(sys.argv[k]) if len(sys.argv) > k else default for k, default in ((1, 1000), (2, 10_000)))
    bad = 0
    for name in LEVELS:
        for other in (True, False):
            found = faults(name, number, other=other)
            bad += found.bad
            print(f"{name}, faults in {'one solver' if other else 'both solvers'}: {found}", flush=True)
    for name in ("quadruped", "humanoid"):
        found = contact_changes(name, changes // 2)
        bad += found.bad
        print(f"{name}, changes of contact: {found}", flush=True)
    return min(bad, 100)


if __name__ == "__main__":
    sys.exit(main())
