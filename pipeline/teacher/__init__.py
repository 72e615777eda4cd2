"""The inverse kinematics teachers, and what can be reached."""
