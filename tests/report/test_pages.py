"""A report is read as well on a desk, on a telephone and on paper: in a real browser."""

from __future__ import annotations

import re
from functools import cache

import pytest
from conftest import DEVICE, FIXED, PROBLEM_FILES, ROOT, mostly_slow
from pages import PARTS, SERVO, chromium, made, needs_chromium, opened, recorded
from servo_logs import servo_case

from vctune import identify
from vctune.report.identification import identification_files
from vctune.report.paths import REPORT

pytestmark = needs_chromium
CASES = {
    "every hand, held": DEVICE + FIXED.format(160.0) + "drag = 3.0\n[operator]\ndamping = 2.0\n",
    "every part": DEVICE + PARTS + FIXED.format(160.0).replace("150.0", "60.0") + "drag = 3.0\n",
    "infeasible": DEVICE + "[gains]\nvelocity = { min = 2000.0, max = 3000.0 }\n",
    "default": DEVICE,
    "servo": SERVO,
    "at a bound": DEVICE + "[gains]\nposition = { min = 3000.0, max = 1e5 }\n",
}
PRICED = "every hand, held", "default"
MARGIN, TOP, WIDTH, HEIGHT = 14 * 72 / 25.4, 19 * 72 / 25.4, 595.0, 842.0
"""Of A4, points. The head of a sheet is above the upper margin."""
PAPER_WIDER = 4.0
"""A line of half a sheet that is set for a screen is up to 1 % longer on paper, points."""
SHEETS = 4
"""Sheets that a page may take in print."""
CONTRAST = 4.5
FIRST = ".verdict", ".warnings", ".gains", "h2:text-matches('What (limits it|fails)') + ul"
"""What the first screen shows."""
VISIBLE = """() => {
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT), found = [];
  for (let node; (node = walker.nextNode()); ) {
    const parent = node.parentElement, shown = parent.checkVisibility() && !parent.closest("script, style");
    if (!shown || !node.textContent.trim()) continue;
    let ground = parent;
    const opaque = (each) => !getComputedStyle(each).backgroundColor.match(/, 0\\)$/);
    while (ground !== document.body && !opaque(ground)) ground = ground.parentElement;
    const style = getComputedStyle(parent), drawn = parent.closest("svg") && style.fill !== "none";
    const words = parent.closest("text"); // faint ones are stamps, which repeat the verdict
    if (words && +getComputedStyle(words).opacity < 1) continue;
    found.push([node.textContent.trim(), drawn ? style.fill : style.color, getComputedStyle(ground).backgroundColor]);
  }
  return found;
}"""
"""Each visible text with its colour and that of its ground."""


@pytest.fixture(scope="module")
def browser():
    with chromium() as driven:
        yield driven


@pytest.fixture(scope="module")
def paths(tmp_path_factory):
    """Return a case's report, made when it is first asked for."""
    return cache(lambda name: made(recorded(CASES[name], prices=name in PRICED), tmp_path_factory.mktemp("report")))


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("name", ["every hand, held", "servo", "infeasible"])
def test_on_a_desk(browser, paths, name, scheme):
    """No console error, no request beyond the file, figures visible, every text readable on its ground."""
    page = opened(browser, paths(name), color_scheme=scheme, viewport={"width": 1280, "height": 800})
    boxes = [figure.bounding_box() for figure in page.query_selector_all(".figure > svg")]
    assert page.said == []
    assert len(page.asked) == 1
    assert len(boxes) == {"every hand, held": 5, "servo": 3, "infeasible": 2}[name]
    assert all(box["width"] > 400 and box["height"] > 150 for box in boxes)
    seen = page.evaluate(VISIBLE)
    faint = [each for each in seen if contrast(*each[1:]) < CONTRAST]
    assert faint == [] and len(seen) > 20
    ground, ink = (
        luminance(page.evaluate(f"getComputedStyle(document.body).{key}")) for key in ("backgroundColor", "color")
    )
    assert (ground > ink) == (scheme == "light")


@pytest.fixture(scope="module")
def identified(tmp_path_factory):
    """Return the page of an identification."""
    folder = tmp_path_factory.mktemp("identified")
    found = identify(servo_case(3, n=800).write(folder), servo=True)
    (folder / REPORT).write_text(identification_files(found.found, found.record, folder)[folder / REPORT])
    return folder / REPORT


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_an_identification_is_read_on_a_desk_and_on_a_telephone(browser, identified, scheme):
    """Contrast, nothing from outside, no error, and no sideways scrolling."""
    for width in (1280, 390):
        page = opened(browser, identified, color_scheme=scheme, viewport={"width": width, "height": 800})
        assert page.said == [] and len(page.asked) == 1
        seen = page.evaluate(VISIBLE)
        assert [each for each in seen if contrast(*each[1:]) < CONTRAST] == [] and len(seen) > 10
        assert page.evaluate("document.documentElement.scrollWidth") <= width


