"""The public calls: each takes what a user has at hand, runs one job, and returns its result."""
