"""Trials: a standing robot loses a motor, once without and once with an answer, everything else the same."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, final

import numpy as np

import wbc
from wbc.models.pinocchio_ import PinocchioModel
from wbc.report import measure
from wbc.sim.actuator_fault import ActuatorFault
from wbc.sim.disturbance import Disturbance, SensorNoise
from wbc.sim.scenario import Parameters, Setup, Trial
from wbc.types import Vec

from .. import FaultReaction, MomentumObserver, Thresholds, When
from ..components.diagnosis import ACTUATOR, Diagnosis
from ..components.fault_reaction import TABLE
from .standing import Stance, standing_plant, standing_stack

#: Gain of the observer [1/s] with noise, which grows with it, and without, where nothing speaks against a large one;
#: ticks in a row above the threshold that raise an alarm.
GAIN, CLEAN_GAIN, PERSISTENCE = 100.0, 1000.0, 2
#: Least threshold where sensors have no noise and masses are right [N m]: three times what physics and the observer's
#: midpoint rule leave on these robots.
CLEAN_FLOOR = 0.1
#: How clearly a joint must stand out: a fault throws a robot whose masses are not known well.
DOMINANCE = 3.0
#: Seconds of a run without a fault that thresholds are learnt from, and of its start that are left out.
LEARNING, STARTING = 4.0, 0.6
#: After a fault, time that does not count for the error of the task [s].
RECOVERY = 1.0
#: A standing foot that slid farther than this has not kept its place [m].
SLID = 0.05

#: Encoders, joint velocities, and the estimate of the base: standard deviations in SI units.
NOISE = {
    "position": 5e-5, "velocity": 0.01, "base_position": 5e-4, "base_velocity": 5e-3, "base_angular_velocity": 5e-3,
}  # fmt: skip

#: Settings of tasks by name, and what they become: nobody can say that other gains would have helped.
Gains = Mapping[str, Mapping[str, Any]]
#: Gains that noise of the sensors allows: damping turns noise of the velocity into force.
GAINS: Gains = {"CenterOfMass": {"kp": 100.0}, "Posture": {"kp": 10.0, "weight": 1e-3}}


@final
@dataclass(frozen=True)
class Stand:
    """Who stands and how: robot, stance, gains other than the usual ones, and how well the controller knows it all.

    ``masses``: by how much, as a share, each link's mass may be wrong in the controller; ``noise``: whether sensors
    have it; ``floor`` [N m] of the thresholds where something is wrong; ``seed`` decides masses and noise.
    """

    name: str
    stance: Stance
    floor: float
    gains: Gains = field(default_factory=dict)
    noise: bool = False
    masses: float = 0.0
    seed: int = 0

    @classmethod
    def of(cls, p: Parameters, stance: Stance, floor: float, gains: Gains, clean: Gains) -> Stand:
        """As the parameters ``robot``, ``noise``, ``masses`` and ``seed`` say; gains where something is wrong, else
        ``clean``.

        Raises:
            InvalidInput: masses that make no sense.
        """
        stand = cls(
            p["robot"], stance, floor, noise=p["noise"], masses=p.number("masses", low=0.0, high=0.5), seed=p["seed"]
        )
        return replace(stand, gains=gains if stand.rough else clean)

    @property
    def gain(self) -> float:
        """K of the observer [1/s]."""
        return GAIN if self.noise else CLEAN_GAIN

    @property
    def rough(self) -> bool:
        """Whether sensors have noise or masses are wrong."""
        return self.noise or self.masses > 0.0

    @property
    def least_threshold(self) -> float:
        """[N m]."""
        return self.floor if self.rough else CLEAN_FLOOR

    def robot(self) -> PinocchioModel:
        """The robot as it is."""
        return self.stance.robot(self.name)

    def believed(self) -> PinocchioModel:
        """The robot as the controller has it."""
        robot = self.robot()
        if not self.masses:
            return robot
        links = len(robot.pinocchio.inertias) - 1
        return robot.with_masses(1.0 + np.random.default_rng(self.seed).uniform(-self.masses, self.masses, links))

    def sensors(self, seed: int) -> list[Disturbance]:
        """What disturbs the measured state."""
        return [SensorNoise(**NOISE, seed=seed)] if self.noise else []


@final
@dataclass(frozen=True, eq=False)
class Case:
    """One trial: the robot sways, at ``fault.start`` a motor fails, and it is answered by ``table``, or not at all.

    Without ``react`` the same stack runs with the observer alone. ``label`` says what is tried.
    """

    stand: Stand
    fault: ActuatorFault
    known: Thresholds
    react: bool = True
    table: Sequence[When] = TABLE
    label: str = ""

    def setup(self, after: float) -> Setup:
        """The run, which ends ``after`` seconds after the fault or when the robot has fallen."""
        stand, known = self.stand, self.known
        observer = MomentumObserver(gain=stand.gain, threshold=known.value, persistence=PERSISTENCE, release=0.5)
        noise = known.noise if stand.noise else 0.0
        reaction = FaultReaction(observer, noise=noise, table=self.table, dominance=DOMINANCE)
        return standing(
            stand, [observer, reaction] if self.react else [observer], [reaction.limits] if self.react else [],
            duration=self.fault.start + after, disturbances=[self.fault, *stand.sensors(stand.seed)],
            about=(self, reaction),
        )  # fmt: skip


@final
@dataclass(frozen=True, eq=False)
class Outcome:
    """What came of a trial: the record, the diagnoses, and what became of the robot."""

    trial: Trial
    fault: ActuatorFault
    diagnoses: Sequence[Diagnosis]
    stands: bool
    error: Vec
    slip: float

    @classmethod
    def of(cls, trial: Trial) -> Outcome:
        """What came of the trial of a :class:`Case`."""
        (case, reaction), run = trial.about[:2], trial.run
        plant: Any = trial.setup.plant
        slip = max(measure.slip(run, foot.name) or 0.0 for foot in plant.feet)
        diagnoses = [d for d, _ in reaction.events]
        return cls(trial, case.fault, diagnoses, not plant.fallen, true_error(run, case.stand), slip)

    @property
    def run(self) -> wbc.Run:
        """The record."""
        return self.trial.run

    @property
    def found(self) -> Diagnosis | None:
        """The first diagnosis of a motor after the fault; without a reaction nothing is diagnosed."""
        return next((d for d in self.diagnoses if d.t >= self.fault.start and d.kind in ACTUATOR), None)

    @property
    def false_alarms(self) -> int:
        """Diagnoses before there was a fault."""
        return sum(d.t < self.fault.start for d in self.diagnoses)

    @property
    def delay(self) -> float:
        """From the fault to the answer [s]; infinite without one."""
        return np.inf if self.found is None else self.found.t - self.fault.start

    @property
    def rms(self) -> float:
        """True error of the centre of mass from a second after the fault on, as far as the run goes [m]."""
        late = self.run["t"] > self.fault.start + RECOVERY
        chosen = self.error[late] if late.any() else self.error[self.run["t"] > self.fault.start]
        return measure.rms(chosen)

    @property
    def fate(self) -> str:
        """What became of the robot, in a word or two."""
        if not self.stands:
            return f"falls after {float(self.run['t'][-1]) - self.fault.start:.2f} s"
        return f"slides {1e3 * self.slip:.0f} mm" if self.slip > SLID else "stands"

    @property
    def kept(self) -> bool:
        """It stands, on the same spot."""
        return self.stands and self.slip <= SLID


@final
@dataclass(frozen=True)
class Pair:
    """The same trial without and with the answer, under ``label``."""

    label: str
    without: Outcome
    answered: Outcome


def learnt(stand: Stand, solver: str = "pdas") -> Thresholds:
    """Thresholds from a run without a fault, with other noise than the trials'."""
    observer = MomentumObserver(gain=stand.gain)
    setup = standing(stand, [observer], duration=LEARNING, disturbances=stand.sensors(stand.seed + 1000))
    run = setup.run(duration=LEARNING, solver=solver).run
    residual = run["signal.MomentumObserver.residual"][run["t"] > STARTING]
    return Thresholds.learnt(residual, gain=stand.gain, dt=float(run.meta["dt"]), floor=stand.least_threshold)


