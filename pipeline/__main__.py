"""`python -m pipeline` is `reenact`."""

from pipeline.cli import main

main()
