"""The PR robot follows one coordinate with the torque nearest to a preferred one, while something pulls at its tip."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from typing import Any, ClassVar, final

import numpy as np

import wbc
from wbc.methods import WeightedTorque
from wbc.models import PlanarPR
from wbc.models.planar import PlanarRobot
from wbc.report import measure
from wbc.report.document import Curve, Plot, Section, Table, Text
from wbc.sim.scenario import Check, Parameter, Parameters, Scenario, ScenarioResult, Setup, Trial
from wbc.types import Vec

from .. import MeasuredWrench, Position, Torque, TorqueLimits
from . import judge
from .exact_plant import EXACT, ExactPlant

TIP = "end_effector"
Q_START = np.array([0.0, np.pi / 2])
TAU_0 = np.array([-1.0, 2.0])
#: What the environment does to the tip [N], and the task acceleration at t = 0 [m/s²].
FORCE, ACCELERATION = np.array([-1.0, 1.0]), 9.0
#: The optimal torque at t = 0 [N, N m].
TAU_START = (Fraction(104, 11), Fraction(-71, 22))
#: The torque that an acceleration of −9 m/s² would need; it is also τ₀ + J_gᵀ F, because J_gᵀ F = −J_tᵀ there.
TAU_WRONG_SIGN = (Fraction(-2), Fraction(5, 2))

#: Ticks between two at which the closed form is asked too.
EVERY = 5


@final
class PrTorque(Scenario):
    """The tip's x follows 1 − cos 3t; among all torques that do it the one nearest to τ₀ in the norm of M⁻¹ is taken.

    A constant force of (−1, 1) N acts at the tip; a sensor measures it. ``damping`` is the diagonal of D in
    τ₀ = (−1, 2) − D q̇ [N s/m, N m s], which damps what the task leaves free; a second run goes without it.
    """

    name: ClassVar[str] = "pr-torque"
    group: ClassVar[str] = "planar"
    takes = 10.0
    summary: ClassVar[str] = "the PR robot's optimal torque in exact numbers, and tracking with a force at its tip"
    parameters: ClassVar[Mapping[str, Parameter]] = {"damping": (0.0, 2.0), "kp": 100.0}
    duration = 4.0

    def cases(self, p: Parameters) -> dict[str, dict[str, Any]]:
        return {"damped": {"D": np.array(p["damping"])}, "not damped": {"D": np.zeros(2)}}

    def build(self, p: Parameters) -> Setup:
        def wanted(t: float) -> tuple[Vec, ...]:
            return tuple(np.array([x]) for x in (1 - np.cos(3 * t), 3 * np.sin(3 * t), 9 * np.cos(3 * t)))

        def damp(t: float) -> None:
            preferred.target = TAU_0 - p["D"] * plant.v

        robot = PlanarPR(
            m1=1.0, m2=1.0, l2=0.5, d2=0.25, I2=0.1, gravity=0.0, v_max=[20.0, 60.0], tau_max=[1000.0, 100.0]
        )  # fmt: skip
        preferred, wrench = Torque(TAU_0, weight="inverse_inertia"), np.concatenate([FORCE, np.zeros(4)])
        stack = wbc.Stack(
            [preferred],
            subject_to=[Position(TIP, axes="x", target=wanted, kp=p["kp"]).exactly(name="x"), TorqueLimits()],
            components=[MeasuredWrench(TIP, wrench=np.append(FORCE, 0.0))],
        )
        plant = ExactPlant(robot, frame=TIP, wrench=lambda t: wrench)
        plant.reset(Q_START)
        return Setup(stack=stack, plant=plant, level=EXACT, before_tick=damp)

    def judge(self, trials: Iterator[Trial], p: Parameters) -> ScenarioResult:
        done = list(trials)
        damped, run, solver = done[0], done[0].run, p.settings.solver
        exact, wrong = (np.array([float(x) for x in torque]) for torque in (TAU_START, TAU_WRONG_SIGN))
        formula = float(np.abs(_at_start(ACCELERATION).closed_form().tau - exact).max())
        forms = {
            form: float(np.abs(_at_start(ACCELERATION).solve(solver, form=form).tau - exact).max())
            for form in ("torque", "acceleration", "joint")
        }
        mirrored = float(np.abs(_at_start(-ACCELERATION).closed_form().tau - wrong).max())
        first = float(np.abs(run["tau"][0] - exact).max())
        apart = float(
            np.abs(run["tau"][::EVERY] - _by_formula(damped.robot, run, np.array(p["damping"]), p["kp"])).max()
        )
        spins = [float(np.abs(of.run["plant.v"][:, 1]).max()) for of in done]
        calmed = spins[0] / spins[1] if spins[1] else np.inf
        errors = [float(of.error("x").max()) for of in done]
        figures = {
            "tau_start_1_N": float(run["tau"][0, 0]),
            "tau_start_2_Nm": float(run["tau"][0, 1]),
            "task_acceleration_start": float((damped.robot.J(Q_START) @ run["a"][0])[0]),
            "largest_error_damped_m": errors[0],
            "largest_error_free_m": errors[1],
            "fastest_turn_damped_rad_s": spins[0],
            "fastest_turn_free_rad_s": spins[1],
        }
        checks = [
            Check("τ(0) by formula minus (104/11, −71/22)", formula, "<=", 1e-12, "N, N m"),
            *(Check(f"τ(0) by {solver} over {form} minus the same", off, "<=", 1e-8) for form, off in forms.items()),
            Check("τ(0) for r̈ = −9 minus (−2, 5/2)", mirrored, "<=", 1e-12, "N, N m"),
            Check("τ(0) of the stack minus (104/11, −71/22)", first, "<=", 1e-8, "N, N m"),
            Check("stack and formula apart along the run", apart, "<=", 1e-6, "N, N m"),
            Check("error of x, damped", errors[0], "<", 1e-3, "m"),
            Check("error of x, not damped", errors[1], "<", 1e-2, "m"),
            Check("fastest turn, damped over not damped", calmed, "<", 1.0),
            *judge.common_checks(run),
        ]  # fmt: skip
        shown = [_first_instant(solver), _the_run(done, p)]
        return judge.verdict(damped, checks, figures=figures, sections=shown)


def _at_start(acceleration: float) -> WeightedTorque:
    """The problem at t = 0, at rest; M, J and J_gᵀ F by hand."""
    M, J = [[2.0, -0.25], [-0.25, 0.1625]], [[1.0, -0.5]]
    external = [FORCE[0], -0.5 * FORCE[0]]  # cos q2 = 0: the force along y does nothing
    return WeightedTorque(M, [0.0, 0.0], J, [acceleration], tau_0=TAU_0, tau_external=external)


def _by_formula(robot: PlanarRobot, run: wbc.Run, D: Vec, kp: float) -> Vec:
    """The closed form at every fifth tick of a run (k, 2)."""
    torques = []
    for t, q, v in zip(*(run[name][::EVERY] for name in ("t", "q", "v")), strict=True):
        J, drift = robot.J(q), robot.Jdot_v(q, v)
        x, rate = q[0] + 0.5 * np.cos(q[1]), J[0] @ v
        wanted = 9 * np.cos(3 * t) + 2 * np.sqrt(kp) * (3 * np.sin(3 * t) - rate) + kp * (1 - np.cos(3 * t) - x)
        problem = WeightedTorque(
            robot.M(q), robot.c(q, v), J[:1], [wanted], drift=drift[:1], tau_0=TAU_0 - D * v, tau_external=J.T @ FORCE
        )
        torques.append(problem.closed_form().tau)
    return np.array(torques)


def _first_instant(solver: str) -> Section:
    text = Text(
        "At t = 0 the robot is at rest at q = (0, π/2): M = [[2, −1/4], [−1/4, 13/80]], J_t = (1, −1/2), "
        "J_gᵀF = (−1, 1/2), τ₀ + J_gᵀF = (−2, 5/2). A = J_t M⁻¹ = (1/7, −20/7), Λ = (A J_tᵀ)⁻¹ = 7/11 and r̈ = +9, so "
        "λ = Λ (9 + 52/7) = 115/11 and τ = τ₀ + J_tᵀ λ = (104/11, −71/22). With −9 in place of 9, λ = −1 and τ = "
        "(−2, 5/2): that torque accelerates the task the wrong way."
    )
    rows: list[tuple[str | float, ...]] = []
    forms = ("torque", "acceleration", "joint")
    for sign, exact in ((1.0, TAU_START), (-1.0, TAU_WRONG_SIGN)):
        problem, by_hand = _at_start(sign * ACCELERATION), " and ".join(str(x) for x in exact)
        rows.append((f"r̈ = {sign * ACCELERATION:+g}, by hand", by_hand, *map(float, exact)))
        answers = [("closed form", problem.closed_form())]
        answers += [(f"{solver}, QP over {form}", problem.solve(solver, form=form)) for form in forms]
        for how, answer in answers:
            rows.append((f"r̈ = {sign * ACCELERATION:+g}, {how}", f"cost {answer.cost:.9g}", *map(float, answer.tau)))
    table = Table(("τ(0)", "exact, or cost", "τ1 [N]", "τ2 [N m]"), rows)
    return Section("The first instant", [text, table])


def _the_run(done: Sequence[Trial], p: Parameters) -> Section:
    run, dampings = done[0].run, (p["damping"], (0.0, 0.0))
    t, q = measure.times(run), run["q"]

    plots = [
        Plot("pr-task", "The task: x of the tip", "m", t,
             [Curve("x", q[:, 0] + 0.5 * np.cos(q[:, 1])), Curve("1 − cos 3t", 1 - np.cos(3 * t))]),
        judge.beside("pr-off", "Error of the task", "mm", done, lambda of: 1e3 * of.error("x"), replays=False),
        judge.beside(
            "pr-turn", "What the task leaves free: speed of link 2", "rad/s", done, lambda of: of.run["plant.v"][:, 1],
            replays=False, caption="τ₀ and the force keep turning link 2 faster where nothing damps it; τ₀ − D q̇ does, "
            "and does not touch the task.",
        ),
        judge.beside("pr-torque", "Torque of joint 2", "N m", done, lambda of: of.run["tau"][:, 1], replays=False),
    ]  # fmt: skip
    rows = [
        (
            of.name,
            float(D[0]),
            float(D[1]),
            1e3 * float(of.error("x").max()),
            float(np.abs(of.run["plant.v"][:, 1]).max()),
        )
        for of, D in zip(done, dampings, strict=True)
    ]  # fmt: skip
    table = Table(("run", "D1 [N s/m]", "D2 [N m s]", "largest error of x [mm]", "fastest turn [rad/s]"), rows)
    return Section("Tracking with a force at the tip", [*plots, table])
