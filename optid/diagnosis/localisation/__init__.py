"""Where and when a mismatch acts: from the law that was named, else from an unknown input."""
