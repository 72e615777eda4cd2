"""Errors of a controller on motions and recordings [cm]."""
