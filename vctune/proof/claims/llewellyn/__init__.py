"""Llewellyn's conditions on a band of frequencies, and their proofs for one design."""
