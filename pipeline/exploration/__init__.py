"""A teacher drives a robot through a motion, and the log is written; demonstrations become motions."""
