"""Draw the pictures of the documents anew, each from its scenario: ``python docs/draw_figures.py``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from wbc.tasks.scenarios import SCENARIOS

from wbc.report.document import Figure
from wbc.sim.scenario import silent

FOLDER = Path(__file__).parent / "figures"
#: Scenario, its settings, and which of its own figures are kept.
DRAWN: Mapping[str, tuple[Sequence[str], Sequence[str]]] = {
    "pg-step": (["robot=arm"], ["pg-plane"]),
    "4p-adaptive": ([], ["adaptive-coefficients"]),
    "pr-torque": ([], ["pr-tracking"]),
    "pr-fault": ([], ["fault-total"]),
}


def draw() -> None:
    """Run the scenarios and write their figures."""
    for name, (settings, wanted) in DRAWN.items():
        scenario = SCENARIOS[name]
        chosen = scenario.choose(plant=None, hierarchy=None, duration=None)
        result = scenario.run(scenario.parse(settings), solver="pdas", progress=silent, **chosen)
        for section in result.sections:
            for item in section(result).items:
                if isinstance(item, Figure) and item.name in wanted:
                    (FOLDER / f"{item.name}.{item.kind}").write_bytes(item.data)


if __name__ == "__main__":
    draw()
