"""Inputs without a channel: the time to the next sample, and the time since the start of the recording."""

INTERVAL, CLOCK = "interval", "clock"
