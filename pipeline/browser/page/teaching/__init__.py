"""Parts of the panel that teach, and that put controllers side by side."""
