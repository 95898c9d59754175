"""Metadata of a run: what the library reads of them must be of the kind that it writes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput

_NAMES = ("joint_names", "joint_units", "statuses", "fallback_levels")
_OF_MEMBERS = ("tasks", "contacts")
_MAPPINGS = ("limits", "distances", "residuals", "silent", "parameters", "beside")


def with_more(known: Mapping[str, Any], more: Mapping[str, Any]) -> dict[str, Any]:
    """``known`` metadata of a run and ``more``, which may replace the robot's name and nothing else.

    Raises:
        InvalidInput: more of what is known, or of another kind than is read, by its name.
    """
    check_metadata("meta", more)
    for name in more:
        if name in known and name != "robot":
            raise InvalidInput(f"meta[{name!r}] is known of the run, and cannot be given; take another name")
    return {**known, **more}


def check_metadata(where: str, meta: Mapping[str, Any]) -> None:
    """Refuse metadata of another kind; what is not there, or None, is left to who needs it.

    Raises:
        InvalidInput: by its name, in the file ``where``.
    """
    there = {name: value for name, value in meta.items() if value is not None}
    if "dt" in there:
        checks.number(f"{where}: dt", there["dt"], low=0.0, strict=True)
    for name in _NAMES:
        for k, one in enumerate(checks.items(f"{where}: {name}", there.get(name, ()), "names")):
            checks.text(f"{where}: {name}[{k}]", one)
    for k, row in enumerate(checks.items(f"{where}: active_rows", there.get("active_rows", ()), "rows")):
        checks.instance(f"{where}: active_rows[{k}]", row, Mapping, "an object")
    for name in (*_OF_MEMBERS, *_MAPPINGS):
        found = checks.instance(f"{where}: {name}", there.get(name, {}), Mapping, "an object")
        for one, about in found.items() if name in _OF_MEMBERS else ():
            checks.instance(f"{where}: {name}[{one!r}]", about, Mapping, "an object")


def plain(where: str, value: Any) -> Any:
    """``value`` in json's own types.

    Raises:
        InvalidInput: json has no such type.
    """
    if isinstance(value, Mapping):
        return {str(key): plain(f"{where}[{key!r}]", item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(f"{where}[{k}]", item) for k, item in enumerate(value)]
    if isinstance(value, np.ndarray | np.generic):
        return plain(where, value.tolist())
    if value is None or isinstance(value, str | bool | int | float):
        return value
    raise InvalidInput(f"{where} is a {type(value).__name__}; metadata is numbers, text, lists and mappings")
