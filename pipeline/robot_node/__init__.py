"""The robot as a Zenoh node, its clients, and its protocol."""
