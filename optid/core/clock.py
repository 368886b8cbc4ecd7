"""Inputs that no channel holds: the time to the next sample, and the time since the record began."""

INTERVAL, CLOCK = "interval", "clock"
