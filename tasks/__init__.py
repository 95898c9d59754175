"""The library: tasks, limits, contacts and components for stacks. One file a member, one line here.

Example:
    >>> import wbc
    >>> from tasks import Frame, JointVelocityLimits, Posture
    >>> robot = wbc.load("arm")
    >>> tool = robot.frame_names[-1]
    >>> stack = wbc.Stack(
    ...     [Frame(tool, target=robot.state().frame(tool).placement), Posture(robot.q0, weight=1e-3)],
    ...     subject_to=[JointVelocityLimits()],
    ... )
"""

from tasks.admittance import Admittance as Admittance
from tasks.angular_momentum import AngularMomentum as AngularMomentum
from tasks.axis_alignment import AxisAlignment as AxisAlignment
from tasks.capture_point import CapturePoint as CapturePoint
from tasks.center_of_pressure import CenterOfPressure as CenterOfPressure
from tasks.centroidal_momentum import CentroidalMomentum as CentroidalMomentum
from tasks.com import CenterOfMass as CenterOfMass
from tasks.components.contact_schedule import ContactSchedule as ContactSchedule
from tasks.components.fault_reaction import FaultReaction as FaultReaction
from tasks.components.fault_reaction import When as When
from tasks.components.measured_wrench import MeasuredWrench as MeasuredWrench
from tasks.components.momentum_observer import MomentumObserver as MomentumObserver
from tasks.components.reactions import Brake as Brake
from tasks.components.reactions import Cap as Cap
from tasks.components.reactions import Carry as Carry
from tasks.components.reactions import Compensate as Compensate
from tasks.components.reactions import Comply as Comply
from tasks.components.reactions import Derate as Derate
from tasks.components.reactions import Release as Release
from tasks.components.reactions import Retarget as Retarget
from tasks.components.reactions import Stop as Stop
from tasks.components.reactions import Weigh as Weigh
from tasks.components.slotine_li import SlotineLi as SlotineLi
from tasks.components.thresholds import Thresholds as Thresholds
from tasks.contact_force import ContactForce as ContactForce
from tasks.criteria.clearance import Clearance as Clearance
from tasks.criteria.criterion import Criterion as Criterion
from tasks.criteria.manipulability import Manipulability as Manipulability
from tasks.criteria.mid_range import MidRange as MidRange
from tasks.damping import Damping as Damping
from tasks.distance import Distance as Distance
from tasks.edge import Edge as Edge
from tasks.feet import feet as feet
from tasks.frame import Frame as Frame
from tasks.frozen_joints import FrozenJoints as FrozenJoints
from tasks.gaze import Gaze as Gaze
from tasks.impedance import Impedance as Impedance
from tasks.internal_force import InternalForce as InternalForce
from tasks.joint_admittance import JointAdmittance as JointAdmittance
from tasks.joint_coupling import JointCoupling as JointCoupling
from tasks.joint_velocity import JointVelocity as JointVelocity
from tasks.kinetic_energy import KineticEnergy as KineticEnergy
from tasks.limits.axis_cone import AxisConeLimit as AxisConeLimit
from tasks.limits.box import BoxLimits as BoxLimits
from tasks.limits.collision import CollisionAvoidance as CollisionAvoidance
from tasks.limits.cone import ConeLimit as ConeLimit
from tasks.limits.frame_velocity import FrameVelocityLimits as FrameVelocityLimits
from tasks.limits.half_space import HalfSpaceLimit as HalfSpaceLimit
from tasks.limits.joint import JointLimits as JointLimits
from tasks.limits.joint_acceleration import JointAccelerationLimits as JointAccelerationLimits
from tasks.limits.joint_jerk import JointJerkLimits as JointJerkLimits
from tasks.limits.joint_position import JointPositionLimits as JointPositionLimits
from tasks.limits.joint_velocity import JointVelocityLimits as JointVelocityLimits
from tasks.limits.support_polygon import SupportPolygon as SupportPolygon
from tasks.limits.torque import TorqueLimits as TorqueLimits
from tasks.limits.torque_speed import TorqueSpeedLimits as TorqueSpeedLimits
from tasks.linear_momentum import LinearMomentum as LinearMomentum
from tasks.loop_closure import LoopClosure as LoopClosure
from tasks.low_acceleration import LowAcceleration as LowAcceleration
from tasks.manipulability import ManipulabilityTask as ManipulabilityTask
from tasks.mimic_joints import mimic_joints as mimic_joints
from tasks.omni_wheel import OmniWheel as OmniWheel
from tasks.orientation import Orientation as Orientation
from tasks.point import Point as Point
from tasks.position import Position as Position
from tasks.posture import Posture as Posture
from tasks.projected_gradient import ProjectedGradient as ProjectedGradient
from tasks.relative_frame import RelativeFrame as RelativeFrame
from tasks.relative_orientation import RelativeOrientation as RelativeOrientation
from tasks.relative_position import RelativePosition as RelativePosition
from tasks.rolling import Rolling as Rolling
from tasks.sole import Sole as Sole
from tasks.torque import Torque as Torque
from tasks.trajectories import MinimumJerk as MinimumJerk
from tasks.trajectories import Piecewise as Piecewise
from tasks.trajectories import PoseInterpolation as PoseInterpolation
from tasks.trajectories import Sinusoid as Sinusoid
from tasks.yaw import Yaw as Yaw
from tasks.zero_moment_point import ZeroMomentPoint as ZeroMomentPoint
from wbc.models.collision import Obstacle as Obstacle
