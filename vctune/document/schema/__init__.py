"""The schema of each file: keys, types, ranges, defaults and contradictions."""
