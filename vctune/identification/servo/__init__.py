"""A recording of a vendor's servo: how late, and how fast, it follows its command."""
