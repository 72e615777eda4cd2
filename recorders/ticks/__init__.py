"""Joins messages to ticks, from a file or live."""
