"""A report is read as well on a desk, on a telephone and on paper: in a real browser."""

from __future__ import annotations

import re
from functools import cache

import pytest
from conftest import DEVICE, FIXED, mostly_slow
from pages import PARTS, chromium, made, needs_chromium, opened, recorded

pytestmark = needs_chromium
CASES = {
    "every hand, held": DEVICE + FIXED.format(160.0) + "drag = 3.0\n[operator]\ndamping = 2.0\n",
    "every part": DEVICE + PARTS + FIXED.format(160.0).replace("150.0", "60.0") + "drag = 3.0\n",
    "infeasible": DEVICE + "[gains]\nvelocity = { min = 2000.0, max = 3000.0 }\n",
}
PRICED = "every hand, held"
MARGIN, WIDTH, HEIGHT = 14 * 72 / 25.4, 595.0, 842.0
"""Of A4, points."""


@pytest.fixture(scope="module")
def browser():
    with chromium() as driven:
        yield driven


@pytest.fixture(scope="module")
def paths(tmp_path_factory):
    """Return a case's report, made when it is first asked for."""
    return cache(lambda name: made(recorded(CASES[name], prices=name == PRICED), tmp_path_factory.mktemp("report")))


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_on_a_desk(browser, paths, scheme):
    """No console error, no request beyond the file, figures visible, text readable on its ground."""
    page = opened(browser, paths("every hand, held"), color_scheme=scheme)
    boxes = [figure.bounding_box() for figure in page.query_selector_all(".figure > svg")]
    colours = page.evaluate(
        "() => { const b = getComputedStyle(document.body);"
        " return [b.color, b.backgroundColor, getComputedStyle(document.querySelector('.figure > svg')).color]; }"
    )
    assert page.said == []
    assert len(page.asked) == 1
    assert len(boxes) == 6
    assert all(box["width"] > 400 and box["height"] > 300 for box in boxes)
    ink, ground, figure_ink = (luminance(colour) for colour in colours)
    assert figure_ink == ink
    assert (max(ink, ground) + 0.05) / (min(ink, ground) + 0.05) > 7
    assert (ground > ink) == (scheme == "light")


@pytest.mark.parametrize("name", mostly_slow(CASES, ["infeasible"]))
def test_on_a_telephone(browser, paths, name):
    """Nothing is wider than the screen but the problem file, and text in figures is at least six points high."""
    page = opened(browser, paths(name), viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True)
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    ends = page.evaluate(
        "[...document.querySelectorAll('td, th, p, li, .figure > svg, .scale div, .sliders *')]"
        ".map((each) => each.getBoundingClientRect().right)"
    )
    assert max(ends) <= 390
    heights = page.evaluate(
        "[...document.querySelectorAll('.figure > svg text')].map((each) =>"
        " parseFloat(getComputedStyle(each).fontSize) * Math.hypot(each.getScreenCTM().a, each.getScreenCTM().b))"
    )
    assert min(heights, default=6.0) >= 6.0


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_on_paper(browser, paths, name):
    """On A4 nothing is beyond the margins, no heading ends a page; figures and tables begin on the page of theirs."""
    import pypdfium2

    page = opened(browser, paths(name))
    page.emulate_media(media="print")
    figures = page.evaluate(
        """() => [...document.querySelectorAll('figure')].map((each) => {
          const texts = [...each.querySelectorAll('text')].map((text) => text.textContent.trim());
          return [each.querySelector('h2').textContent, ...texts.filter((text) => text.length > 3)];
        })"""
    )
    tables = page.evaluate(
        """() => [...document.querySelectorAll('section > h2')].filter((each) => each.parentNode.querySelector('table'))
          .map((each) => [each.textContent, each.parentNode.querySelector('tr').innerText])"""
    )
    headings = page.evaluate(
        "[...document.querySelectorAll('h2, caption')].filter((each) => each.offsetParent)"
        ".map((each) => each.innerText)"
    )
    words = page.evaluate("document.body.innerText").split()
    printed = pypdfium2.PdfDocument(page.pdf(prefer_css_page_size=True))
    sheets = [sheet.get_textpage() for sheet in printed]
    texts = [squeezed(sheet.get_text_range()) for sheet in sheets]
    for sheet, text in zip(printed, sheets, strict=True):
        assert sheet.get_size() == pytest.approx((WIDTH, HEIGHT), abs=1.0)
        places = [text.get_charbox(k) for k in range(text.count_chars())]
        left, low, right, high = zip(*places, strict=True)
        assert min(left) >= MARGIN - 1 and max(right) <= WIDTH - MARGIN + 1
        assert min(low) >= MARGIN - 1 and max(high) <= HEIGHT - MARGIN + 1
    assert [word for word in words if not any(squeezed(word) in text for text in texts)] == []
    for text in texts:
        assert not any(text.endswith(squeezed(heading)) for heading in headings)
    for title, *parts in (*figures, *tables):
        assert any(all(squeezed(part) in text for part in (title, *parts)) for text in texts), title


def squeezed(text):
    """Return a text without spaces and hyphens: a PDF breaks its lines at both."""
    return re.sub(r"[\s\ufffe\u00ad-]", "", text)


def luminance(colour):
    channels = [int(part) / 255 for part in re.findall(r"\d+", colour)[:3]]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
