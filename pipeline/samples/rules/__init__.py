"""Pairing rules, one module each with a `RULE`; those of others are entry points of the group `reenact.pairs`."""
