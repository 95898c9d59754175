"""Live: the view in the browser while a controller runs, by viser, in a process of its own beside the loop."""

from __future__ import annotations

from wbc.live.view import View as View
