"""Values, times and sizes as people read and write them; knows nothing of logs."""
