"""The design variables K_v, K_p, b_c, m_c, b_0 by their keys in a problem file; light enough for the command line."""

KEYS = ("gains.velocity", "gains.position", "coupling.damping", "coupling.mass", "coupling.drag")
