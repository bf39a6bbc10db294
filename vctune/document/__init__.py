"""Files that vctune reads and writes: problem, gains and design files."""
