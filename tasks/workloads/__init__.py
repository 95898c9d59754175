"""Workloads: scenarios on which whole-body controllers are compared; ``wbc bench`` times them by name.

``wbc.sim.bench.bench(WORKLOADS["W5"])`` answers with one row of figures, a dict that ``json`` can write. What they are
and what is timed: ``docs/benchmark.md``.
"""

from __future__ import annotations

from collections.abc import Mapping

from .humanoid_id import HumanoidInverseDynamics
from .humanoid_ik import HumanoidInverseKinematics
from .panda_id import PandaInverseDynamics
from .panda_ik import PandaInverseKinematics
from .quadruped_id import QuadrupedInverseDynamics
from .readme import ReadmeStack
from .workload import Workload

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