@pytest.mark.parametrize("name", mostly_slow(("default", "every part", "servo", "at a bound"), ["servo"]))
def test_the_first_screen_answers(browser, paths, name):
    """Verdict, warnings, gains, error and limits end above the fold; a wide screen shows them side by side, none over
    another."""
    page = opened(browser, paths(name), viewport={"width": 1280, "height": 800})
    shown = [box for each in FIRST if (found := page.query_selector(each)) and (box := found.bounding_box())]
    assert len(shown) >= 3
    assert max(box["y"] + box["height"] for box in shown) <= 800
    assert page.evaluate(
        "[...document.querySelectorAll('.head table')].every(each => each.getBoundingClientRect().right <="
        " each.closest('section').getBoundingClientRect().right + 20)"
    )
    warned = page.query_selector(".warnings")
    if warned is not None:
        beside, verdict = warned.bounding_box(), page.query_selector(".verdict").bounding_box()
        assert beside["y"] == pytest.approx(verdict["y"], abs=1) and beside["x"] > verdict["x"] + verdict["width"]
        assert luminance(page.evaluate("getComputedStyle(document.querySelector('.warnings b')).color")) > 0.05


def test_numbers_and_mathematics_are_set(browser, paths):
    """Few digits outside the gains, prefixes instead of powers of ten, real subscripts, no signs of a keyboard."""
    page = opened(browser, paths("servo"))
    words = page.evaluate(VISIBLE)
    texts = [text for text, *_ in words if not re.search("[0-9a-f]{8}", text)]  # digests apart
    gains = {cell.inner_text() for cell in page.query_selector_all(".gains td.number")}
    long = [text for text in texts if re.search(r"\d\.\d{5,}|\d{6,}", text)]
    assert set(long) <= gains
    assert not [text for text in texts if re.search(r">=|<=|\d[eE][+-]?\d|\b[A-Za-z]_[A-Za-z0-9]", text)]
    assert page.query_selector("sub") and page.query_selector(".figure text tspan")
    svgs = page.query_selector_all(".figure > svg")
    assert all(re.search(r"\d", svg.get_attribute("aria-label")) for svg in svgs)


@pytest.mark.parametrize("name", mostly_slow(CASES, ["infeasible"]))
def test_on_a_telephone(browser, paths, name):
    """Nothing is wider than the screen but the problem file, and text in figures is at least six points high."""
    page = opened(browser, paths(name), viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True)
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    ends = page.evaluate(
        "[...document.querySelectorAll('td, th, p, li, .figure > svg')]"
        ".map((each) => each.getBoundingClientRect().right)"
    )
    assert max(ends) <= 390
    heights = page.evaluate(
        "[...document.querySelectorAll('.figure > svg text')].map((each) =>"
        " parseFloat(getComputedStyle(each).fontSize) * Math.hypot(each.getScreenCTM().a, each.getScreenCTM().b))"
    )
    assert min(heights, default=6.0) >= 6.0


BOXES = """() => {
  document.querySelectorAll("details").forEach((each) => (each.open = true));
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT), found = new Map();
  for (let node; (node = walker.nextNode()); ) {
    const parent = node.parentElement, words = parent.closest("text");
    if (!node.textContent.trim() || parent.closest("script, style") || !parent.checkVisibility()) continue;
    if (words && +getComputedStyle(words).opacity < 1) continue; // stamps, which lie over a figure
    const range = document.createRange();
    range.selectNodeContents(node);
    const boxes = words ? [words.getBoundingClientRect()] : [...range.getClientRects()];
    const frame = words ? words.closest("svg").getBoundingClientRect() : { left: 0, right: innerWidth };
    found.set(words || node, boxes.filter((box) => box.width > 1).map((box) =>
      [(words || node).textContent.trim(), box.left, box.top, box.right, box.bottom, frame.left, frame.right]));
  }
  return [...found.values()].flat();
}"""
"""The box of each visible text, or of each line of it, with the left and right ends of its figure or of the page."""
COVERED = 0.35
"""Share of a line's height by which a subscript, or the line below, may reach into it."""


