"""The built-in plants."""
