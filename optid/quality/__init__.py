"""Checks of data before a solve and of models after it."""
