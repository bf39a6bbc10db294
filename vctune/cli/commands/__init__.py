"""Define the commands, one small file for each."""
