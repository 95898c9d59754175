"""Export: a recorded run for others, as a moving picture or in the files of Foxglove, PlotJuggler and Rerun."""

from __future__ import annotations

from wbc.export.mcap_ import to_mcap as to_mcap
from wbc.export.movie import Camera as Camera
from wbc.export.movie import movie as movie
from wbc.export.rerun_ import to_rerun as to_rerun
