"""Soak: very many ticks of one controller, each command judged by constraints written anew here.

    valid    the robot does what it is told, targets change every 500 ticks, some of them out of reach
    fuzz     states, times, targets and weights with NaN, ±inf, 1e±300, denormals and plain nonsense among them; a
             component that gives nonsense or raises, and targets that are functions and do so
    starts   a new state in every tick, one in five of them outside the joint limits

The controller is that of a scenario's first case, whose ``stir(controller, rng)`` assigns targets and weights.
"""

from __future__ import annotations

import hashlib
import os
from collections import Counter
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any, final

import numpy as np

from wbc import checks
from wbc.control.command import Command
from wbc.control.controller import UNNAMED, Controller
from wbc.errors import WbcError
from wbc.sim.scenario import Progress, Scenario, silent
from wbc.sim.spoiling import RUBBISH, SpoiltComponent, SpoiltTarget, spoilt
from wbc.stack.constraint import JointInterval, bounds_of
from wbc.types import Vec

KINDS = ("valid", "fuzz", "starts")
#: How far beyond a limit a command may be [unit of the limit].
TOLERANCE = 1e-6
EVERY = 500
_CERTIFIED = ("solved", "other solver", "relaxed")


@final
@dataclass
class Findings:
    """What came of a soak. ``ok`` is whether everything that was promised held."""

    kind: str
    ticks: int = 0
    exceptions: Counter[str] = field(default_factory=Counter)
    not_finite: int = 0
    beyond: int = 0
    worst: dict[str, float] = field(default_factory=dict)
    fallback_levels: Counter[str] = field(default_factory=Counter)
    statuses: Counter[str] = field(default_factory=Counter)
    uncertified: int = 0
    restarts: int = 0
    seconds: float = 0.0
    grown_bytes: int = 0
    digest: str = ""

    @property
    def ok(self) -> bool:
        """No exception, no number that is not finite, no limit passed; from any start a certified answer."""
        return not (self.exceptions or self.not_finite or self.beyond or (self.kind == "starts" and self.uncertified))

    @property
    def solved_share(self) -> float:
        """Share of the ticks that were solved, without a fallback level."""
        return self.fallback_levels["solved"] / max(1, self.ticks)


def soak(
    scenario: Scenario, *, solver: str = "pdas", ticks: int, kind: str = "valid", seed: int = 0,
    progress: Progress = silent,
) -> Findings:  # fmt: skip
    """Let the controller of a scenario run for ``ticks`` ticks.

    Raises:
        InvalidInput: another ``kind``, no ticks, or a negative seed.
    """
    checks.instance("scenario", scenario, Scenario, "a Scenario, such as wbc.sim.scenario.find(name) gives")
    checks.one_of("kind", kind, KINDS)
    ticks, seed = int(checks.number("ticks", ticks, low=1)), checks.seed("seed", seed)
    control = scenario.first_setup(scenario.complete_parameters(solver=solver)).controller(solver)
    run = _Run(scenario, control, np.random.default_rng([seed, KINDS.index(kind)]), Findings(kind))
    start, digest, memory = perf_counter(), hashlib.sha256(), 0
    for k in range(ticks):
        if k % EVERY == 0:
            progress(k / ticks)
            run.stir()
        if k == ticks // 10:
            memory = _resident()
        for part in run.tick():
            digest.update(part.tobytes())
    found = run.found
    found.ticks, found.seconds, found.digest = ticks, perf_counter() - start, digest.hexdigest()
    found.grown_bytes = _resident() - memory
    progress(1.0)
    return found


