"""The public calls: each takes paths, frames or recordings, runs one job, and returns its result."""
