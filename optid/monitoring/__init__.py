"""What has become of a fitted rig: estimates that need no search."""
