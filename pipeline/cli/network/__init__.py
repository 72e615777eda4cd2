"""Verbs that are nodes on Zenoh: record, replay, learn, serve, status."""
