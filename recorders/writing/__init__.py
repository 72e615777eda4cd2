"""Writes logs that survive a crash: chunks, part files, background sync."""
