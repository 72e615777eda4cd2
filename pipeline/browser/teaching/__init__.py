"""Teaching from the page: learning from logs, from what the robot does, and by itself, each in processes of its own."""
