"""The physics as pure functions that run in any arithmetic: loop, two-port, coupling, transparency, sampled loop."""
