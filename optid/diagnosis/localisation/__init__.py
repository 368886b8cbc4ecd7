"""Where and when a mismatch acts: from the named law, else from an unknown input."""
