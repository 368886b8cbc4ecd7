"""Physics that plants leave out: one small file for each effect in `catalogue`."""
