"""What this run does not show. Every report ends with it."""

from __future__ import annotations

import numpy as np

from wbc.report import measure
from wbc.report.document import Section, Text
from wbc.sim.scenario import ScenarioResult


def section(result: ScenarioResult) -> Section:
    """Sentences, each true of this very run."""
    sentences = [*_evidence(result), *_model(result), *_time(result)]
    return Section("Limits of this run", [Text(sentence) for sentence in sentences])


def _evidence(result: ScenarioResult) -> list[str]:
    meta = result.run.meta
    seed = meta.get("seed")
    return [
        "One run" + (f" with seed {seed}" if seed is not None else "") + ": it shows that this happened, not how often "
        "it happens. Nothing here was measured on hardware.",
        "An answer counts as solved when its own certificate holds: primal residual at most 1e-6 in the row's unit, "
        "stationarity and complementarity to 1e-6 relative to the cost. The largest residuals stand under Solver.",
    ]


def _model(result: ScenarioResult) -> list[str]:
    run = result.run
    plant = run.meta.get("plant") or {}
    kind = plant.get("plant", "the plant")
    known = run.meta.get("model") or (
        "controller and plant were built from the same robot description, so the model is exact unless a disturbance "
        "says otherwise"
    )
    sentences = [f"The plant is {kind}; {known}."]
    if not any("noise" in str(text) for text in run.meta.get("disturbances", [])):
        sentences.append("The controller was given the true state, base included: no sensor noise, no estimator.")
    if "plant.v" not in run:
        sentences.append(
            "The plant recorded no state of its own; positions and velocities are those given to the controller."
        )
    if run.meta.get("contacts") and not any(name.startswith("plant.f.") for name in run):
        sentences.append("The plant measured no contact forces; those shown are the commanded ones.")
    bound = measure.limits(run)
    joints = run.meta["joint_names"]
    without = [name for name, limit in zip(joints, bound["tau_max"], strict=True) if not 0 < limit < np.inf]
    if without and "torque" in measure.use(run):
        sentences.append(f"{len(without)} of {len(joints)} joints have no torque limit in the model: {_some(without)}.")
    return sentences


def _time(result: ScenarioResult) -> list[str]:
    machine = result.run.meta.get("machine") or {}
    text = ", ".join(f"{key} {value}" for key, value in machine.items()) or "an unnamed machine"
    return [
        f"Tick times are wall clock on {text}; other work on the machine is in them, and the maximum above all is the "
        "machine's. The first ticks start cold and are included; all others start from the answer before them."
    ]


def _some(names: list[str]) -> str:
    return ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")
