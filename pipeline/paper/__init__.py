"""Every figure and number of the paper, beside ours; only the command line imports it."""
