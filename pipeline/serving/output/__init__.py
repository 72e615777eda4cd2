"""Output of a served controller: the message type of its commands, and how fast they may move the joints."""
