"""A run as one table: a row for each tick, a column for each number, its component and unit in the heading."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wbc.stack.member import EFFORTS

_POSE = [f"base_position_{axis}" for axis in "xyz"], [f"base_quaternion_{axis}" for axis in "xyzw"]
_TWIST = [f"base_linear_{axis}" for axis in "xyz"], [f"base_angular_{axis}" for axis in "xyz"]
_WRENCH = [f"{kind}_{axis}" for kind in ("force", "moment") for axis in "xyz"]
_PLAIN = {"t": "s", "tick_us": "µs", "push": "N"}


def table(columns: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """{heading: (N,)} of a run's columns, in their order: ``t [s]``, ``q.elbow [rad]``, ``error.Frame[tool].x [m]``.

    A heading is the column, the component where it has several, and the unit where it has one: joints by name; of a
    floating base ``base_position_x`` [m] and ``base_quaternion_x`` in the world, ``base_linear_x`` and
    ``base_angular_x`` in its own axes; of a wrench ``force_x`` [N] and ``moment_x`` [N m] in the axes of the surface;
    of a task its own labels; else the place, from 0. A bound on how far a task can be from its optimum
    (``distance.TASK``) holds for each row in its own unit: there is a column for each unit. ``status`` is the name of
    the status.
    """
    result: dict[str, NDArray[Any]] = {}
    for name, component, unit, values in numbers(columns, meta):
        heading = ".".join(part for part in (name, component) if part) + (f" [{unit}]" if unit else "")
        while heading in result:  # two rows of a task with one label
            heading += "'"
        result[heading] = values
    if "status" in columns and meta.get("statuses") and columns["status"].ndim == 1:
        names = list(meta["statuses"])
        codes = [int(code) for code in columns["status"]]
        result["status"] = np.array([names[c] if 0 <= c < len(names) else "" for c in codes], dtype=str)
    return result


def numbers(
    columns: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]
) -> Iterator[tuple[str, str, str, NDArray[Any]]]:
    """Column, component, unit and values (N,) of each number that a row of a run has, both empty where none is."""
    for name, values in columns.items():
        parts = list(_components(name, values, meta))
        for k, (component, unit) in enumerate(parts):
            yield name, component, unit, values if values.ndim == 1 else values.reshape(len(values), len(parts))[:, k]


def _components(name: str, values: NDArray[Any], meta: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Component and unit of each number that a row of the column has."""
    size = int(np.prod(values.shape[1:]))
    if values.ndim == 1:
        yield from (("", unit) for unit in _units_of_number(name, meta))
        return
    known = list(_known(name.removeprefix("plant."), size, meta))
    yield from known if len(known) == size else ((str(k), _PLAIN.get(name, "")) for k in range(size))


def _units_of_number(name: str, meta: Mapping[str, Any]) -> list[str]:
    """Each unit that a number is one in: a bound on all rows of a task is one on its metres, and on its radians."""
    start, _, rest = name.partition(".")
    if start == "distance":
        return str(meta.get("distances", {}).get(rest, "")).split(", ")
    if start == "plant" and rest.startswith("penetration."):
        return ["m"]
    return [_PLAIN.get(name, "")]


def _known(name: str, size: int, meta: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """What the columns that the library writes are made of; nothing for others."""
    start, _, rest = name.partition(".")
    joints, units = list(meta.get("joint_names") or ()), list(meta.get("joint_units") or ())
    if len(units) != len(joints):
        units = [""] * len(joints)
    base = size - len(joints)
    if name in ("q", "q_cmd") and joints:
        yield from _with(_POSE, ("m", "")) if base else ()
        yield from zip(joints, units, strict=True)
    elif name in ("v", "v_cmd", "a") and joints:
        per = "/s²" if name == "a" else "/s"
        yield from _with(_TWIST, (f"m{per}", f"rad{per}")) if base else ()
        yield from ((joint, unit and unit + per) for joint, unit in zip(joints, units, strict=True))
    elif name == "tau" and joints:
        yield from ((joint, EFFORTS.get(unit, "")) for joint, unit in zip(joints, units, strict=True))
    elif start == "f" and rest in meta.get("contacts", {}):
        parts = [*_WRENCH[:3], *_WRENCH[4:]] if size == 5 else _WRENCH[:size]  # an edge gives no moment about itself
        yield from ((part, "N" if part.startswith("force") else "N m") for part in parts)
    elif start == "error":
        about = meta.get("tasks", {}).get(rest, {})
        labels = list(about.get("labels") or [""] * size)
        yield from zip((label or str(k) for k, label in enumerate(labels)), about.get("units") or (), strict=False)
    elif start == "residual":
        yield from (("", unit) for unit in str(meta.get("residuals", {}).get(rest, "")).split(", "))
    elif name == "certificate":
        yield from zip(("primal_residual", "dual_residual", "gap"), ("", "", ""), strict=True)
    elif name == "push" or start == "slip":
        yield from zip("xyz"[:size], [_PLAIN.get(name, "m")] * size, strict=False)


def _with(halves: Sequence[Sequence[str]], units: Sequence[str]) -> Iterator[tuple[str, str]]:
    for names, unit in zip(halves, units, strict=True):
        yield from ((name, unit) for name in names)
