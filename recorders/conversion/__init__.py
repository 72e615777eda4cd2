"""Any recordings in, MCAP out: merged, sliced, chosen, renamed, split and compressed anew."""
