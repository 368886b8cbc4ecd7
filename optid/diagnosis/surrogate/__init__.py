"""How something behaves that has no name: forms over signals, for simulation."""
