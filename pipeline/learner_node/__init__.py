"""The learner as a Zenoh node, from a replay or from live topics."""
