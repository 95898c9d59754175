"""Everything that would be needed to do the run again: parameters, plant, robot, versions, machine."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from wbc.report.document import Item, Section, Table, formatted
from wbc.sim.scenario import ScenarioResult

#: The unit that the name of a figure ends with.
UNITS = {"us": "µs", "deg": "°", "Nm": "N m"} | {
    unit: unit for unit in ("m", "mm", "s", "ms", "rad", "N", "kg", "W", "J")
}
SECONDS = ("dt", "duration", "simulated")
CONTROLLER = ("scenario", "robot", "level", "hierarchy", "solver", "feedback", "dt", "duration", "seed")


def section(result: ScenarioResult) -> Section:
    """Tables of the settings, disturbances, contacts, plant, versions and machine."""
    meta = result.run.meta
    settings = [(setting_name(key), shown(meta[key])) for key in CONTROLLER if key in meta]
    parameters = flat({"parameters": meta.get("parameters", {})})
    settings += [(setting_name(key), shown(value)) for key, value in parameters]
    items: list[Item] = [Table(("setting", "value"), settings)]
    robot = result.robot
    if robot is not None:
        rows = [
            ("mass [kg]", shown(robot.mass)),
            ("joints", shown(robot.nj)),
            ("base", getattr(robot, "base", "fixed")),
            ("velocities", shown(robot.nv)),
            ("gravity [m/s²]", shown([float(x) + 0.0 for x in robot.gravity])),
        ]
        items.append(Table((f"robot {robot.name}", "value"), rows))
    disturbances = [(str(i + 1), text) for i, text in enumerate(meta.get("disturbances", []))]
    if disturbances:
        items.append(Table(("", "disturbance"), disturbances))
    for key in ("machine", "plant", "versions"):
        rows = [(name, shown(value)) for name, value in flat(meta.get(key) or {})]
        if rows:
            items.append(Table((key, "value"), rows))
    if meta.get("stack"):
        items.append(
            Table(("stack",), [(line,) for line in str(meta["stack"]).splitlines()], "The stack.", folded=True)
        )
    return Section("Settings", items)


def measured(*settings: Mapping[str, Any], caption: str, folded: bool = True) -> Table:
    """Where and how something was measured: what each of ``settings`` says, in their order."""
    rows = [(name, shown(value)) for one in settings for name, value in flat(one)]
    return Table(("", "value"), rows, caption, folded=folded)


def shown(value: Any) -> str:
    """A setting as text: lists in brackets."""
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(f"{x:g}" if isinstance(x, float) else str(x) for x in value) + "]"
    return formatted(value) if value is None or isinstance(value, (str, bool, int, float)) else str(value)


def setting_name(key: str) -> str:
    """The name of a setting in words, with its unit: ``parameters.push`` is "parameter push"."""
    return f"{key} [s]" if key in SECONDS else key.replace("parameters.", "parameter ", 1)


def figure_name(key: str) -> str:
    """The name of a figure in words, with its unit: ``com_rms_m`` is "com rms [m]"."""
    words, _, unit = key.rpartition("_")
    return f"{words.replace('_', ' ')} [{UNITS[unit]}]" if words and unit in UNITS else key.replace("_", " ")


def flat(mapping: Mapping[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    """Nested mappings as dotted names."""
    rows: list[tuple[str, Any]] = []
    for key, value in mapping.items():
        rows += flat(value, f"{prefix}{key}.") if isinstance(value, Mapping) else [(f"{prefix}{key}", value)]
    return rows
