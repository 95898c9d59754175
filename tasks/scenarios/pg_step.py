"""The largest step along a projected gradient: in the plane of two joints, and along the motion of an arm."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from io import BytesIO
from typing import Any, ClassVar, final

import numpy as np

import wbc
from wbc.errors import ModelError
from wbc.methods import ProjectedGradientStep
from wbc.models.pinocchio_ import PinocchioModel
from wbc.report import measure
from wbc.report.document import Bound, Curve, Figure, Plot, Section, Table, Text
from wbc.sim.plant import IntegratorPlant
from wbc.sim.scenario import Check, Parameter, Parameters, Scenario, ScenarioResult, Setup, Trial
from wbc.types import Index, Vec

from .. import JointPositionLimits, JointVelocityLimits, Manipulability, Position, ProjectedGradient, Sinusoid
from . import judge
from .arm_reach import tool

#: Ticks between two at which the closed form is asked too.
EVERY = 5
#: Two joints and one task: q̇1 + 2 q̇2 = 2, ∇H = (3/2, 1/2), |q̇1| <= 3/2, |q̇2| <= 6/5. α* = 11/10.
PLANE: Mapping[str, Any] = {
    "J": [[1.0, 2.0]], "task_velocity": [2.0], "gradient": [1.5, 0.5], "v_min": [-1.5, -1.2], "v_max": [1.5, 1.2],
}  # fmt: skip
ALPHA_IN_PLANE = 11.0 / 10.0


@final
@dataclass(frozen=True, eq=False)
class Setting:
    """Who climbs what, where, and how fast it may: α_max and the speed limits (n,)."""

    robot: PinocchioModel
    tool: str
    criterion: Manipulability
    alpha_max: float
    v_max: Vec
    solver: str


@final
@dataclass(frozen=True, eq=False)
class Beside:
    """The closed form at some ticks of a run, k of them, beside what the QP decided there.

    ``rows`` (k,) of the run; ``alpha`` (k,) α*; ``v_task`` (k, n) q̇_r; ``v_step`` and ``v_qp`` (k, n) both
    velocities; ``gradient`` (k, n) ∇H; ``value`` (k,) H.
    """

    rows: Index
    alpha: Vec
    v_task: Vec
    v_step: Vec
    v_qp: Vec
    gradient: Vec
    value: Vec

    def cost(self, v: Vec, alpha_max: float) -> Vec:
        """½ |v − α_max ∇H|² (k,): what the QP minimises."""
        return np.asarray(0.5 * ((v - alpha_max * self.gradient) ** 2).sum(axis=1))

    def climb(self, v: Vec) -> Vec:
        """∇Hᵀ (v − q̇_r) (k,): how much faster H rises than with the task alone."""
        return np.asarray((self.gradient * (v - self.v_task)).sum(axis=1))


@final
class PgStep(Scenario):
    """The tool follows a path; what joints are left climb its manipulability, within ``speed`` (a share) of the limits.

    The command is the QP over q̇: min ½ |q̇ − α_max ∇H|² under J q̇ = ṙ and all limits. Beside it, at the same states,
    the projected gradient step with the same α_max: q̇ = q̇_r + α* q̇_n, α* by its closed form.
    ``robot``: panda (needs example-robot-data, else arm).
    """

    name: ClassVar[str] = "pg-step"
    group: ClassVar[str] = "planar"
    takes = 12.0
    summary: ClassVar[str] = "the largest step along a projected gradient, beside the QP over velocities"
    parameters: ClassVar[Mapping[str, Parameter]] = {"robot": "panda", "alpha_max": 80.0, "speed": 0.2}
    duration = 6.0

    def build(self, p: Parameters) -> Setup:
        robot = _robot(p["robot"])
        setting = Setting(robot, tool(robot), Manipulability(tool(robot)), p["alpha_max"],
                          p["speed"] * robot.limits.v_max, p.settings.solver)  # fmt: skip
        plant = IntegratorPlant(robot, level="velocity")
        return Setup(stack=_stack(setting), plant=plant, level=wbc.VelocityLevel(regularisation=1e-10), about=setting)

    def judge(self, trials: Iterator[Trial], p: Parameters) -> ScenarioResult:
        (trial,) = trials
        return _judged(trial, trial.about, _beside(trial.run, trial.about))


def _robot(name: str) -> PinocchioModel:
    try:
        return wbc.load(name)
    except ModelError:
        if name != "panda":
            raise
        return wbc.load("arm")


def _stack(of: Setting) -> wbc.Stack:
    start = of.robot.state().frame(of.tool).position
    path = Sinusoid(start, amplitude=[0.06, 0.18, 0.08], frequency=[0.35, 0.25, 0.45])
    return wbc.Stack(
        [ProjectedGradient(of.criterion, gain=of.alpha_max, name="manipulability")],
        subject_to=[
            Position(of.tool, target=path, rate=20.0).exactly(name="path"), JointVelocityLimits(of.v_max),
            JointPositionLimits(),
        ],
    )  # fmt: skip


def _beside(run: wbc.Run, of: Setting) -> Beside:
    """Ask the closed form at every fifth tick for the task velocity that the QP was given there."""
    state, rows = of.robot.state(), np.arange(0, run.rows, EVERY)
    of.criterion.prepare(of.robot)
    tasks, steps, gradients, values = [], [], [], []
    for row in rows:
        state.update(0.0, run["q"][row], run["v"][row])
        J, gradient = state.frame(of.tool).jacobian()[:3], of.criterion.gradient(state)
        step = ProjectedGradientStep.from_gradient(
            J, J @ run["v_cmd"][row], gradient, v_min=-of.v_max, v_max=of.v_max, alpha_max=of.alpha_max
        )
        tasks.append(step.v_task)
        steps.append(step.closed_form())
        gradients.append(gradient)
        values.append(of.criterion.value(state))
    return Beside(
        rows, np.array([s.alpha for s in steps]), np.array(tasks), np.array([s.v for s in steps]), run["v_cmd"][rows],
        np.array(gradients), np.array(values),
    )  # fmt: skip


def _judged(trial: Trial, of: Setting, beside: Beside) -> ScenarioResult:
    run = trial.run
    plane, alpha_max = ProjectedGradientStep.from_gradient(**PLANE), of.alpha_max
    by_formula, by_qp = plane.closed_form().alpha, plane.solve(of.solver).alpha
    certified = run["status"][beside.rows] == list(run.meta["statuses"]).index("SOLVED")
    there = np.isfinite(beside.alpha) & certified
    gap = beside.cost(beside.v_qp, alpha_max) - beside.cost(beside.v_step, alpha_max)
    costlier = float(gap[there].max(initial=0.0))
    away = _away_from_positions(run, of.robot, beside)
    free = there & (beside.alpha >= alpha_max) & away
    same = float(np.abs(beside.v_qp - beside.v_step)[free].max(initial=0.0))
    over = float((np.abs(run["v_cmd"]) - of.v_max).max())
    figures = {
        "alpha_star_in_plane": by_formula,
        "alpha_star_smallest": float(np.nanmin(beside.alpha)),
        "share_of_ticks_with_a_full_step": float(np.mean(beside.alpha >= alpha_max)),
        "share_of_ticks_without_a_step": float(np.mean(np.isnan(beside.alpha))),
        "manipulability_start": float(beside.value[0]),
        "manipulability_end": float(beside.value[-1]),
        "climb_of_qp_over_climb_of_step": float(
            beside.climb(beside.v_qp)[there].sum() / beside.climb(beside.v_step)[there].sum()
        ),
    }
    checks = [
        Check("α* in the plane by formula minus 11/10", abs(by_formula - ALPHA_IN_PLANE), "<=", 1e-12),
        Check(f"α* in the plane by {of.solver} minus 11/10", abs(by_qp - ALPHA_IN_PLANE), "<=", 1e-8),
        Check("largest cost of the QP minus that of the step", costlier, "<=", 1e-8),
        Check("difference of QP and step where no limit is active", same, "<=", 1e-6, "rad/s"),
        Check("commanded speed beyond its share of the limit", max(over, 0.0), "<=", judge.TOLERANCE, "rad/s"),
        *judge.common_checks(run),
    ]  # fmt: skip
    shown = [_in_plane(plane, by_qp), _along_the_path(run, of, beside)]
    return judge.verdict(trial, checks, figures=figures, sections=shown)


def _away_from_positions(run: wbc.Run, robot: PinocchioModel, beside: Beside) -> Any:
    """Where the position limits cannot be felt: the step does not know them."""
    q = run["q"][beside.rows]
    margin = np.minimum(q - robot.limits.q_min, robot.limits.q_max - q)
    return (margin > 0.2).all(axis=1)


def _picture(plane: ProjectedGradientStep) -> list[Figure]:
    """The plane as a figure, the same bytes each time; none where the package that draws it is not installed."""
    if find_spec("matplotlib") is None:
        return []
    from matplotlib import rc_context

    memory = BytesIO()
    with rc_context({"svg.hashsalt": "wbc"}):
        plane.plot().savefig(memory, format="svg", metadata={"Date": None, "Creator": None})
    caption = "Two joints, one task: limits, task line, gradient, its projection, and the longest step along it."
    return [Figure("pg-plane", caption, memory.getvalue())]


def _in_plane(plane: ProjectedGradientStep, by_qp: float) -> Section:
    step = plane.closed_form()
    table = Table(
        ("quantity", "joint 1", "joint 2"),
        [
            ("task, q̇_r", *plane.v_task.tolist()), ("null space, q̇_n", *plane.v_null.tolist()),
            ("result", *step.v.tolist()),
        ],
        f"α* = min(11/10, 4) = {step.alpha:.12f} by formula, {by_qp:.12f} by QP; joint {step.active[0] + 1} stops it.",
    )  # fmt: skip
    return Section("The step in the plane of two joints", [*_picture(plane), table])


def _along_the_path(run: wbc.Run, of: Setting, beside: Beside) -> Section:
    t = measure.times(run)[beside.rows]
    both = (("QP over q̇", beside.v_qp), ("projected gradient step", beside.v_step))
    plots = [
        Plot("pg-alpha", "Largest feasible step along the projected gradient, α*", "", t,
             [Curve("α*, closed form", beside.alpha)], [Bound(of.alpha_max, "α_max")], zero=True,
             caption="A gap: the task alone is beyond a limit, and no step exists."),
        Plot("pg-climb", "Rise of the manipulability by it, ∇Hᵀ(q̇ − q̇_r)", "m³/s", t,
             [Curve(name, beside.climb(v)) for name, v in both],
             caption="Equal while no joint is at its limit. Where one is, the QP, which drives the arm, leaves the "
             "direction of the gradient; its cost is never larger."),
        Plot("pg-speed", "Speed of the fastest joint over its limit", "", t,
             [Curve(name, (np.abs(v) / of.v_max).max(axis=1)) for name, v in both], [Bound(1.0, "limit")], zero=True),
    ]  # fmt: skip
    text = Text(
        "Both get the same task velocity and the same limits of speed. The QP also knows the limits of position, and "
        "it needs no feasible q̇_r to start from."
    )
    return Section("The step along the motion of the arm", [text, *plots])
