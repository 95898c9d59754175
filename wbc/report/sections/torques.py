"""Torques against their limits."""

from __future__ import annotations

from wbc.report import measure
from wbc.report.document import Section
from wbc.report.sections.use import use_plot, use_table
from wbc.sim.scenario import ScenarioResult


def section(result: ScenarioResult) -> Section | None:
    """Share of the torque limit over time and per joint."""
    run = result.run
    share, tau = measure.use(run).get("torque"), measure.torques(run)
    if share is None or tau is None or not share.size:
        return None
    bound = measure.limits(run)["tau_max"]
    units = ["N m" if unit == "rad" else "N" for unit in run.meta.get("joint_units", [])]
    table = use_table(run, tau, share, bound, units, kind="torque")
    return Section("Torques against limits", [use_plot(run, share, "torques", "Torque in use, |τ| / τ_max"), table])
