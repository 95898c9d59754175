"""``wbc list``: what there is to run, by name."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table
from rich.text import Text

from wbc.cli.console import one_sentence


@one_sentence
def list_() -> None:
    """List scenarios, solvers, robots and workloads."""
    console = Console(highlight=False)
    for table in (_scenarios(), _solvers(), _robots(), _workloads()):
        console.print(table)
        console.print()


def table(title: str, *columns: str) -> Table:
    """A plain table with a title."""
    made = Table(title=Text(title, style="bold"), title_justify="left", box=None, pad_edge=False)
    for column in columns:
        made.add_column(column, overflow="fold")
    return made


def _scenarios() -> Table:
    from wbc.sim.scenario import scenarios

    made = table("Scenarios (wbc run NAME)", "name", "what happens", "--set")
    for name, scenario in scenarios().items():
        parameters = ", ".join(f"{key}={value}" for key, value in scenario.parameters.items())
        made.add_row(name, Text(scenario.summary), Text(parameters))
    return made


def _solvers() -> Table:
    from wbc.qp.solvers import SOLVERS

    made = table("Solvers (--solver NAME)", "name", "state", "")
    for solver in SOLVERS:
        state = "usable" if solver.available() else f"pip install {solver.package}"
        made.add_row(solver.name, Text(state), "offline only" if solver.offline else "")
    return made


def _robots() -> Table:
    from wbc.errors import ModelError
    from wbc.models.catalogue import EXAMPLES, OWN, example_robots

    made = table("Robots (wbc.load(NAME), or the path of a URDF)", "names", "where")
    made.add_row(Text(", ".join(OWN)), "ours, always there")
    try:
        example_robots()
        state = "in example-robot-data"
    except ModelError:
        state = "pip install example-robot-data"
    made.add_row(Text(", ".join(EXAMPLES)), state)
    return made


def _workloads() -> Table:
    from wbc.cli.bench import workloads

    made = table("Workloads (wbc bench NAME)", "name", "what is timed")
    for name, workload in workloads().items():
        made.add_row(name, Text(workload.title))
    return made
