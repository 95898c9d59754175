"""``python -m wbc.cli`` is the command ``wbc``."""

from wbc.cli import main

main()
