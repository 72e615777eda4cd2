"""Elements that parts of the panel have in common: inputs of visitors, texts, and the plot of the errors."""
