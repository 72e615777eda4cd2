"""Learning rules and baselines on the same explorations: errors, costs, and where the paper's error comes from."""
