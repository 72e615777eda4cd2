"""Logs turned back into an ordered stream: schedule, engine, transports and stream digests."""

import logging

logging.getLogger(__name__).addHandler(logging.NullHandler())
