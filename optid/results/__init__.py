"""What the public calls return: frozen, with everything their reports show, saved to a folder and read back."""
