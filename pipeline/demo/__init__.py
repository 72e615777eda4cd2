"""The main job end to end, and the controllers that it leaves to be tried."""
