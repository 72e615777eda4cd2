"""Self-collision: how near a robot's parts come to one another; knows the robot alone."""
