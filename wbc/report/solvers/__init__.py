"""Comparing QP solvers on one's own robot and stack: what to use, at which tolerance, and why."""

from __future__ import annotations

from wbc.report.solvers.comparison import compare as compare
from wbc.report.solvers.comparison import redraw as redraw
from wbc.report.solvers.comparison import resume as resume
from wbc.report.solvers.recording import QpRecorder as QpRecorder
