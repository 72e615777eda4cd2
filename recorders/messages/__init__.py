"""The vocabulary of a log: message types and their checks, topics, phase markers; knows no bytes."""
