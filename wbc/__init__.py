"""A QP-first whole-body control framework: stacks of tasks, limits, contacts and components, solved and certified."""

from __future__ import annotations

__version__ = "0.1.0"
