"""``wbc list``: what there is to run, by name."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from rich.table import Table
from rich.text import Text

from wbc.cli.console import one_sentence, remaining, say, table
from wbc.cli.options import AsJson

if TYPE_CHECKING:
    from wbc.sim.scenario import Scenario


@one_sentence
def list_(*, as_json: AsJson = False) -> None:
    """List scenarios, solvers and robots."""
    found = members()
    if as_json:
        print(json.dumps(found, ensure_ascii=False, allow_nan=False))
        return
    for made in _tables(found):
        say(made, "")


def members() -> dict[str, Any]:
    """Everything that commands find by name, as JSON values."""
    from wbc.models.catalogue import EXAMPLES, OWN
    from wbc.qp.solvers import SOLVERS
    from wbc.sim.scenario import scenarios

    return {
        "scenarios": described(found := scenarios()),
        "solvers": {
            solver.name: {"usable": solver.available(), "package": solver.package, "offline": solver.offline}
            for solver in SOLVERS
        },
        "robots": {"own": list(OWN), "examples": list(EXAMPLES), "examples_installed": _has_examples()},
        "workloads": {name: one.summary for name, one in found.items() if one.group == "workloads"},
    }


def described(scenarios: Mapping[str, Scenario]) -> dict[str, Any]:
    """Scenarios by name, as JSON values."""
    from wbc.report.record import plain

    return {
        name: {
            "summary": scenario.summary,
            "parameters": plain(scenario.parameters),
            "plants": list(scenario.plants),
            "hierarchies": list(scenario.hierarchies),
            "duration_s": scenario.duration,
            "group": scenario.group,
            "takes_s": scenario.takes,
        }
        for name, scenario in sorted(scenarios.items(), key=lambda item: item[1].group)
    }


def listed(scenarios: Mapping[str, Any]) -> Table:
    """A table of what :func:`described` says: groups, how long each takes, what happens, and its parameters."""
    made = table("Scenarios (wbc run NAME)", "group", "name", "takes", "what happens", "--set")
    made.columns[1].no_wrap = True  # a name is to be copied
    for name, scenario in scenarios.items():
        parameters = ", ".join(f"{key}={_typed(value)}" for key, value in scenario["parameters"].items())
        group, takes = scenario["group"], scenario["takes_s"]
        made.add_row(Text(group), Text(name), "" if takes is None else remaining(takes), Text(scenario["summary"]),
                     Text(parameters))  # fmt: skip
    return made


def _tables(found: dict[str, Any]) -> list[Table]:
    solvers = table("Solvers (--solver NAME)", "name", "state", "")
    for name, solver in found["solvers"].items():
        state = "usable" if solver["usable"] else f"pip install {solver['package']}"
        solvers.add_row(name, Text(state), "offline only" if solver["offline"] else "")
    robots = table("Robots (wbc.load(NAME), or the path of a URDF)", "names", "where")
    robots.add_row(Text(", ".join(found["robots"]["own"])), "ours, always there")
    state = "in example-robot-data" if found["robots"]["examples_installed"] else "pip install example-robot-data"
    robots.add_row(Text(", ".join(found["robots"]["examples"])), state)
    return [listed(found["scenarios"]), solvers, robots]


def _typed(value: Any) -> str:
    """A parameter's value as one types it after --set."""
    return ",".join(f"{item:g}" for item in value) if isinstance(value, list) else str(value)


def _has_examples() -> bool:
    from wbc.errors import ModelError
    from wbc.models.catalogue import example_robots

    try:
        example_robots()
    except ModelError:
        return False
    return True
