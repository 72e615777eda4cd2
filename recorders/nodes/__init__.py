"""The parts of every long-running node: a liveliness token, a status, metrics, a watch on its connections."""
