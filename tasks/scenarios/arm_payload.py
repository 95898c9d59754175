"""An arm picks up an unknown load; the same controller with and without adaptation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, ClassVar, final

import numpy as np

import wbc
from wbc.models.pinocchio_ import PinocchioModel
from wbc.report import measure
from wbc.report.document import Bound, Curve, Plot, Section, Table, Text
from wbc.sim.disturbance import Payload, SensorNoise
from wbc.sim.engine import PhysicsSettings
from wbc.sim.mujoco_ import MujocoPlant
from wbc.sim.scenario import Check, Parameter, Parameters, Scenario, ScenarioResult, Setup, Trial
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
#: The cases: with and without adaptation, with half the period; and what is added to their names in the rough case.
ADAPTING, STUBBORN, HALVED, ROUGHLY = "adapting", "not adapting", "half the period", ", noise and friction"
#: V is watched from one such stretch of time [s] to the next.
STRETCH = 0.01


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
    summary: ClassVar[str] = "an arm picks up an unknown load, with and without adaptation"
    parameters: ClassVar[Mapping[str, Parameter]] = {"robot": "panda", "mass": 2.0, "rough": True}
    robots, knows = DAMPING, "the gains of these"
    plants = ("mujoco",)
    duration = 13.0

    def cases(self, p: Parameters) -> dict[str, dict[str, Any]]:
        p.lasts_beyond(PICK + END, f"the load comes at {PICK:g} s")
        p.number("mass", low=0.0, strict=True)
        cases = {
            ADAPTING: {"adapts": True, "noisy": False, "dt": 1e-3},
            STUBBORN: {"adapts": False, "noisy": False, "dt": 1e-3},
            HALVED: {"adapts": True, "noisy": False, "dt": 5e-4},
        }
        if p["rough"]:
            cases |= {name + ROUGHLY: {**cases[name], "noisy": True} for name in (ADAPTING, STUBBORN)}
        return cases

    def build(self, p: Parameters) -> Setup:
        robot, noisy, tool = wbc.load(p["robot"]), p["noisy"], TOOLS[p["robot"]]
        kd = np.array(DAMPING[p["robot"]], dtype=np.float64)
        adaptive = SlotineLi(
            _motion(robot), kp=RATE * kd, kd=kd, gain=GAIN, links=[robot.joint_names[-1]], length=LENGTH,
            truth=None if noisy else _truth(robot, p["mass"]), friction_gain=FRICTION_GAIN if noisy else 0.0,
        )  # fmt: skip
        adaptive.frozen = not p["adapts"]
        friction = ROUGH["friction"] if noisy else 0.0
        plant = MujocoPlant(robot, dt=p["dt"], settings=PhysicsSettings(joint_friction=friction))
        noise = [SensorNoise(position=ROUGH["position"], velocity=ROUGH["velocity"])] if noisy else []
        return Setup(
            stack=wbc.Stack([adaptive.torque], components=[adaptive], subject_to=[TorqueLimits()]), plant=plant,
            disturbances=[Payload(tool, mass=p["mass"], start=PICK), *noise],
            duration=PICK + END if p["dt"] < 1e-3 else None,
        )  # fmt: skip

    def judge(self, trials: Iterator[Trial], p: Parameters) -> ScenarioResult:
        done = {trial.name: trial for trial in trials}
        adapting, robot = done[ADAPTING], done[ADAPTING].robot
        errors = {name: _tool_error(robot, trial.run) for name, trial in done.items() if name != HALVED}
        run = adapting.run
        end = measure.row(run, measure.seconds(run) - END)
        late = {name: measure.rms(error[end:]) for name, error in errors.items()}
        ratio = late[STUBBORN] / late[ADAPTING]
        peak = float(errors[ADAPTING][measure.row(run, PICK) :].max())
        smallest = [one.run["signal.SlotineLi.smallest"] for name, one in done.items() if STUBBORN not in name]
        unphysical, rises = int((np.concatenate(smallest) <= 0.0).sum()), [_rise(run), _rise(done[HALVED].run)]
        most, joint = heaviest(robot)
        figures: dict[str, Any] = {
            "error_with": late[ADAPTING], "error_without": late[STUBBORN], "ratio": ratio,
            "unphysical_ticks": unphysical, "peak_m": peak, "V_rise_1_ms": rises[0], "V_rise_half_ms": rises[1],
            "mass_of_last_link": float(run["signal.SlotineLi.a_hat"][-1, -10]),
            "true_mass_of_last_link": float(_truth(robot, p["mass"])[-10]),
            "heaviest_kg": most,
        }  # fmt: skip
        checks = [
            Check("error without adaptation, as a multiple of the error with it", ratio, ">=", 30.0),
            Check("tool's error after the pick-up, peak", peak, "<", 0.01, "m"),
            Check("ticks whose parameters belong to no rigid body", float(unphysical), "=", 0.0),
            Check("largest rise of V within 10 ms, of V at the pick-up", rises[0], "<", 1e-2),
            Check("that rise with half the period, over the rise with the whole", rises[1] / (rises[0] or 1.0), "<=",
                  0.75),
            *judge.common_checks(run),
        ]  # fmt: skip
        if p["rough"]:
            rough = late[STUBBORN + ROUGHLY] / late[ADAPTING + ROUGHLY]
            figures |= {"ratio_rough": rough, "error_with_rough": late[ADAPTING + ROUGHLY]}
            checks.insert(1, Check("the same with noise and friction", rough, ">=", 15.0))
        shown = [done[name] for name in errors]
        sections = [_section(shown, errors, figures["true_mass_of_last_link"]), _limits(most, joint, p["mass"])]
        return judge.verdict(shown, checks, tracking={}, figures=figures, sections=sections)


def _motion(robot: PinocchioModel) -> Sinusoid:
    return Sinusoid(robot.q0, amplitude=AMPLITUDE, frequency=FREQUENCY)


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
    watched = V[measure.row(run, PICK) + 1 :: measure.row(run, STRETCH)]
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


def _section(shown: Sequence[Trial], errors: Mapping[str, Vec], true_mass: float) -> Section:
    run, load = shown[0].run, Bound(PICK, "load", "x")
    t = measure.times(run)
    plots = [
        judge.beside("tool", "The tool's distance from its path", "mm", shown,
                     lambda one: np.maximum(1e3 * errors[one.name], 1e-2), bounds=[load], log="y", wide=True,
                     caption="Distances below 0.01 mm are drawn as 0.01 mm."),
        Plot(
            "learnt", "What is learnt", "kg", t,
            [Curve("mass of the last link", run["signal.SlotineLi.a_hat"][:, -10])],
            [Bound(true_mass, "true"), load],
        ),
        Plot(
            "V", "V, with the true parameters", "", t, [Curve("V", run["signal.SlotineLi.V"])], [load], log="y",
            caption="V is taken with the load's parameters from the start, and decreases once the load is there.",
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
