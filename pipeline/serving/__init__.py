"""A controller as a Zenoh node: hand targets in, joint commands out."""
