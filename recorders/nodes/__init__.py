"""What every long-running node has: a liveliness token, a status, metrics, a watch on its connections."""
