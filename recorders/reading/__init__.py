"""Reads sound logs, one or in parts, in order and lazily; mends nothing."""
