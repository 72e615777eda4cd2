"""From what is published to the ticks that a served controller takes."""
