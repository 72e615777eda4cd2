"""Turns topics with rates and stamps of their own into ticks, in integer time and a fixed order of operations."""
