"""Five workloads on which whole-body controllers are compared; ``wbc bench`` runs them by name.

Each is called as ``WORKLOADS["W5"](ticks=None, repeats=5, progress=None, solver="pdas")`` and answers with one row of
figures, a dict that ``json`` can write. What they are and what is timed: ``docs/benchmark.md``.
"""

from __future__ import annotations

from collections.abc import Mapping

from tasks.workloads.humanoid_id import HumanoidInverseDynamics
from tasks.workloads.humanoid_ik import HumanoidInverseKinematics
from tasks.workloads.panda_id import PandaInverseDynamics
from tasks.workloads.panda_ik import PandaInverseKinematics
from tasks.workloads.quadruped_id import QuadrupedInverseDynamics
from tasks.workloads.workload import Workload

WORKLOADS: Mapping[str, Workload] = {
    workload.name: workload
    for workload in (
        PandaInverseKinematics(),
        HumanoidInverseKinematics(),
        PandaInverseDynamics(),
        QuadrupedInverseDynamics(),
        HumanoidInverseDynamics(),
    )
}
