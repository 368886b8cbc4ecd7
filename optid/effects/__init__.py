"""Physics that plants leave out: one small file per effect in `catalogue`."""