def standing(
    stand: Stand, components: Sequence[Any], tasks: Sequence[Any] = (), *, duration: float,
    disturbances: Sequence[Disturbance], about: Any = None,
) -> Setup:  # fmt: skip
    """The robot stands and sways with these components, the first of them an observer, and tasks beside the usual."""
    robot, believed = stand.robot(), stand.believed()
    usual = standing_stack(believed, stand.stance)
    _vary(usual, stand.gains)
    stack = wbc.Stack(
        [*usual.tasks, *tasks], subject_to=usual.subject_to, contacts=usual.contacts, components=components
    )
    plant = standing_plant(robot, stand.stance, stack.contacts)
    components[0].wrenches = plant.wrenches
    return Setup(stack=stack, plant=plant, robot=believed, disturbances=disturbances, duration=duration, about=about)


def _vary(stack: wbc.Stack, gains: Gains) -> None:
    members = {task.name: task for task in stack.tasks}
    for name, settings in gains.items():
        chosen = stack.contacts if name == "contacts" else [members[name]]
        for what, value in settings.items():
            for member in chosen:
                setattr(member, what, value)


def true_error(run: wbc.Run, stand: Stand) -> Vec:
    """Distance (N,) [m] of the robot's true centre of mass from the target, whatever the controller measures."""
    error = np.array(run["error.CenterOfMass"])
    if stand.rough:
        true, believed = stand.robot().state(), stand.believed().state()
        still = np.zeros(true.model.nv)
        for k in range(run.rows):
            true.update(0.0, run["plant.q"][k], still)
            believed.update(0.0, run["q"][k], still)
            error[k] += believed.com - true.com
    distance: Vec = np.linalg.norm(error, axis=1)
    return distance
