"""Robot folders: new ones of a URDF, with posture, centres and boxes found by sampling, and checked."""
