"""The methods: each as a closed form and as a QP. Arrays in, arrays out; no robot is needed. One file, one line."""

from __future__ import annotations

from wbc.methods.method import Method
from wbc.methods.null_space_saturation import NullSpaceSaturation
from wbc.methods.projected_gradient import ProjectedGradientStep

__all__ = ["Method", "NullSpaceSaturation", "ProjectedGradientStep"]
