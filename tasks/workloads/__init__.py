"""Workloads on which whole-body controllers are compared; ``wbc bench`` runs them by name.

Each is called as ``WORKLOADS["W5"](ticks=None, repeats=5, progress=None, solver="pdas")`` and answers with one row of
figures, a dict that ``json`` can write. What they are and what is timed: ``docs/benchmark.md``.
"""

from __future__ import annotations

from collections.abc import Mapping

from .humanoid_id import HumanoidInverseDynamics
from .humanoid_ik import HumanoidInverseKinematics
from .measure import Workload
from .panda_id import PandaInverseDynamics
from .panda_ik import PandaInverseKinematics
from .quadruped_id import QuadrupedInverseDynamics
from .readme import ReadmeStack

WORKLOADS: Mapping[str, Workload] = {
    workload.name: workload
    for workload in (
        PandaInverseKinematics(),
        HumanoidInverseKinematics(),
        PandaInverseDynamics(),
        QuadrupedInverseDynamics(),
        HumanoidInverseDynamics(),
        ReadmeStack(),
    )
}
