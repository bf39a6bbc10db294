"""What to change: repairs, and the price of each of the device's parameters."""
