"""The loop exactly as it is sampled, let go and in a hand."""
