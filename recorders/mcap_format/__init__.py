"""MCAP, the bytes of the container: records, sections, indexes, decompression, manifest; decodes no message."""
