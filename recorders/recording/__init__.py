"""The live recorder: whatever is published under a namespace goes to a log."""
