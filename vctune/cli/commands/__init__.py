"""One small file for each command: read, call, print."""
