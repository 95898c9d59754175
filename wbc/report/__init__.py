"""Reports: data first (:mod:`wbc.report.document`), and two writers that own the formats, HTML and Markdown."""

from __future__ import annotations

from wbc.report.build import run_report as run_report
from wbc.report.comparison import save_comparison as save_comparison
from wbc.report.document import Figure as Figure
from wbc.report.document import Plot as Plot
from wbc.report.document import Report as Report
from wbc.report.document import Section as Section
from wbc.report.document import Table as Table
from wbc.report.document import Text as Text
from wbc.report.folder import replaced as replaced
from wbc.report.folder import write as write
from wbc.report.index import save_index as save_index
from wbc.report.record import save_report as save_report
from wbc.report.solvers import QpRecorder as QpRecorder
from wbc.report.solvers import compare as compare
