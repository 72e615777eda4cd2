"""Logs to controllers, one run or many; needs neither Drake nor Zenoh nor Rerun."""
