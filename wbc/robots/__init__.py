"""Robots' own conventions: which joint is which slot, and frames as bytes. Nothing of it was tried on hardware.

No maker's software is imported, and ``import wbc`` does not load this package.
"""

from __future__ import annotations

from wbc.robots.joint_map import JointMap as JointMap
