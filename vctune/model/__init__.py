"""The physics as pure functions over any arithmetic: loop, two-port, coupling, transparency, sampled loop."""
