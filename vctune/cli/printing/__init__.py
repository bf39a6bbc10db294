"""Define what all commands share: options, tables, formats, progress, exit codes."""
