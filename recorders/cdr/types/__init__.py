"""Formats of the message types, one module each with a `FORMAT`; a new type is one file here, class and all."""
