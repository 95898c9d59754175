"""An arm picks up a load it was not told of; the same controller with and without adaptation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, final

import numpy as np

import wbc
from wbc import checks
from wbc.errors import InvalidInput
from wbc.models.pinocchio_ import PinocchioModel
from wbc.report import measure
from wbc.report.document import Bound, Curve, Plot, Section, Table, Text
from wbc.sim.disturbance import Disturbance, Payload, SensorNoise
from wbc.sim.engine import PhysicsSettings
from wbc.sim.mujoco_ import MujocoPlant
from wbc.sim.scenario import Check, Parameter, Progress, Scenario, ScenarioResult, Settings, trials
from wbc.sim.simulate import simulate
from wbc.types import Vec

from .. import Sinusoid, SlotineLi, TorqueLimits
from . import judge

#: When the load is picked up [s], and the end of the run whose error is compared [s].
PICK, END = 3.0, 2.0
#: Motion of the joints: amplitudes [rad] and frequencies [Hz].
AMPLITUDE, FREQUENCY = (0.3, 0.25, 0.3, 0.3, 0.4, 0.3, 0.4), (0.25, 0.31, 0.37, 0.29, 0.41, 0.35, 0.45)
#: Damping of the joints [N m s/rad], chosen from their inertia: more in the wrist chatters at 1 kHz. Λ = 10 1/s.
DAMPING: Mapping[str, Sequence[float]] = {"panda": (20, 20, 20, 20, 4, 4, 2)}
TOOLS: Mapping[str, str] = {"panda": "panda_hand_tcp"}
RATE, GAIN, FRICTION_GAIN, LENGTH = 10.0, 100.0, 5.0, 0.3
#: What sensors and joints add in the rough case: rad, rad/s, N m.
ROUGH = {"position": 5e-5, "velocity": 0.01, "friction": 0.3}
#: V is watched from one such stretch of time [s] to the next.
STRETCH = 0.01


@final
@dataclass(frozen=True)
class Case:
    """One run: whether it adapts, under noise and friction or not, with which period [s]."""

    adapts: bool
    rough: bool = False
    dt: float = 1e-3

    def __str__(self) -> str:
        return ("adapting" if self.adapts else "not adapting") + (", noise and friction" if self.rough else "")


@final
class ArmPayload(Scenario):
    """All joints follow sines; after 3 s a point mass of ``mass`` [kg] is fixed to the tool. Slotine–Li with the last
    link's ten parameters adapted, against the same law with the same gains that learns nothing.

    ``robot``: panda (needs example-robot-data); ``rough``: also with noise of the sensors and 0.3 N m of Coulomb
    friction.
    """

    name: ClassVar[str] = "arm-payload"
    group: ClassVar[str] = "arms"
    takes = 80.0
    summary: ClassVar[str] = "an arm picks up a load it was not told of, with and without adaptation"
    parameters: ClassVar[Mapping[str, Parameter]] = {"robot": "panda", "mass": 2.0, "rough": True}
    robots, knows = DAMPING, "the gains of these"
    plants = ("mujoco",)
    duration = 13.0

    def run(self, parameters: Mapping[str, Any], settings: Settings) -> ScenarioResult:
        if settings.duration <= PICK + END:
            raise InvalidInput(
                f"duration is {settings.duration:g} s; the load comes at {PICK:g} s: give {END:g} s more"
            )
        name = parameters["robot"]
        mass = checks.number("parameter 'mass'", parameters["mass"], low=0.0, strict=True)
        robot = wbc.load(name)
        cases = [Case(True), Case(False), Case(True, dt=5e-4)]
        if parameters["rough"]:
            cases += [Case(True, True), Case(False, True)]
        runs: dict[Case, wbc.Run] = {}
        for case, one in trials(settings.progress, cases):
            meta = {"scenario": self.name, "parameters": dict(parameters)}
            lasts = PICK + END if case.dt != 1e-3 else settings.duration
            runs[case] = _simulated(robot, case, mass, duration=lasts, solver=settings.solver, meta=meta, progress=one)
        return _judged(robot, runs, mass)


def _motion(robot: PinocchioModel) -> Sinusoid:
    return Sinusoid(robot.q0, amplitude=AMPLITUDE, frequency=FREQUENCY)


def _simulated(
    robot: PinocchioModel,
    case: Case,
    mass: float,
    *,
    duration: float,
    solver: str,
    meta: Mapping[str, Any],
    progress: Progress,
) -> wbc.Run:
    kd = np.array(DAMPING[robot.name.lower()], dtype=np.float64)
    adaptive = SlotineLi(
        _motion(robot), kp=RATE * kd, kd=kd, gain=GAIN, links=[robot.joint_names[-1]], length=LENGTH,
        truth=_truth(robot, mass) if not case.rough else None, friction_gain=FRICTION_GAIN if case.rough else 0.0,
    )  # fmt: skip
    adaptive.frozen = not case.adapts
    stack = wbc.Stack([adaptive.torque], components=[adaptive], subject_to=[TorqueLimits()])
    controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics(), solver=solver, dt=case.dt)
    friction = ROUGH["friction"] if case.rough else 0.0
    plant = MujocoPlant(robot, dt=case.dt, settings=PhysicsSettings(joint_friction=friction))
    plant.reset(robot.q0)
    disturbances: list[Disturbance] = [Payload(TOOLS[robot.name.lower()], mass=mass, start=PICK)]
    if case.rough:
        disturbances.append(SensorNoise(position=ROUGH["position"], velocity=ROUGH["velocity"]))
    return simulate(controller, plant, duration=duration, disturbances=disturbances, progress=progress, meta=meta)


def _truth(robot: PinocchioModel, mass: float) -> Vec:
    """The parameters of all links with the load in the last."""
    import pinocchio

    model = robot.pinocchio
    frame = model.frames[robot.frames[TOOLS[robot.name.lower()]]]
    load = pinocchio.Inertia(mass, np.zeros(3), np.zeros((3, 3)))
    inertias = [model.inertias[i].toDynamicParameters() for i in range(1, model.njoints)]
    inertias[-1] = inertias[-1] + frame.placement.act(load).toDynamicParameters()
    return np.concatenate(inertias)


def _tool_error(robot: PinocchioModel, run: wbc.Run) -> Vec:
    """How far the tool is from where it should be (N,) [m]."""
    state, tool, motion = robot.state(), TOOLS[robot.name.lower()], _motion(robot)
    still, error = np.zeros(robot.nv), np.empty(run.rows)
    for k, (t, q) in enumerate(zip(run["t"], run["plant.q"], strict=True)):
        state.update(t, q, still)
        at = state.frame(tool).position.copy()
        state.update(t, motion(float(t))[0], still)
        error[k] = np.linalg.norm(at - state.frame(tool).position)
    return error


def _rise(run: wbc.Run) -> float:
    """The largest rise of V from one stretch of 10 ms to the next after the pick-up, as a share of V at the pick-up."""
    V = run["signal.SlotineLi.V"]
    dt = float(run.meta["dt"])
    watched = V[round(PICK / dt) + 1 :: round(STRETCH / dt)]
    return float(np.maximum(np.diff(watched), 0.0).max(initial=0.0) / watched[0])


def heaviest(robot: PinocchioModel) -> tuple[float, str]:
    """The load [kg] that torque limits can hold at rest all along the motion, and the joint that gives in first."""
    state, motion, tool = robot.state(), _motion(robot), TOOLS[robot.name.lower()]
    worst, joint = np.inf, ""
    for t in np.arange(2.0, 22.0, 0.05):
        state.update(t, motion(float(t))[0], np.zeros(robot.nv))
        pull = -state.frame(tool).jacobian()[:3].T @ robot.gravity  # torque that a kilogramme asks for
        room = (robot.limits.tau_max - np.sign(pull) * state.g) / np.maximum(np.abs(pull), 1e-12)
        if room.min() < worst:
            worst, joint = float(room.min()), robot.joint_names[int(room.argmin())]
    return worst, joint


def _judged(robot: PinocchioModel, runs: Mapping[Case, wbc.Run], mass: float) -> ScenarioResult:
    errors = {case: _tool_error(robot, run) for case, run in runs.items() if case.dt == 1e-3}
    run = runs[Case(True)]

    def late(case: Case) -> float:
        error = errors[case]
        return float(np.sqrt(np.mean(error[-round(END / 1e-3) :] ** 2)))

    learning, stubborn = late(Case(True)), late(Case(False))
    peak = float(errors[Case(True)][round(PICK / 1e-3) :].max())
    smallest = np.concatenate([runs[case]["signal.SlotineLi.smallest"] for case in runs if case.adapts])
    unphysical, rises = int((smallest <= 0.0).sum()), [_rise(run), _rise(runs[Case(True, dt=5e-4)])]
    most, joint = heaviest(robot)
    figures: dict[str, Any] = {
        "error_with": learning, "error_without": stubborn, "ratio": stubborn / learning,
        "unphysical_ticks": unphysical, "peak_m": peak, "V_rise_1_ms": rises[0], "V_rise_half_ms": rises[1],
        "mass_of_last_link": float(run["signal.SlotineLi.a_hat"][-1, -10]),
        "true_mass_of_last_link": float(_truth(robot, mass)[-10]),
        "heaviest_kg": most,
    }  # fmt: skip
    verdict = [
        Check("error without adaptation, as a multiple of the error with it", stubborn / learning, ">=", 30.0),
        Check("tool's error after the pick-up, peak", peak, "<", 0.01, "m"),
        Check("ticks whose parameters belong to no rigid body", float(unphysical), "=", 0.0),
        Check("largest rise of V within 10 ms, of V at the pick-up", rises[0], "<", 1e-2),
        Check("that rise with half the period, over the rise with the whole", rises[1] / (rises[0] or 1.0), "<=", 0.75),
        *judge.common_checks(run),
    ]  # fmt: skip
    if Case(True, True) in errors:
        rough = late(Case(False, True)) / late(Case(True, True))
        figures |= {"ratio_rough": rough, "error_with_rough": late(Case(True, True))}
        verdict.insert(1, Check("the same with noise and friction", rough, ">=", 15.0))
    return judge.result(
        run, verdict, tracking={}, figures=figures, robot=robot, called=str(Case(True)),
        beside={str(case): runs[case] for case in errors if case != Case(True)},
        sections=[lambda result: _section(result, runs, errors), lambda result: _limits(most, joint, mass)],
    )  # fmt: skip


def _section(result: ScenarioResult, runs: Mapping[Case, wbc.Run], errors: Mapping[Case, Vec]) -> Section:
    run, load = result.run, Bound(PICK, "load", "x")
    t, shown = measure.times(run), {case: k for k, case in enumerate(case for case in runs if case in errors)}
    plots = [
        Plot(
            "tool", "The tool's distance from its path", "mm", t,
            [Curve(str(case), np.maximum(1e3 * errors[case], 1e-2), run=k) for case, k in shown.items()],
            [load], log="y", wide=True,
        ),
        Plot(
            "learnt", "What is learnt", "kg", t,
            [Curve("mass of the last link", run["signal.SlotineLi.a_hat"][:, -10])],
            [Bound(result.figures["true_mass_of_last_link"], "true"), load],
        ),
        Plot(
            "V", "V, with the true parameters", "", t, [Curve("V", run["signal.SlotineLi.V"])], [load], log="y",
            caption="Before the load comes, V knows of it already: it falls from then on.",
        ),
    ]  # fmt: skip
    text = Text(
        "The law without adaptation has the same gains. Parameters of the last link are projected onto those of bodies "
        "in every tick, exactly and in the metric of the adaptation, so that V does not grow by it."
    )
    return Section("The load", [text, *plots])


def _limits(most: float, joint: str, mass: float) -> Section:
    text = Text(
        "Adaptation learns what a load weighs, not how to lift more than the motors can: along this motion the limit "
        f"of {joint} holds {most:.1f} kg at rest, and no more. Beyond that the torque is cut to its limit and the "
        "error stays, whatever is learnt."
    )
    rows = [("picked up here", mass, mass < most), ("at the limit", most, True), ("too heavy", 1.2 * most, False)]
    return Section("What cannot be carried", [text, Table(("load", "mass [kg]", "can be held"), rows)])
