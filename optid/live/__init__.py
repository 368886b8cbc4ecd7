"""Live sessions: a rig and its simulation in parallel, identified, controlled and logged in real time."""
