"""A plant of many simulated rigs, some of which wear: nights, scores, and drills of the fleet engine."""
