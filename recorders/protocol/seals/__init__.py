"""Seals of packets: keys, tags and numbers by which an end knows that the other end made a packet."""
