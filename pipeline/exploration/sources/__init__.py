"""Sources of explorations, a module each with a `SOURCE`; those of others are entry points of `reenact.explorations`."""
