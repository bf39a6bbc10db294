"""A recording of a vendor's servo: its delay and its bandwidth."""
