"""Logs turned back into an ordered stream: schedule, engine, transports and stream digests."""
