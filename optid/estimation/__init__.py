"""Batch fit of a plant to recordings."""
