"""Draw pg-plane.svg and report.png of the documents anew from their scenarios: ``python docs/draw_figures.py``."""

from __future__ import annotations

import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from wbc.tasks.scenarios import SCENARIOS

from wbc.report import run_report, write
from wbc.report.document import Figure
from wbc.sim.scenario import Settings

FOLDER = Path(__file__).parent / "figures"
#: Scenario, its settings, and which of its own figures are kept.
DRAWN: Mapping[str, tuple[Sequence[str], Sequence[str]]] = {
    "pg-step": (["robot=arm"], ["pg-plane"]),
}


def draw() -> None:
    """Run the scenarios and write their figures."""
    for name, (settings, wanted) in DRAWN.items():
        scenario = SCENARIOS[name]
        chosen = scenario.choose(plant=None, hierarchy=None, duration=None)
        result = scenario.run(scenario.parse(settings), Settings(**chosen))
        for section in result.sections:
            for item in section.items:
                if isinstance(item, Figure) and item.name in wanted:
                    (FOLDER / f"{item.name}.{item.kind}").write_bytes(item.data)


def photograph() -> None:
    """Run a scenario that fails and write what Chromium, which has to be installed, shows of its page."""
    scenario = SCENARIOS["quadruped-stand"]
    chosen = scenario.choose(plant=None, hierarchy=None, duration=4.0)
    result = scenario.run(scenario.parse(["push=120"]), Settings(**chosen))
    with TemporaryDirectory() as folder:
        write(run_report(result), Path(folder))
        command = ["chromium", "--headless=new", "--no-sandbox", "--enable-unsafe-swiftshader", "--hide-scrollbars",
                   "--window-size=1280,860", "--timeout=8000", f"--screenshot={FOLDER / 'report.png'}",
                   (Path(folder) / "report.html").as_uri()]  # fmt: skip
        subprocess.run(command, check=True, stderr=subprocess.DEVNULL)


if __name__ == "__main__":
    draw()
    photograph()
