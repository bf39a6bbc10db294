"""The files that vctune reads and writes: problem, gains, design and other files."""
