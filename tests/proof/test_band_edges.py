"""The edges of a proved band: certain, and the same however the search came there."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest

from vctune.proof import proved_band as band_edges
from vctune.proof.proved_band import EDGE_DIGITS, edge_in_hertz, extend_band


@pytest.mark.parametrize("side", [1, -1], ids=["upper", "lower"])
def test_an_edge_is_proved_and_has_the_greatest_decimals_that_are(side, monkeypatch):
    """Over twelve decades; a search that begins elsewhere or ends later writes the same digits."""
    rng = np.random.default_rng(0)
    for _ in range(300):
        true = 10 ** rng.uniform(-6, 6)

        def proved(edges, true=true):
            ends = np.sort([edges[:-1], edges[1:]], axis=0)
            return ends[1] <= true if side > 0 else ends[0] >= true

        found = set()
        for share, step in ((0.3, 1e-6), (0.97, 1e-6), (0.9999999, 1e-6), (0.5, 1e-8)):
            monkeypatch.setattr(band_edges, "FINEST_STEP", step)
            edge = extend_band(proved, true * share**side, true * 1000.0**side)
            assert side * (true - edge) >= 0
            if share < 0.99:
                found.add(edge_in_hertz(edge, upper=side > 0))
        (hertz,) = found
        assert hertz == float(f"{hertz:.{EDGE_DIGITS}g}") and side * (true / (2 * pi) - hertz) >= 0
        assert side * (true / (2 * pi) - hertz) < hertz * 10.0 ** (1 - EDGE_DIGITS)


def test_an_edge_that_is_decimal_is_kept_and_a_goal_is_reached():
    for hertz in (0.5, 102.75, 12345.0, 3e-7):
        upper, lower = 2 * pi * hertz * (1 + 1e-9), 2 * pi * hertz * (1 - 1e-9)
        assert (
            edge_in_hertz(
                extend_band(lambda edges, most=upper: (edges[:-1] <= most) & (edges[1:] <= most), hertz, 1e9),
                upper=True,
            )
            == hertz
        )
        assert (
            edge_in_hertz(
                extend_band(lambda edges, least=lower: (edges[:-1] >= least) & (edges[1:] >= least), 1e6, 1e-9),
                upper=False,
            )
            == hertz
        )
    assert extend_band(lambda edges: edges[1:] > 0, 3.0, 777.7) == 777.7
    assert extend_band(lambda edges: edges[1:] < 0, 3.0, 777.7) == 3.0
    assert extend_band(lambda edges: edges[1:] <= 777.69, 3.0, 777.7) <= 777.69
