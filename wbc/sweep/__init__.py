"""Sweeps: many runs of a scenario with drawn parameters, disturbances, solvers and hierarchies, on dask.distributed."""

from __future__ import annotations

from wbc.sweep.draw import Choice as Choice
from wbc.sweep.draw import Range as Range
from wbc.sweep.plan import Sweep as Sweep
from wbc.sweep.run import repeat as repeat
from wbc.sweep.run import replay as replay
from wbc.sweep.run import resume as resume
from wbc.sweep.run import sweep as sweep
