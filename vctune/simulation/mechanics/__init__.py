"""Device, hand and friction over a sample."""
