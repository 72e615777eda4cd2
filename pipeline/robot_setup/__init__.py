"""Robot folders: made from a URDF, with posture, centres and boxes found by sampling, and checked."""
