"""Datasets of LeRobot as recordings: joints, hands and actions of their frames, as messages."""
