"""From ticks to the samples that training, evaluation and serving share."""
