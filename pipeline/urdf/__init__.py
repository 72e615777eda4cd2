"""URDF texts: what they hold, and whether a body and a motor can be so; reads no file."""
