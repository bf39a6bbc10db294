"""Text to raw values and back: TOML, JSON, digests, files written whole, and every error and its code."""
