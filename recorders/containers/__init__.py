"""Logs in any container, told by content, behind one `open_log`."""
