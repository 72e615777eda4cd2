"""The inverse kinematics teacher, and what it can reach."""
