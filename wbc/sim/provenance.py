"""Where numbers come from: versions of the packages in use, and the machine."""

from __future__ import annotations

import os
import platform
import sys
from datetime import datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

#: Distributions whose version decides numbers or times.
PACKAGES = (
    "wbc-qp", "numpy", "scipy", "pin", "mujoco", "daqp", "proxsuite", "osqp", "clarabel", "piqp", "qpsolvers", "numba",
    "example-robot-data",
)  # fmt: skip


def versions() -> dict[str, str]:
    """Version of Python and of each installed package that matters; nothing is imported."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def machine() -> dict[str, str | int]:
    """Processor, cores this process may use, and system; no names of hosts or people."""
    return {
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1,
        "system": f"{platform.system()} {platform.machine()}",
    }


def surroundings() -> dict[str, Any]:
    """When and where something is measured: date, machine, load, clock governor, versions."""
    governor = Path("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")
    return {
        "date": f"{datetime.now().astimezone():%Y-%m-%d %H:%M %Z}",
        "machine": machine(),
        "load": load(),
        "governor": governor.read_text(encoding="utf-8").strip() if governor.is_file() else "not told by the system",
        "versions": versions(),
    }


def load() -> list[float] | None:
    """How many processes wanted to run in the last 1, 5 and 15 minutes, where the system tells."""
    return [round(x, 2) for x in os.getloadavg()] if hasattr(os, "getloadavg") else None


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return platform.processor()
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.processor())
