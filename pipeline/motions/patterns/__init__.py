"""Motions by name, one module each with a `MOTION`; those of others are entry points of the group `reenact.motions`."""
