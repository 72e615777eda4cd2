"""Target motions: patterns, drawings and CSV files."""
