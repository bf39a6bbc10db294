"""What a file may hold: keys, types, ranges, defaults, and what may not stand together."""
