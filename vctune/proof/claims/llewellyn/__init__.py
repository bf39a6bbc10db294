"""Llewellyn's conditions on a band of frequencies, and their proof for one design."""
