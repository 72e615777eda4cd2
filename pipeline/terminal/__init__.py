"""Text, tables, keys and signals of a terminal."""
