"""Rerun scenes of robot, hands and learning; the only room that knows Rerun."""
