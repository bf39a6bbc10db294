"""The NLP of a working set: its structure, its parameters, its form in CasADi, and IPOPT."""
