"""Recordings, parameters, sheets, models and their simulation."""
