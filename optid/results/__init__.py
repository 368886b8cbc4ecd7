"""Results of the public calls: frozen, with everything that their reports show; they can be saved and read back."""
