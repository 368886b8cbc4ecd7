"""Missing physics: where model and recordings differ, what was left out, and proof on held-out data."""
