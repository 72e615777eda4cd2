"""Import of a model of others: the part of it that is taken, and the URDF that is written."""
