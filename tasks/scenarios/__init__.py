"""The scenarios that commands find by name, those that are timed, soaked or measured as they grow among them."""

from __future__ import annotations

from collections.abc import Mapping

from wbc.sim.scenario import Scenario

from ..workloads import WORKLOADS
from ..workloads.scaling import AXES
from .arm_actuator_loss import ArmActuatorLoss
from .arm_collision import ArmCollision
from .arm_payload import ArmPayload
from .arm_reach import ArmReach
from .collision_dodge import CollisionDodge
from .diagnosis_statistics import DiagnosisStatistics
from .dual_arm import DualArm
from .fault_family import FaultFamily
from .fault_statistics import FaultStatistics
from .four_p_adaptive import FourPAdaptive
from .humanoid_joint_loss import HumanoidJointLoss
from .humanoid_stand import HumanoidStand
from .humanoid_step import HumanoidStep
from .pg_step import PgStep
from .position_drives import PositionControl
from .pr_fault import PrFault
from .pr_torque import PrTorque
from .quadruped_actuator_weak import QuadrupedActuatorWeak
from .quadruped_joint_loss import QuadrupedJointLoss
from .quadruped_stand import QuadrupedStand
from .quadruped_trot import QuadrupedTrotInPlace
from .reach_strict import ReachStrict
from .soaks import SOAKS
from .stand_family import StandFamily

SCENARIOS: Mapping[str, Scenario] = {**WORKLOADS, **AXES, **SOAKS} | {
    scenario.name: scenario
    for scenario in (
        HumanoidJointLoss(), QuadrupedJointLoss(), QuadrupedActuatorWeak(), FaultFamily(), StandFamily(),
        HumanoidStand(),
        HumanoidStep(), QuadrupedStand(), QuadrupedTrotInPlace(), DualArm(), ArmReach(), PgStep(), ArmPayload(),
        ArmActuatorLoss(), ArmCollision(), FaultStatistics(), DiagnosisStatistics(), FourPAdaptive(), PrTorque(),
        PrFault(), CollisionDodge(), ReachStrict(), PositionControl(),
    )
}  # fmt: skip
