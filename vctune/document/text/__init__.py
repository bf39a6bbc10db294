"""Text and raw values: TOML, JSON, digests, atomic writing of files, errors and their codes."""
