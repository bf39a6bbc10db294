"""The site: built without a warning, so every link leads somewhere; it needs no network and fits every screen."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest
from conftest import ROOT
from pages import chromium, needs_chromium, opened

import vctune
from vctune.api.explaining import entries

pytestmark = pytest.mark.slow
TELEPHONE, DESK = {"width": 390, "height": 844}, {"width": 1280, "height": 900}
WIDE = ["index.html", "vctune/model/README.html", "vctune/document/README.html", "results/README.html",
        "explain/key.html", "reference.html"]  # fmt: skip
"""Pages with wide tables, formulas, figures and signatures."""
LOADED = re.compile(
    r'<(?:img|script|iframe|source)[^>]*src="(?:https?:)?//|<link[^>]*rel="stylesheet"[^>]*href="https?:'
)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The built site; a link without a target is a warning, and a warning is an error."""
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run([sys.executable, ROOT / "docs/make.py", folder], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def test_every_guide_and_every_name_has_a_page(site):
    for guide in (ROOT / "vctune").rglob("README.md"):
        assert (site / guide.relative_to(ROOT).with_suffix(".html")).exists()
    explained = "".join(path.read_text("utf-8") for path in (site / "explain").glob("*.html"))
    assert explained.count("<h2>") == len(entries())
    reference = (site / "reference.html").read_text("utf-8")
    assert all(f'id="vctune.{name}"' in reference for name in vctune.__all__ if name != "__version__")


def test_no_page_loads_anything_from_the_network(site):
    pages = [*site.rglob("*.html")]
    assert len(pages) > 30
    assert [page for page in pages if LOADED.search(page.read_text("utf-8"))] == []


@needs_chromium
def test_pages_fit_a_telephone_and_a_desk_in_light_and_dark_without_a_network(site):
    with chromium() as browser:
        for size in (TELEPHONE, DESK):
            grounds = set()
            for scheme in ("light", "dark"):
                for name in WIDE:
                    page = opened(browser, site / name, viewport=size, color_scheme=scheme, offline=True)
                    assert page.said == []
                    assert page.evaluate("document.documentElement.scrollWidth") <= size["width"], name
                grounds.add(page.evaluate("getComputedStyle(document.body).backgroundColor"))
            assert len(grounds) == 2


@needs_chromium
def test_the_search_finds_a_code_from_a_file(site):
    with chromium() as browser:
        page = opened(browser, site / "search.html", offline=True)
        page.goto(f"{(site / 'search.html').as_uri()}?q=warn-band-edge")
        page.wait_for_selector("#search-results li")
        assert "code" in page.inner_text("#search-results").lower()
