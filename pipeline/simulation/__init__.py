"""The robot as a Drake plant with its servos."""
