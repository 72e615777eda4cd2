"""Recordings as tables, a file for each topic: CSV, Parquet; ticks as a LeRobotDataset."""
