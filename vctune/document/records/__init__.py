"""The documents that vctune writes and reads back: each key of each JSON file once."""
