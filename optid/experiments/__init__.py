"""The next experiment: the reference that best distinguishes rival effects."""
