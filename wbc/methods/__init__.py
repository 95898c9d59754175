"""The methods: each as a closed form and as a QP. Arrays in, arrays out; no robot is needed. One file, one line."""

from __future__ import annotations

from wbc.methods.contact_estimate import ContactEstimate as ContactEstimate
from wbc.methods.fault_fraction import FaultFraction as FaultFraction
from wbc.methods.force_distribution import ForceDistribution as ForceDistribution
from wbc.methods.method import Method as Method
from wbc.methods.momentum_residual import MomentumResidual as MomentumResidual
from wbc.methods.null_space_saturation import NullSpaceSaturation as NullSpaceSaturation
from wbc.methods.parameter_update import ParameterUpdate as ParameterUpdate
from wbc.methods.projected_gradient import ProjectedGradientStep as ProjectedGradientStep
from wbc.methods.pseudo_inertia import PseudoInertia as PseudoInertia
from wbc.methods.weighted_torque import WeightedTorque as WeightedTorque
