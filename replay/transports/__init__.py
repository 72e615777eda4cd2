"""How a stream travels and at what pace: in process, over Zenoh, on a clock."""
