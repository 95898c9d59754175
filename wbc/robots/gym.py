"""TargetEnv: a Gymnasium environment whose action is the targets of tasks; a controller moves the robot to them.

A policy sends targets some fifty times a second; the controller meets them at its own rate, within its limits and
contacts. The extra ``gym`` installs Gymnasium. Many environments at once: ``gymnasium.vector.SyncVectorEnv``, or
``AsyncVectorEnv`` on several processes, of functions that each make one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from wbc import checks
from wbc.control.controller import Controller
from wbc.errors import InvalidInput, NotSupported, SimulationError
from wbc.sim.plant import Plant, whole
from wbc.sim.simulate import check_fit
from wbc.types import Vec

try:
    import gymnasium
except ModuleNotFoundError as cause:
    raise NotSupported("TargetEnv needs gymnasium; from a clone of wbc: pip install '.[gym]'") from cause

Numbers = NDArray[np.float32]


@final
class TargetEnv(gymnasium.Env[Numbers, Numbers]):
    """A controller and a plant as ``reset`` and ``step``.

    The action (n,) is the targets of the tasks one after the other: −1 is the lower bound, 1 the upper one. The
    observation is q (nq,), v (nv,) and what ``observe`` adds. An episode is terminated when the robot falls or the
    plant diverges, and truncated after ``duration``. ``info["unsolved"]`` counts the ticks of a step that had to fall
    back. An episode depends on the seed and the actions alone.

    Args:
        controller: its stack has the tasks.
        plant: takes what the controller decides, with the controller's period.
        targets: (task, low, high) of each task that is steered; bounds as the task's target, an array.
        reward: called with this environment after each step.
        observe: numbers that are observed beside the state, always as many; called with this environment.
        ticks: of the controller in a step.
        duration: of an episode [s].
        noise: joints start within this distance of q0, uniformly [rad, m].

    ``targets`` are the tasks that are steered.

    Raises:
        InvalidInput: a task that the stack does not have, bounds that do not fit its target, a number out of range, no
            function.

    Example:
        >>> import numpy as np, wbc
        >>> from wbc.robots import TargetEnv
        >>> from wbc.sim.plant import IntegratorPlant
        >>> from wbc.tasks import JointVelocityLimits, Position
        >>> robot, tool = wbc.load("arm"), Position("tool", target=[0.4, 0.0, 0.5], rate=5.0)
        >>> stack = wbc.Stack([tool], subject_to=[JointVelocityLimits()])
        >>> controller = wbc.Controller(robot, stack, level=wbc.VelocityLevel(), dt=2e-3)
        >>> plant = IntegratorPlant(robot, level="velocity", dt=2e-3)
        >>> def reward(env):
        ...     return -float(np.abs(env.controller.plan.errors()["Position[tool]"]).max())
        >>> env = TargetEnv(controller, plant, [(tool, [0.3, -0.3, 0.3], [0.5, 0.3, 0.7])], reward=reward)
        >>> observation, info = env.reset(seed=0)
        >>> for _ in range(50):  # to [0.4, 0.15, 0.4]
        ...     observation, gained, terminated, truncated, info = env.step(np.float32([0.0, 0.5, -0.5]))
        >>> observation.shape, gained > -0.01, terminated, info["unsolved"]
        ((14,), True, False, 0)
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 - as Gymnasium declares it

    def __init__(
        self,
        controller: Controller,
        plant: Plant,
        targets: Iterable[tuple[Any, Any, Any]],
        *,
        reward: Callable[[TargetEnv], float],
        observe: Callable[[TargetEnv], Any] | None = None,
        ticks: int = 10,
        duration: float = 5.0,
        noise: float = 0.05,
    ) -> None:
        self.controller = checks.instance("controller", controller, Controller, "a wbc.Controller")
        self.plant = checks.instance("plant", plant, Plant, "a plant, as MujocoPlant(robot)")
        check_fit(controller, plant)
        if plant.takes == "position":
            raise InvalidInput("the plant takes positions; drives that start from the state in each tick sag")
        self.targets: list[Any] = []
        lows, highs = [], []
        members = [task for level in controller.stack.levels for task in level]
        for i, entry in enumerate(checks.items("targets", targets, "(task, low, high)")):
            task, low, high = (*checks.items(f"targets[{i}]", entry, "three: task, low, high"), None, None, None)[:3]
            if not any(task is one for one in members) or checks.ndim(getattr(task, "target", None)) != 1:
                raise InvalidInput(
                    f"targets[{i}] is {checks.shown(task)}; it must be a task of the stack whose target is an array"
                )
            self.targets.append(task)
            lows.append(checks.array(f"low of targets[{i}]", low, np.shape(task.target)))
            highs.append(checks.array(f"high of targets[{i}]", high, np.shape(task.target)))
        if not self.targets or (np.concatenate(lows) >= np.concatenate(highs)).any():
            raise InvalidInput("targets must have at least one task, and each low must be below its high")
        self._first = [np.array(task.target) for task in self.targets]
        self._ends = np.cumsum([len(low) for low in lows])[:-1]
        self._reward = checks.function("reward", reward, "a function of the environment")
        nothing = observe is None
        self._observe = None if nothing else checks.function("observe", observe, "a function of the environment")
        self._ticks = whole("ticks", ticks)
        self._duration = checks.number("duration", duration, low=0.0, strict=True)
        self._noise = checks.number("noise", noise, low=0.0)
        self._low, self._high = np.concatenate(lows), np.concatenate(highs)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, self._low.shape, np.float32)
        size = len(self._observed())
        self.observation_space = gymnasium.spaces.Box(-checks.LARGEST, checks.LARGEST, (size,), np.float32)

    def _observed(self) -> Numbers:
        more = [] if self._observe is None else [np.atleast_1d(self._observe(self))]
        return np.concatenate([self.plant.q, self.plant.v, *more]).astype(np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Numbers, dict[str, Any]]:
        """Begin an episode at rest near q0, a floating base on its feet, targets as they were at first."""
        super().reset(seed=seed, options=options)
        robot = self.plant.model
        q: Vec = robot.q0.copy()
        joints = q[-robot.nj :] + self.np_random.uniform(-self._noise, self._noise, robot.nj)
        q[-robot.nj :] = np.clip(joints, robot.limits.q_min, robot.limits.q_max)
        self.plant.reset(robot.on_ground(q) if robot.nb else q)  # type: ignore[attr-defined]
        for task, first in zip(self.targets, self._first, strict=True):
            task.target = first
        self.controller.reset()
        return self._observed(), {}

    def step(self, action: Numbers) -> tuple[Numbers, float, bool, bool, dict[str, Any]]:
        """Assign the targets and let ``ticks`` pass: observation, reward, terminated, truncated, info.

        Raises:
            InvalidInput: another size, or a number that is not finite.
        """
        share = 0.5 + 0.5 * np.clip(checks.array("action", action, self._low.shape), -1.0, 1.0)
        within = self._low + share * (self._high - self._low)
        for task, target in zip(self.targets, np.split(within, self._ends), strict=True):
            task.target = target
        plant, unsolved, lost = self.plant, 0, False
        for _ in range(self._ticks):
            command = self.controller.tick(plant.t, plant.q, plant.v)
            unsolved += not command.status.ok
            try:
                plant.step(command)
            except SimulationError:
                lost = True
                break
        observed, gained = np.nan_to_num(self._observed()), float(self._reward(self))
        late = plant.t > self._duration - 0.5 * plant.dt
        return observed, gained, lost or plant.fallen, late, {"unsolved": unsolved}