def covered(boxes):
    """Return the texts that lie over another one, or leave their figure."""
    found, below = [], sorted(boxes, key=lambda box: box[2])
    for k, (text, left, top, right, bottom, first, last) in enumerate(below):
        if left < first - 1 or right > last + 1:
            found.append((text, "leaves its figure"))
        for other, x, y, end, low, *_ in below[k + 1 :]:
            if y > bottom:
                break
            least = COVERED * min(bottom - top, low - y)
            if min(right, end) - max(left, x) > 1.5 and min(bottom, low) - max(top, y) > least:
                found.append((text, other))
    return found


SHIPPED = {path.relative_to(ROOT / "problems").as_posix(): path for path in PROBLEM_FILES}


@pytest.mark.parametrize("name", mostly_slow(SHIPPED, ["wall.toml"]))
def test_no_text_lies_over_another(browser, tmp_path, name):
    """On a telephone, a desk and a wide screen, with all details open; nothing but the problem file is wider."""
    path = made(recorded(SHIPPED[name].read_text(), prices=True), tmp_path)
    for width in (400, 1280, 1920):
        page = opened(browser, path, viewport={"width": width, "height": 900})
        boxes = page.evaluate(BOXES)
        assert covered([box for box in boxes if "\n" not in box[0]]) == [], width
        assert page.evaluate("document.documentElement.scrollWidth") == width
        page.close()


@pytest.mark.parametrize("name", mostly_slow(("default", "every hand, held", "servo"), ["servo"]))
def test_alternative_texts_say_the_findings(browser, paths, name):
    """The text of each picture is its title and the sentence below it, with its numbers."""
    page = opened(browser, paths(name))
    for figure in page.query_selector_all("figure"):
        said = figure.query_selector("svg").get_attribute("aria-label")
        finding = figure.query_selector(".finding")
        shown = f"{figure.query_selector('h2').inner_text()}. {finding.inner_text() if finding else ''}"
        assert squeezed(said.replace("_", "")) == squeezed(shown.strip())
        assert finding is None or re.search(r"\d", said)
    assert len(page.query_selector_all("figure .finding")) >= len(page.query_selector_all("figure")) - 1


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
        """() => [...document.querySelectorAll('section > h2')]
          .filter((each) => each.offsetParent && each.parentNode.querySelector('table'))
          .map((each) => [each.textContent, each.parentNode.querySelector('tr').innerText])"""
    )
    headings = page.evaluate(
        "[...document.querySelectorAll('h2, caption')].filter((each) => each.offsetParent)"
        ".map((each) => each.innerText)"
    )
    words = page.evaluate("document.body.innerText").split()
    digest = page.evaluate("document.querySelector('td.text').textContent")[:16]
    printed = pypdfium2.PdfDocument(page.pdf(prefer_css_page_size=True))
    sheets = [sheet.get_textpage() for sheet in printed]
    texts = [squeezed(sheet.get_text_range()) for sheet in sheets]
    for sheet, text in zip(printed, sheets, strict=True):
        assert sheet.get_size() == pytest.approx((WIDTH, HEIGHT), abs=1.0)
        places = [text.get_charbox(k) for k in range(text.count_chars())]
        left, low, right, high = zip(*(each for each in places if each[3] <= HEIGHT - TOP + 1), strict=True)
        assert min(left) >= MARGIN - 1 and max(right) <= WIDTH - MARGIN + PAPER_WIDER
        assert min(low) >= MARGIN - 1 and len(high) > len(places) - 120
    for text in texts:
        assert squeezed(page.title()) in text and digest in text
    assert len(sheets) <= SHEETS
    for text in sheets[:-1]:
        assert min(text.get_charbox(k)[1] for k in range(text.count_chars())) < HEIGHT / 2
    assert [word for word in words if not any(squeezed(word) in text for text in texts)] == []
    for text in texts:
        assert not any(text.endswith(squeezed(heading)) for heading in headings)
    for title, *parts in (*figures, *tables):
        assert any(all(squeezed(part) in text for part in (title, *parts)) for text in texts), title


def squeezed(text):
    """Return a text without spaces and hyphens: a PDF breaks its lines at both."""
    return re.sub(r"[\s\ufffe\u00ad\u200b-]", "", text)


def contrast(*colours):
    low, high = sorted(map(luminance, colours))
    return (high + 0.05) / (low + 0.05)


def luminance(colour):
    channels = [int(part) / 255 for part in re.findall(r"\d+", colour)[:3]]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
