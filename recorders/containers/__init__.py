"""Logs in any container, recognised by content, behind one `open_log`."""
