"""Controller, command and record."""
