"""The mixed reality: a rig and its simulation side by side, identified, controlled and logged as they run."""
