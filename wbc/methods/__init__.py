"""The methods: each as a closed form and as a QP. Arrays in, arrays out; no robot is needed. One file, one line."""

from __future__ import annotations

from wbc.methods.contact_estimate import ContactEstimate
from wbc.methods.fault_fraction import FaultFraction
from wbc.methods.force_distribution import ForceDistribution
from wbc.methods.method import Method
from wbc.methods.momentum_residual import MomentumResidual
from wbc.methods.null_space_saturation import NullSpaceSaturation
from wbc.methods.parameter_update import ParameterUpdate
from wbc.methods.projected_gradient import ProjectedGradientStep
from wbc.methods.pseudo_inertia import PseudoInertia
from wbc.methods.weighted_torque import WeightedTorque

__all__ = [
    "ContactEstimate",
    "FaultFraction",
    "ForceDistribution",
    "Method",
    "MomentumResidual",
    "NullSpaceSaturation",
    "ParameterUpdate",
    "ProjectedGradientStep",
    "PseudoInertia",
    "WeightedTorque",
]
