"""Verbs in which a robot moves: explore, demonstrate, and the robot itself."""
