"""What is read and written: problem, gains and design files."""
