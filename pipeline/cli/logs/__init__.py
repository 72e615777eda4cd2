"""Verbs for logs and controllers as files: what they hold, where they differ, how they look."""
