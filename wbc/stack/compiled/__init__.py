"""What a plan writes each tick, compiled."""
