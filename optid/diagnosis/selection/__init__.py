"""Selection of effects, one after another: forward, then backward."""
