"""Export a certified design as firmware: C99, vectors to replay, coefficients, and an FMU."""
