"""Scenarios that ``wbc run`` finds by name. One file a scenario, one line here."""

from tasks.scenarios.arm_actuator_loss import ArmActuatorLoss
from tasks.scenarios.arm_collision import ArmCollision
from tasks.scenarios.arm_payload import ArmPayload
from tasks.scenarios.arm_reach import ArmReach
from tasks.scenarios.collision_dodge import CollisionDodge
from tasks.scenarios.diagnosis_statistics import DiagnosisStatistics
from tasks.scenarios.dual_arm import DualArm
from tasks.scenarios.fault_family import FaultFamily
from tasks.scenarios.fault_statistics import FaultStatistics
from tasks.scenarios.four_p_adaptive import FourPAdaptive
from tasks.scenarios.humanoid_joint_loss import HumanoidJointLoss
from tasks.scenarios.humanoid_stand import HumanoidStand
from tasks.scenarios.humanoid_step import HumanoidStep
from tasks.scenarios.pg_step import PgStep
from tasks.scenarios.position_drives import PositionControl
from tasks.scenarios.pr_fault import PrFault
from tasks.scenarios.pr_torque import PrTorque
from tasks.scenarios.quadruped_actuator_weak import QuadrupedActuatorWeak
from tasks.scenarios.quadruped_joint_loss import QuadrupedJointLoss
from tasks.scenarios.quadruped_stand import QuadrupedStand
from tasks.scenarios.quadruped_trot import QuadrupedTrotInPlace
from tasks.scenarios.reach_strict import ReachStrict
from tasks.scenarios.stand_family import StandFamily

SCENARIOS = {
    scenario.name: scenario
    for scenario in (
        HumanoidJointLoss(), QuadrupedJointLoss(), QuadrupedActuatorWeak(), FaultFamily(), StandFamily(),
        HumanoidStand(),
        HumanoidStep(), QuadrupedStand(), QuadrupedTrotInPlace(), DualArm(), ArmReach(), PgStep(), ArmPayload(),
        ArmActuatorLoss(), ArmCollision(), FaultStatistics(), DiagnosisStatistics(), FourPAdaptive(), PrTorque(),
        PrFault(), CollisionDodge(), ReachStrict(), PositionControl(),
    )
}  # fmt: skip
