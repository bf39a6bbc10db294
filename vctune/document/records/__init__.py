"""The documents that vctune writes and reads back. Each key of each JSON file is stated once."""
