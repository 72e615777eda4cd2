"""Robots, teachers and controllers as systems of Drake, for diagrams of anybody's own."""
