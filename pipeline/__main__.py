"""`python -m pipeline` is `reenact`."""

from pipeline.cli.app import main

main()
