"""The sections of a run report, one file each: ``section(result) -> Section | None``."""

from __future__ import annotations

from collections.abc import Callable

from wbc.report.document import Section
from wbc.report.sections import (
    caveats,
    centre_of_mass,
    contacts,
    joints,
    limits,
    motion,
    settings,
    smoothness,
    solver,
    timing,
    tracking,
    verdict,
)
from wbc.sim.scenario import ScenarioResult

#: In the order in which they are read.
SECTIONS: tuple[Callable[[ScenarioResult], Section | None], ...] = (
    verdict.section,
    motion.section,
    tracking.section,
    limits.section,
    joints.torques,
    joints.section,
    smoothness.section,
    contacts.section,
    centre_of_mass.section,
    timing.section,
    solver.section,
    settings.section,
    caveats.section,
)
