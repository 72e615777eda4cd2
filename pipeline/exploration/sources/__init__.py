"""Sources of explorations, one module each with a `SOURCE`; others come by entry points `reenact.explorations`."""
