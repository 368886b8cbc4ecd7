"""Diagnosis of missing physics: where model and recordings differ, what is missing, and proof on held-out data."""
