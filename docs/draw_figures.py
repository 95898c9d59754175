"""Draw the figures of methods.md and report.png anew from their scenarios: ``python docs/draw_figures.py``."""

from __future__ import annotations

import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure as Drawing
from wbc.tasks.scenarios import SCENARIOS

from wbc.methods.step_picture import STYLE
from wbc.report import run_report, write
from wbc.report.document import Figure, Plot
from wbc.sim.scenario import ScenarioResult, Settings

FOLDER = Path(__file__).parent / "figures"
#: A curve is drawn through at most so many of its values.
MOST = 1000
COLOURS = ("#2b6cb0", "#dd7a1f", "#2f8f5b", "#7b5aa6")
#: Figure, the scenario that it is drawn from, and the plots of its page, from top to bottom; none: its own drawing.
DRAWN: Sequence[tuple[str, str, Sequence[str], Sequence[str]]] = (
    ("pg-plane", "pg-step", ["robot=arm"], ()),
    ("adaptive-coefficients", "4p-adaptive", [], ("coefficients-moving", "coefficients-rest")),
    ("pr-tracking", "pr-torque", [], ("pr-task", "pr-turn", "pr-torque")),
    ("fault-total", "pr-fault", [], ("fault-dead", "fault-healthy")),
)


def draw() -> None:
    """Run the scenarios and write their figures."""
    for name, of, settings, wanted in DRAWN:
        scenario = SCENARIOS[of]
        chosen = scenario.choose(plant=None, hierarchy=None, duration=None)
        items = _items(scenario.run(scenario.parse(settings), Settings(**chosen)))
        if wanted:
            _stack([items[plot] for plot in wanted], FOLDER / f"{name}.svg")
        else:
            (FOLDER / f"{name}.svg").write_bytes(items[name].data)


def _items(result: ScenarioResult) -> Mapping[str, Any]:
    """Figures and plots of a scenario's page, by name."""
    return {item.name: item for section in result.sections for item in section.items if isinstance(item, Figure | Plot)}


def _stack(plots: Sequence[Plot], path: Path) -> None:
    """Draw plots over time, one below the other, and write them as a vector graphic with text."""
    with rc_context({**STYLE, "svg.fonttype": "none"}):
        drawing = Drawing(figsize=(8.0, 0.2 + 2.2 * len(plots)), layout="constrained", facecolor="white")
        for axes, plot in zip(drawing.subplots(len(plots), 1, squeeze=False)[:, 0], plots, strict=True):
            axes.set_title(plot.title, loc="left", fontsize=9.5, fontweight="bold")
            for i, curve in enumerate(curve for curve in plot.curves if curve.shown):
                few = np.linspace(0, len(plot.x) - 1, min(len(plot.x), MOST)).astype(int)
                axes.plot(plot.x[few], curve.values[few], color=COLOURS[i], label=curve.label, lw=1.2 if i else 2.2)
            for bound in plot.bounds:
                axes.axhline(bound.value, color="#9aa5b1", ls="--", lw=0.8)
            axes.set(xlabel="time [s]", ylabel=f"[{plot.unit}]", xlim=(plot.x[0], plot.x[-1]))
            axes.spines[["top", "right"]].set_visible(False)
            axes.grid(color="#e3e8ee", lw=0.6)
            axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=len(plot.curves), fontsize=8.5)
        drawing.savefig(path, format="svg", metadata={"Date": None})


def photograph() -> None:
    """Run a scenario that fails and write what Chromium, which has to be installed, shows of its page."""
    scenario = SCENARIOS["quadruped-stand"]
    chosen = scenario.choose(plant=None, hierarchy=None, duration=4.0)
    result = scenario.run(scenario.parse(["push=120"]), Settings(**chosen))
    with TemporaryDirectory() as folder:
        write(run_report(result), Path(folder))
        command = ["chromium", "--headless=new", "--no-sandbox", "--enable-unsafe-swiftshader", "--hide-scrollbars",
                   "--window-size=1280,860", "--virtual-time-budget=20000", f"--screenshot={FOLDER / 'report.png'}",
                   "--run-all-compositor-stages-before-draw",  # else before the 3-D view is drawn
                   (Path(folder) / "report.html").as_uri()]  # fmt: skip
        subprocess.run(command, check=True, stderr=subprocess.DEVNULL)


if __name__ == "__main__":
    draw()
    photograph()
