"""Waving: an arm whose joints swing, with sensors that have noise and masses of which the controller is not sure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, final

import numpy as np

import wbc
from wbc.models.pinocchio_ import PinocchioModel
from wbc.sim.disturbance import Disturbance, SensorNoise
from wbc.sim.mujoco_ import MujocoPlant
from wbc.sim.scenario import Setup
from wbc.types import Vec

from .. import MomentumObserver, Posture, Sinusoid, Thresholds, TorqueLimits

GAIN, PERSISTENCE, FLOOR = 100.0, 2, 0.1
NOISE: Mapping[str, float] = {"position": 5e-5, "velocity": 0.01}
#: The observer has settled so long after a start [s].
STARTING = 0.3


@final
class Waving:
    """The arm, what is drawn with it, and what is known of it: thresholds, and the run without a fault."""

    def __init__(self, robot: PinocchioModel, masses: float, noise: Mapping[str, float], seed: int) -> None:
        self.random, self.robot, self.noise = np.random.default_rng(seed), robot, noise
        links = len(robot.pinocchio.inertias) - 1
        self.believed = robot.with_masses(1.0 + self.random.uniform(-masses, masses, links)) if masses else robot
        self.plant = MujocoPlant(robot)
        self.threshold: Vec = np.full(robot.nj, np.inf)
        self.noise_of_a_tick: Vec = np.zeros(robot.nj)

    def observer(self) -> MomentumObserver:
        """A new one, with the thresholds that are known."""
        return MomentumObserver(gain=GAIN, threshold=self.threshold, persistence=PERSISTENCE, release=0.5)

    def setup(
        self, duration: float, *, disturbances: Sequence[Disturbance] = (), components: Sequence[Any] = (),
        tasks: Sequence[Any] = (), limits: Sequence[Any] = (), seed: int = 0, about: Any = None,
    ) -> Setup:  # fmt: skip
        """The wave from its start, with a new controller and, without ``components``, an observer alone."""
        robot = self.robot
        wave = Sinusoid(robot.q0, amplitude=0.3, frequency=np.linspace(0.3, 0.6, robot.nj))
        stack = wbc.Stack(
            [Posture(wave, kp=100), *tasks], subject_to=[TorqueLimits(), *limits],
            components=components or [self.observer()],
        )  # fmt: skip
        self.plant.reset(robot.q0)
        sensors = [SensorNoise(**self.noise, seed=seed)] if self.noise else []
        return Setup(
            stack=stack, plant=self.plant, robot=self.believed, disturbances=[*disturbances, *sensors],
            duration=duration, about=about,
        )  # fmt: skip

    def seed(self) -> int:
        """One for the noise of a run."""
        return int(self.random.integers(2**31)) if self.noise else 0

    def learn(self, seconds: float, solver: str) -> Thresholds:
        """Thresholds, from a run without a fault, which is kept."""
        self.calm = self.setup(seconds, seed=self.seed()).run(duration=seconds, solver=solver).run
        residual = self.calm["signal.MomentumObserver.residual"][self.calm["t"] > STARTING]
        known = Thresholds.learnt(residual, gain=GAIN, dt=1e-3, floor=FLOOR)
        self.threshold = known.value
        self.noise_of_a_tick = known.noise if self.noise else np.zeros(self.robot.nj)
        return known
