"""Identify the delay and the bandwidth of a vendor's servo from a recording."""
