"""Recursive ARMAX."""
