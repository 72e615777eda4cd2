"""The runner of golden cases for this learner and these robots."""
