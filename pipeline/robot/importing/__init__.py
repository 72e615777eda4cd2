"""Import of a model of others: what is taken of it, and the URDF that is made."""
