"""One small file a command: read, call, print."""
