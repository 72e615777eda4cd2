"""The stream's protocol in a simulated world: every event and fault comes of one seed, which repeats any failure."""
