"""The NLP of a working set: its structure, its parameters, CasADi, IPOPT."""
