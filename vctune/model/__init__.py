"""Model the physics with pure functions that run in any arithmetic: loop, two-port, coupling, transparency, sampled
loop."""
