"""Adaptive control of four sliding masses with unknown masses."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, ClassVar, NamedTuple, final

import numpy as np

import wbc
from wbc.models import Planar4P
from wbc.report import measure
from wbc.report.document import Bound, Curve, Plot, Section, Table, Text
from wbc.sim.scenario import Check, Parameter, Parameters, Scenario, ScenarioResult, Setup, Trial
from wbc.types import Vec

from .. import SlotineLi, TorqueLimits
from . import judge
from .exact_plant import EXACT, ExactPlant

#: The motion that excites everything: amplitudes [m] and angular frequencies [rad/s]; and the place to stay at [m].
AMPLITUDE, FREQUENCY = np.array([0.5, 0.4, 0.3, 0.3]), np.array([2.0, 0.9, 3.1, 1.7])
PLACE = np.array([0.3, 0.2, -0.1, 0.1])
NAMES = ("a1 = m1 + m2 + m3 + m4", "a2 = m2 + m3 + m4", "a3 = m3 + m4", "a4 = m4")
#: Errors at the end count from so long before it [s].
LAST = 2.0


def exciting(t: float) -> tuple[Vec, Vec, Vec]:
    """q_d, q̇_d, q̈_d of a motion along which all four coefficients can be told apart."""
    sin, cos = AMPLITUDE * np.sin(FREQUENCY * t), AMPLITUDE * np.cos(FREQUENCY * t)
    return sin, FREQUENCY * cos, -(FREQUENCY**2) * sin


class Adapted(NamedTuple):
    """A run and the true coefficients (4,) [kg]."""

    run: wbc.Run
    truth: Vec
    still: bool

    def signal(self, name: str) -> Vec:
        """What the component recorded."""
        return np.asarray(self.run[f"signal.SlotineLi.{name}"])

    @property
    def error(self) -> Vec:
        """q_d − q (N, 4) [m]."""
        wanted = PLACE if self.still else np.array([exciting(t)[0] for t in self.run["t"]])
        return np.asarray(wanted - self.run["q"])

    @property
    def last_error(self) -> float:
        """Largest error of the last two seconds [m]."""
        t = self.run["t"]
        return float(np.abs(self.error[t >= t[-1] - LAST]).max())

    @property
    def rise(self) -> float:
        """Largest rise of V in one tick, relative to V(0)."""
        V = self.signal("V")
        return float(np.diff(V).max(initial=0.0) / V[0])

    @property
    def off(self) -> Vec:
        """|a − â| (4,) [kg] at the end."""
        return np.asarray(np.abs(self.truth - self.signal("a_hat")[-1]))


@final
class FourPAdaptive(Scenario):
    """A 4P robot of unknown masses ``m`` [kg] follows a motion from â = 0, then another one only goes to a place.

    The controller's model has unit masses and none of them is used. ``gain`` is Γ; with ``physical`` the coefficients
    stay among those that masses can have, a1 ≥ a2 ≥ a3 ≥ a4 ≥ 0.
    """

    name: ClassVar[str] = "4p-adaptive"
    group: ClassVar[str] = "planar"
    takes = 25.0
    summary: ClassVar[str] = "adaptive tracking with unknown masses, with and without excitation"
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "m": (2.0, 1.0, 1.5, 0.5), "kp": 100.0, "kd": 40.0, "gain": 20.0, "physical": True,
    }  # fmt: skip
    duration = 10.0

    def cases(self, p: Parameters) -> dict[str, dict[str, Any]]:
        return {"moving": {"still": False}, "at rest": {"still": True}}

    def build(self, p: Parameters) -> Setup:
        limits: dict[str, Any] = {"v_max": 5.0, "tau_max": 500.0}
        true, model = Planar4P(m=p["m"], **limits), Planar4P(**limits)
        adaptive = SlotineLi(
            PLACE if p["still"] else exciting, kp=p["kp"], kd=p["kd"], gain=p["gain"], physical=p["physical"],
            truth=true.coefficients,
        )  # fmt: skip
        return Setup(
            stack=wbc.Stack([adaptive.torque], subject_to=[TorqueLimits()], components=[adaptive]),
            plant=ExactPlant(true), robot=model, level=EXACT,
            meta={"model": "the controller's model has other masses than the plant, and uses none of them"},
        )  # fmt: skip

    def judge(self, trials: Iterator[Trial], p: Parameters) -> ScenarioResult:
        done = list(trials)
        moving, still = (Adapted(of.run, of.robot.coefficients, of.name == "at rest") for of in done)
        run = moving.run
        law = float(np.abs(run["tau"] - moving.signal("tau")).max())
        ordered = max(_out_of_order(of.signal("a_hat")) for of in (moving, still))
        unit_masses = Planar4P().cartesian_inertia(np.zeros(4))
        figures = {
            "cartesian_inertia_x_kg": float(unit_masses[0, 0]),
            "cartesian_inertia_y_kg": float(unit_masses[1, 1]),
            "last_error_moving_m": moving.last_error,
            "last_error_still_m": still.last_error,
            **{f"off_a{i + 1}_moving_kg": float(x) for i, x in enumerate(moving.off)},
            **{f"off_a{i + 1}_still_kg": float(x) for i, x in enumerate(still.off)},
        }
        checks = [
            Check("M_r of unit masses minus diag(2, 1)", float(np.abs(unit_masses - np.diag([2.0, 1.0])).max()), "<=",
                  1e-12, "kg"),
            Check("command minus the law τ_SL", law, "<=", 1e-9, "N"),
            Check("largest error of the last 2 s, moving", moving.last_error, "<", 1e-3, "m"),
            Check("largest error of the last 2 s, at rest", still.last_error, "<", 1e-3, "m"),
            Check("rise of V in one tick over V(0), moving", moving.rise, "<=", 1e-6),
            Check("rise of V in one tick over V(0), at rest", still.rise, "<=", 1e-6),
            Check("coefficients not found, moving", float(moving.off.max()), "<", 0.05, "kg"),
            Check("a2 and a4 not found, at rest", float(still.off[[1, 3]].max()), "<", 1e-3, "kg"),
            *judge.common_checks(run),
        ]  # fmt: skip
        if p["physical"]:
            checks.append(
                Check("by how much the coefficients are outside those of positive masses", ordered, "<=", 1e-9, "kg")
            )
        shown = [_coefficients(moving, still), _errors(moving, still)]
        return judge.verdict(done[0], checks, tracking={}, figures=figures, robot=Planar4P(m=p["m"]), sections=shown)


def _out_of_order(a_hat: Vec) -> float:
    """By how much â breaks a1 ≥ a2 ≥ a3 ≥ a4 ≥ 0 [kg]."""
    return float(max(0.0, np.diff(a_hat, axis=1).max(), -a_hat[:, 3].min()))


def _coefficients(moving: Adapted, still: Adapted) -> Section:
    plots = [
        Plot(f"coefficients-{name}", title, "kg", measure.times(of.run),
             [Curve(f"â{i + 1} ({of.truth[i]:g})", of.signal("a_hat")[:, i]) for i in range(4)],
             [Bound(value, f"true a{i + 1}") for i, value in enumerate(of.truth)], caption=caption)
        for name, of, title, caption in (
            ("moving", moving, "Estimates along a motion that excites all of them", "From â = 0; dashed: the truth."),
            ("rest", still, "Estimates at rest", "Gravity alone excites, so a2 and a4 are found; a1 and a3 stop where "
             "they happen to be, though the error vanishes."),
        )
    ]  # fmt: skip
    rows = [
        (NAMES[i], float(moving.truth[i]), float(moving.signal("a_hat")[-1, i]), float(still.signal("a_hat")[-1, i]))
        for i in range(4)
    ]
    table = Table(("coefficient [kg]", "truth", "moving, at the end", "at rest, at the end"), rows)
    return Section("What is found out", [*plots, table])


def _errors(moving: Adapted, still: Adapted) -> Section:
    both, t = (("moving", moving), ("at rest", still)), measure.times(moving.run)
    plots = [
        Plot("adaptive-error", "Largest error of the four joints", "mm", t,
             [Curve(name, np.maximum(1e3 * np.abs(of.error).max(axis=1), 1e-6)) for name, of in both], log="y",
             caption="Errors below 1e-6 mm are drawn as 1e-6 mm."),
        Plot("adaptive-lyapunov", "Lyapunov's function V", "", t,
             [Curve(name, of.signal("V")) for name, of in both], log="y",
             caption="V = ½ sᵀM s + eᵀK_P e + ½ (a − â)ᵀ Γ⁻¹ (a − â). At rest the part of a − â that nothing excites "
             "is left; in motion, what ticks of a millisecond leave."),
    ]  # fmt: skip
    text = Text(
        f"No tick of the two runs raises V by more than {max(moving.rise, still.rise):.1g} of its first value. "
        "The law needs neither accelerations nor an inverse of the estimated inertia matrix, so â may start at zero."
    )
    return Section("Errors and Lyapunov's function", [*plots, text])