@final
class _Run:
    """One soak between two ticks."""

    def __init__(self, scenario: Scenario, control: Controller, rng: np.random.Generator, found: Findings) -> None:
        self.scenario, self.control, self.rng, self.found = scenario, control, rng, found
        self.model, self.dt = control.model, control.dt
        self.t, self.failed = 0.0, 0
        self.q, self.v = np.array(self.model.q0), np.zeros(self.model.nv)
        self.limits = _limits(control)
        if found.kind == "fuzz":
            control.components = (*control.components, SpoiltComponent(control.stack, rng))

    def stir(self) -> None:
        """New targets; in a fuzz rubbish among them, which may be refused by a typed error and nothing else."""
        self.scenario.stir(self.control, self.rng)
        if self.found.kind != "fuzz":
            return
        for task in self.control.stack.tasks:
            for name in ("target", "weight"):
                if hasattr(task, name):
                    self._assign(task, name)

    def _assign(self, task: Any, name: str) -> None:
        value, chance = getattr(task, name), self.rng.uniform()
        try:
            if chance < 0.1:
                setattr(task, name, spoilt(value, self.rng))
            elif chance < 0.3 and name == "target" and not callable(value):
                setattr(task, name, SpoiltTarget(value, self.rng))
        except (WbcError, TypeError):  # TypeError: what it holds is no array of numbers
            pass
        except Exception as cause:
            self.found.exceptions[f"{name}: {type(cause).__name__}: {cause}"[:200]] += 1

    def tick(self) -> tuple[Vec, ...]:
        """One tick, judged; what was decided."""
        t, q, v = self._state()
        try:
            command = self.control.tick(t, q, v)
        except Exception as cause:
            self.found.exceptions[f"{type(cause).__name__}: {cause}"[:200]] += 1
            return ()
        parts = _decided(command, self.control)
        found = self.found
        if self.control.why.startswith(f"{UNNAMED} raised"):  # its members are the library's: a slip
            found.exceptions[self.control.why[:200]] += 1
        found.fallback_levels[command.fallback_level] += 1
        found.statuses[command.status.name] += 1
        found.uncertified += command.fallback_level not in _CERTIFIED or not command.certificate.ok
        if not all(np.isfinite(part).all() for part in parts):
            found.not_finite += 1
            return parts
        self._judge(command, v)
        self._go_on(command)
        return parts

    def _state(self) -> tuple[float, Vec, Vec]:
        if self.found.kind == "valid":
            return self.t, self.q, self.v
        rng, model = self.rng, self.model
        if self.found.kind == "starts":
            self.control.reset()
            return 0.0, *self._start()
        q, v, t = self.q.copy(), self.v.copy(), self.t
        kind = rng.integers(8)
        if kind == 0:
            q = spoilt(q, rng)
        elif kind == 1:
            v = spoilt(v, rng)
        elif kind == 2:
            t = float(rng.choice(RUBBISH))
        elif kind == 3:
            q, v = model.random_configuration(rng), rng.normal(size=model.nv) * 10.0 ** rng.uniform(-3, 3)
        return t, q, v

    def _start(self) -> tuple[Vec, Vec]:
        """A state inside the joint limits, in one of five cases outside in positions or velocities."""
        rng, model = self.rng, self.model
        joints = slice(model.nq - model.nj, model.nq)
        q, v = np.array(model.q0), np.zeros(model.nv)
        low, high = self.limits.get("position", (model.limits.q_min, model.limits.q_max))
        low, high = np.maximum(low, -np.pi), np.minimum(high, np.pi)
        q[joints] = rng.uniform(low, high)
        fastest = np.minimum(self.limits["velocity"][1] if "velocity" in self.limits else 1.0, 1e2)
        v[model.nb :] = rng.uniform(-fastest, fastest)
        if rng.uniform() < 0.2:
            which = rng.uniform(size=model.nj) < 0.3
            q[joints] += which * rng.choice([-1.0, 1.0], model.nj) * rng.uniform(0.0, 0.5, model.nj)
            v[model.nb :] *= 1.0 + which * rng.uniform(0.0, 0.5, model.nj)
        return q, v

    def _judge(self, command: Command, v: Vec) -> None:
        """Limits, from the constraints of the stack; in a fuzz only what no state can excuse."""
        nb, nj, kind = self.model.nb, self.model.nj, self.found.kind
        values = {}
        if kind == "valid":
            values = {"position": command.q[-nj:], "velocity": command.v[nb:]}
            values["acceleration"] = (command.v[nb:] - v[nb:]) / self.dt
        if self.control.level.dynamics:
            values["torque"] = command.tau
        beyond = False
        for quantity, value in values.items():
            if quantity in self.limits:
                low, high = self.limits[quantity]
                excess = float(np.maximum(value - high, low - value).max())
                self.found.worst[quantity] = max(self.found.worst.get(quantity, -np.inf), excess)
                beyond |= excess > TOLERANCE
        self.found.beyond += beyond

    def _go_on(self, command: Command) -> None:
        if self.found.kind == "starts":
            return
        self.t += self.dt
        self.failed = 0 if command.status.ok else self.failed + 1
        if self.found.kind == "valid" or (command.status.ok and self.rng.uniform() < 0.9):
            self.q, self.v = np.array(command.q), np.array(command.v)
        lost = bool(np.abs(self.q).max() > 1e3 or np.abs(self.v).max() > 1e3)
        if lost or self.failed > EVERY:
            self.q, self.v, self.failed = np.array(self.model.q0), np.zeros(self.model.nv), 0
            self.control.reset()
            self.found.restarts += 1


def _decided(command: Command, control: Controller) -> tuple[Vec, ...]:
    if control.level.order == 1:
        return command.v, command.q
    return (command.tau, command.a, command.q) if control.level.dynamics else (command.a, command.q)


def _limits(control: Controller) -> dict[str, tuple[Vec, Vec]]:
    """By quantity, what all constraints of the stack together leave each joint."""
    limits: dict[str, tuple[Vec, Vec]] = {}
    for constraint in control.stack.subject_to:
        if isinstance(constraint, JointInterval):
            low, high = bounds_of(constraint, control.model)
            before = limits.get(constraint.quantity, (low, high))
            limits[constraint.quantity] = (np.maximum(low, before[0]), np.minimum(high, before[1]))
    return limits


def _resident() -> int:
    """Bytes of memory in use."""
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
