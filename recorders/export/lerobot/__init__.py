"""Ticks as a dataset of LeRobot: frames in Parquet, with episodes, tasks and statistics."""
