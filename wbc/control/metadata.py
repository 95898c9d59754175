"""Metadata of a run that were read from a file: what the library reads of them must be of the kind that it writes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from wbc import checks

_NAMES = ("joint_names", "joint_units", "statuses")
_OF_MEMBERS = ("tasks", "contacts")
_MAPPINGS = ("limits", "distances", "residuals", "silent", "parameters", "beside")


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
