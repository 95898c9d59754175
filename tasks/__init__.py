"""The library: tasks, limits, contacts and components for stacks. One file a member, one line here.

Example:
    >>> import wbc
    >>> from wbc.tasks import Frame, JointVelocityLimits, Posture
    >>> robot = wbc.load("arm")
    >>> tool = robot.frame_names[-1]
    >>> stack = wbc.Stack(
    ...     [Frame(tool, target=robot.state().frame(tool).placement), Posture(robot.q0, weight=1e-3)],
    ...     subject_to=[JointVelocityLimits()],
    ... )
"""

if __name__ == "tasks":  # found by its short name: there is one library, wbc.tasks
    from wbc.short_name import hand_over

    hand_over(__name__)

from wbc.models.collision import Obstacle as Obstacle

from .admittance import Admittance as Admittance
from .angular_momentum import AngularMomentum as AngularMomentum
from .axis_alignment import AxisAlignment as AxisAlignment
from .capture_point import CapturePoint as CapturePoint
from .center_of_pressure import CenterOfPressure as CenterOfPressure
from .centroidal_momentum import CentroidalMomentum as CentroidalMomentum
from .com import CenterOfMass as CenterOfMass
from .components.contact_schedule import ContactSchedule as ContactSchedule
from .components.fault_reaction import FaultReaction as FaultReaction
from .components.fault_reaction import When as When
from .components.measured_wrench import MeasuredWrench as MeasuredWrench
from .components.momentum_observer import MomentumObserver as MomentumObserver
from .components.reactions import Brake as Brake
from .components.reactions import Cap as Cap
from .components.reactions import Carry as Carry
from .components.reactions import Compensate as Compensate
from .components.reactions import Comply as Comply
from .components.reactions import Derate as Derate
from .components.reactions import Release as Release
from .components.reactions import Retarget as Retarget
from .components.reactions import Stop as Stop
from .components.reactions import Weigh as Weigh
from .components.slotine_li import SlotineLi as SlotineLi
from .components.thresholds import Thresholds as Thresholds
from .contact_force import ContactForce as ContactForce
from .criteria.clearance import Clearance as Clearance
from .criteria.criterion import Criterion as Criterion
from .criteria.manipulability import Manipulability as Manipulability
from .criteria.mid_range import MidRange as MidRange
from .damping import Damping as Damping
from .distance import Distance as Distance
from .edge import Edge as Edge
from .feet import feet as feet
from .follow import Follow as Follow
from .frame import Frame as Frame
from .frozen_joints import FrozenJoints as FrozenJoints
from .gaze import Gaze as Gaze
from .gravity_compensation import GravityCompensation as GravityCompensation
from .impedance import Impedance as Impedance
from .internal_force import InternalForce as InternalForce
from .joint_admittance import JointAdmittance as JointAdmittance
from .joint_coupling import JointCoupling as JointCoupling
from .joint_impedance import JointImpedance as JointImpedance
from .joint_velocity import JointVelocity as JointVelocity
from .kinetic_energy import KineticEnergy as KineticEnergy
from .limits.axis_cone import AxisConeLimit as AxisConeLimit
from .limits.box import BoxLimits as BoxLimits
from .limits.collision import CollisionAvoidance as CollisionAvoidance
from .limits.cone import ConeLimit as ConeLimit
from .limits.frame_velocity import FrameVelocityLimits as FrameVelocityLimits
from .limits.half_space import HalfSpaceLimit as HalfSpaceLimit
from .limits.joint import JointLimits as JointLimits
from .limits.joint_acceleration import JointAccelerationLimits as JointAccelerationLimits
from .limits.joint_jerk import JointJerkLimits as JointJerkLimits
from .limits.joint_position import JointPositionLimits as JointPositionLimits
from .limits.joint_velocity import JointVelocityLimits as JointVelocityLimits
from .limits.support_polygon import SupportPolygon as SupportPolygon
from .limits.torque import TorqueLimits as TorqueLimits
from .limits.torque_speed import TorqueSpeedLimits as TorqueSpeedLimits
from .linear_momentum import LinearMomentum as LinearMomentum
from .local_position import LocalPosition as LocalPosition
from .loop_closure import LoopClosure as LoopClosure
from .loop_closures import loop_closures as loop_closures
from .low_acceleration import LowAcceleration as LowAcceleration
from .manipulability import ManipulabilityTask as ManipulabilityTask
from .mimic_joints import mimic_joints as mimic_joints
from .omni_wheel import OmniWheel as OmniWheel
from .orientation import Orientation as Orientation
from .point import Point as Point
from .position import Position as Position
from .posture import Posture as Posture
from .projected_gradient import ProjectedGradient as ProjectedGradient
from .relative_frame import RelativeFrame as RelativeFrame
from .relative_orientation import RelativeOrientation as RelativeOrientation
from .relative_position import RelativePosition as RelativePosition
from .rolling import Rolling as Rolling
from .sole import Sole as Sole
from .torque import Torque as Torque
from .trajectories import MinimumJerk as MinimumJerk
from .trajectories import Piecewise as Piecewise
from .trajectories import PoseInterpolation as PoseInterpolation
from .trajectories import Samples as Samples
from .trajectories import Sinusoid as Sinusoid
from .yaw import Yaw as Yaw
from .zero_moment_point import ZeroMomentPoint as ZeroMomentPoint
