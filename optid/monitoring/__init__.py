"""Has a fitted rig changed? Estimates without a search."""
