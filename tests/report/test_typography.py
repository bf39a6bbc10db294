"""One format of numbers, units and mathematics."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vctune.report.typography import PREFIXES, THIN, html, plain, quantity, span, svg_texts

SCALES = {prefix: 10.0**power for power, prefix in PREFIXES.items()}


@pytest.mark.parametrize(
    ("value", "unit", "shown"),
    [
        (1e5, "N/m", "100 kN/m"), (3000.0, "N/m", "3000 N/m"), (0.055018, "kg", "55.02 g"), (5000.0, "kg", "5000 kg"),
        (0.0013343, "s", "1.334 ms"), (0.0005, "s", "500 µs"), (0.25, "s", "0.25 s"), (0.0, "s", "0 s"),
        (1274.4126, "N s/m", "1274 N s/m"), (0.0067, "N s/m", "6.7 mN s/m"), (39.405, "deg", "39.41 °"),
        (5.6e-5, "kg m2", "5.6 × 10⁻⁵ kg m²"), (0.39034, "", "0.3903"), (-6.7e-4, "", "−6.7 × 10⁻⁴"),
        (None, "", "none"), (float("inf"), "N/m", "∞ N/m"),
    ],
)  # fmt: skip
def test_a_number_has_few_digits_and_a_prefix(value, unit, shown):
    assert str(quantity(value, unit)).replace(THIN, " ") == shown


@given(st.floats(1e-8, 1e11), st.sampled_from(["N/m", "N s/m", "s", "Hz", "kg"]))
def test_what_is_shown_is_the_number(value, unit):
    """A reader who undoes the prefix has the number to four digits."""
    shown = quantity(value, unit)
    mantissa, _, power = shown.value.partition(" × 10")
    exponent = int(power.translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")) or 0)
    prefix = shown.unit[0] if shown.unit[0] in "nµmkMG" and shown.unit not in ("kg", "m") else ""
    scale = SCALES[prefix] * (1e-3 if unit == "kg" and shown.unit.endswith("g") and shown.unit != "kg" else 1.0)
    assert float(mantissa) * 10.0**exponent * scale == pytest.approx(value, rel=5.1e-4)


def test_both_ends_of_a_range_have_one_unit():
    assert str(span(0.0, 30000.0, "N/m")).replace(THIN, " ") == "0 to 30 kN/m"
    assert plain("500 to 30000 N/m").replace(THIN, " ") == "0.5 to 30 kN/m"


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("Re Z_c >= 1.05 R", "Re <i>Z</i><sub>c</sub> ≥ 1.05 R"),
        ("|1 - G_he|", "|1 − <i>G</i><sub>he</sub>|"),
        ("gains.position and max_sensitivity, x < y", "gains.position and max_sensitivity, x &lt; y"),
        ("1.03e-05 N s/m, -1", f"10.3{THIN}µN{THIN}s/m, −1"),
    ],
)
def test_a_sentence_is_set(text, shown):
    assert html(text) == shown


def test_a_figure_has_real_subscripts():
    text = svg_texts('<svg><text x="1">Re Z_c &gt;= 1, N s/m</text></svg>')
    assert re.search(r"Z<tspan [^>]*>c</tspan>", text) and "≥" in text and "_" not in text
