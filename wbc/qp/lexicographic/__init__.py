"""Strict priorities: levels of least squares, each decided in what those above leave free."""

from __future__ import annotations

from wbc.qp.lexicographic.function import lexicographic
from wbc.qp.lexicographic.parts import Part, Pull, Stage

__all__ = ["Part", "Pull", "Stage", "lexicographic"]
