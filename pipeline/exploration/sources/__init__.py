"""Sources of explorations, one module each with a `SOURCE`; others' are entry points of the group `reenact.explorations`."""
