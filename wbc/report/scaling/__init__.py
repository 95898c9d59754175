"""Scaling curves: how the time of a tick grows with joints, tasks, contacts and active rows."""

from __future__ import annotations

from wbc.report.scaling.measure import scaled as scaled
