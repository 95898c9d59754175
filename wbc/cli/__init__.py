"""The command ``wbc``: one file a verb. Nothing else in the framework imports typer or rich."""

from __future__ import annotations

import signal
import sys


def main() -> None:
    """Run the command line and exit: 0 good, 1 a verdict of no, 2 bad input or a scenario's error, 130 interrupted by
    Ctrl-C or SIGTERM, 141 nobody reads what it prints."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)  # or half of a report would be left behind
    try:
        from wbc.cli.app import run_app  # takes a second or two, in which Ctrl-C may come

        run_app()
    except KeyboardInterrupt:
        print("wbc: interrupted; nothing was written", file=sys.stderr)
        sys.exit(130)
    finally:
        signal.signal(signal.SIGTERM, before)
