"""Empirical description of a mismatch without a named effect: functions of signals, for simulation."""
