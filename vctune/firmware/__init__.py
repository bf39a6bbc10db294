"""A certified design as firmware: C99, vectors to replay, coefficients, an FMU."""
