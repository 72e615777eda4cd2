"""The log: message types, codec, topics, MCAP writer and reader, and the wire they travel on."""

import logging

logging.getLogger(__name__).addHandler(logging.NullHandler())
