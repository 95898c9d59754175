"""What a plan writes each tick, compiled: extra ``fast``."""
