"""Damaged logs: finds what is whole, describes it (`info`) and saves it (`recover`)."""
